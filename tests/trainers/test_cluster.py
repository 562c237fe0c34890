"""A Ray cluster of two nodes on this machine: a worker killed, a node removed, and nothing lost.

Run by `make cluster`; `make cluster-long` has longer lives.
"""

import filecmp
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest

from swarm._support import provenance
from swarm.physics.world import World
from swarm.policies.network import load_policy
from swarm.population.contest import population_test
from tests.short_runs import assert_equal_runs
from tests.trainers.noted import at_work, begun, noted
from trainers.cli import training
from trainers.jobs import cluster, remote, sweep
from trainers.jobs.cluster import ClusterError, Needs, Ray, launched
from trainers.settings.composition import settings_from
from trainers.training.run_folder import RunFolder

ray = pytest.importorskip("ray", reason="needs chemoswarm[cluster]")
pytestmark = [pytest.mark.cluster, pytest.mark.filterwarnings("default")]
LONG = os.environ.get("CLUSTER") == "cluster-long"
WORDS = [
    *("learning.n_swimmers=2", "learning.hidden=[4]", "learning.batch_size=4", "learning.buffer_size=50"),
    *("world.life=8", "validation.life=2", "validation.cells=2", "tensorboard=false", "checkpoint_every=40"),
    f"learning.epochs={800 if LONG else 80}",
    "seed=0,1,2,3,4,5,6,7",
]
SPREAD = [
    *("experiment=taylor_green_aware", "learning.n_swimmers=20000", "learning.block=2048", "world.life=20"),
    *("learning.staleness=1", "learning.collect=16", "tensorboard=false", "checkpoint_every=1"),
    *("validation.cells=40", "validation.life=20", f"learning.epochs={20 if LONG else 2}"),
]
CELLS, LIFE = (10_000_000, 20.0) if LONG else (1_000_000, 4.0)


class Noted(Ray):
    """A cluster whose tasks say when they begin and end."""

    def submit(self, do, *arguments):
        return super().submit(noted, self.file, do, *arguments)


class Havoc(threading.Thread):
    """Kills a worker at work, later removes a node at work, when so many tasks have ended."""

    def __init__(self, nodes, node, file, kill_at, remove_at):
        super().__init__(daemon=True)
        self.nodes, self.node, self.file = nodes, node, file
        self.kill_at, self.remove_at, self.killed, self.removed = kill_at, remove_at, None, None

    def running(self, ended):
        """The (process, node) of tasks at work, once so many have ended."""
        while True:
            tasks = at_work(self.file, ended)
            if there := [(process, node) for _, process, node in tasks if process != self.killed]:
                return there
            time.sleep(0.02)

    def run(self):
        self.killed = self.running(self.kill_at)[-1][0]
        os.kill(self.killed, signal.SIGKILL)
        removed = self.node.node_id
        while removed not in [node for _, node in self.running(self.remove_at)]:
            time.sleep(0.02)
        self.removed = removed
        self.nodes.remove_node(self.node, allow_graceful=False)


@pytest.fixture(scope="module")
def head():
    from ray.cluster_utils import Cluster

    alone = {"num_cpus": 1, "object_store_memory": 300 * 2**20, "include_dashboard": False}
    made = Cluster(initialize_head=True, head_node_args=alone)
    yield made
    made.shutdown()


@pytest.fixture
def nodes(head):
    yield head
    ray.shutdown()


@pytest.fixture
def havoc(nodes, tmp_path):
    node = nodes.add_node(num_cpus=1, object_store_memory=300 * 2**20)
    nodes.wait_for_nodes()
    executor = Noted(nodes.address)
    executor.file = tmp_path / "notes"
    return executor, lambda *when: Havoc(nodes, node, executor.file, *when)


@pytest.fixture
def undrawn(monkeypatch):
    """Runs without their figures, which take as long as their epochs."""
    monkeypatch.setattr("trainers.training.run.draw", lambda training, run: None)


def check_only_the_lost_was_done_twice(havoc, units):
    """Whatever began again had begun where a process or a node was lost."""
    tasks = begun(havoc.file)
    assert len(tasks) == units
    again = [each for places in tasks.values() for each in places[:-1]]
    assert all(process == havoc.killed or node == havoc.removed for process, node in again), again
    assert any(process == havoc.killed for process, _ in again)
    assert any(node == havoc.removed for process, node in again if process != havoc.killed)
    print(f"{units} tasks, {len(again)} of them begun again")


@pytest.mark.slow
def test_a_population_loses_a_worker_and_a_node_and_no_bit(havoc, tmp_path):
    executor, wreak = havoc
    policies = {"dqn": load_policy("zoo:linear_n4")}
    sizes = {"cells": CELLS, "life": LIFE, "record": "ends"}
    wreaked = wreak(3, 6)
    wreaked.start()
    shared = population_test(World(), policies, **sizes, out=tmp_path / "shared.nc", executor=executor)
    wreaked.join(10)
    alone = population_test(World(), policies, **sizes, out=tmp_path / "alone.nc")
    assert filecmp.cmp(tmp_path / "shared.nc", tmp_path / "alone.nc", shallow=False)
    check_only_the_lost_was_done_twice(wreaked, shared.attrs["blocks"])
    shared.close(), alone.close()


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_sweep_loses_a_worker_and_a_node_and_no_bit(havoc, tmp_path, monkeypatch):
    executor, wreak = havoc
    monkeypatch.chdir(tmp_path)
    wreaked = wreak(3, 6)
    wreaked.start()
    with monkeypatch.context() as within:
        within.setattr(sweep, "launched", lambda *where: executor)
        sweep.sweep([*WORDS, "launcher=ray", "hydra.sweep.dir=shared"])
    wreaked.join(10)
    sweep.sweep([*WORDS, "launcher=here", "hydra.sweep.dir=alone"])
    for seed in range(8):
        for name in ("policy.safetensors", "metrics.csv", "settings.yaml", "run.json"):
            assert filecmp.cmp(f"shared/seed={seed}/{name}", f"alone/seed={seed}/{name}", shallow=False)
    check_only_the_lost_was_done_twice(wreaked, 8 * (20 if LONG else 2))


@pytest.mark.slow
def test_a_spread_training_loses_a_worker_and_a_node_and_no_bit(havoc, tmp_path, monkeypatch):
    executor, wreak = havoc
    monkeypatch.chdir(tmp_path)
    settings, folder = settings_from(SPREAD), tmp_path / "shared"
    wreaked = wreak(10, 40)
    wreaked.start()
    with monkeypatch.context() as within:
        within.setattr(remote, "launched", lambda *where, retries: executor)
        training.begin(settings, folder, ("ray", None, None))
    wreaked.join(10)
    training.begin(settings, tmp_path / "alone")
    assert_equal_runs(RunFolder(folder), RunFolder(tmp_path / "alone"))
    rounds = -(-settings.training_world().max_decisions // 16)
    check_only_the_lost_was_done_twice(wreaked, settings.learning.epochs * rounds * 10)


@pytest.mark.slow
def test_what_a_cluster_lacks_is_said_before_it_works(nodes, monkeypatch):
    executor = Ray(nodes.address)
    with pytest.raises(
        ClusterError, match=r"a node must have what a task needs, CPU 1, 9.31e\+05 GiB of mem"
    ):
        executor.needing(Needs(memory=1e15))
    with pytest.raises(ZeroDivisionError):  # its own error, and not again
        executor.submit(divmod, 1, 0).result(60)
    here = {**provenance.versions(), "numpy": "0.1"}
    monkeypatch.setattr(cluster.provenance, "versions", lambda: here)
    with pytest.raises(ClusterError, match=r"worker on .* must have numpy 0\.1, got numpy \d"):
        Ray(nodes.address)
    ray.shutdown()
    with pytest.raises(ClusterError, match=r"address must be a Ray cluster that answers, got 127\.0\.0\.1:9"):
        launched("ray", address="127.0.0.1:9")


@pytest.mark.slow
def test_a_full_object_store_is_a_line():
    full = {"local_fs_capacity_threshold": 1e-3}  # the disk that stands in for the store counts as full
    own = {"num_cpus": 1, "object_store_memory": 80 * 2**20, "include_dashboard": False}
    ray.init("local", **own, _system_config=full)
    try:
        for do, argument in ((bytes, 2**28), (len, bytes(2**28))):  # what is returned, and what is taken
            with pytest.raises(ClusterError, match=r"stores must have room for .* are full: ray start"):
                Ray().submit(do, argument).result(60)
    finally:
        ray.shutdown()


@pytest.mark.slow
def test_a_cluster_answers_its_client(tmp_path):
    ports = []
    for _ in range(2):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            ports.append(free.getsockname()[1])
    start = ["start", "--head", "--block", f"--port={ports[0]}", f"--ray-client-server-port={ports[1]}"]
    about = ["--num-cpus=1", "--object-store-memory=100000000", "--include-dashboard=false"]
    command = [sys.executable, "-m", "ray.scripts.scripts", *start, *about]
    begun = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for _ in range(200):
            with socket.socket() as asked:
                if asked.connect_ex(("127.0.0.1", ports[1])) == 0:
                    break
            time.sleep(0.5)
        script = (
            "from trainers.jobs.cluster import launched\n"
            f"executor = launched('ray', address='ray://127.0.0.1:{ports[1]}')\n"
            "print(executor.submit(divmod, 7, 2).result(60))\n"
            "print(repr(executor.submit(divmod, 7, 0).exception(60)))\n"
            "executor.shutdown()\n"
        )
        said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    finally:
        begun.terminate()
        begun.wait(60)
    assert said.stdout.splitlines() == ["(3, 1)", "ZeroDivisionError('integer division or modulo by zero')"]
