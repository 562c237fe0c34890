"""Collecting by blocks: the same as all at once, whoever collects them, in what order, and however often."""

import itertools
import os
import pickle
import signal
import threading
import time
from concurrent.futures import Future
from pathlib import Path

import pytest
import torch

from tests.short_runs import NOISE, assert_equal_runs, short_settings, whole
from tests.trainers.noted import at_work, begun, noted
from tests.trainers.test_cli import elsewhere, refused, run  # noqa: F401
from trainers.algorithms.spread import SpreadCollector, blocks_of
from trainers.jobs.executors import Processes
from trainers.settings.learning import DQNSettings
from trainers.training import run as running
from trainers.training.checkpoint import tensors_of
from trainers.training.loop import Training
from trainers.training.run_folder import RunFolder

GRID = {"box": [[-1.0, 2.0], [-1.0, 2.0]], "shape": [20, 20], "uptake": 0.01, "diffusivity": 0.02}
MEDIUM = {"medium": GRID, "interval_rule": "common", "start_box": [[0.0, 1.0], [0.0, 1.0]]}


def settings_for(recipe="swarm", world=None, **learning):
    return short_settings(recipe, n_seeds=2, world={**NOISE, **(world or {})}, learning=learning)


def trained(settings, submit=None, epochs=1):
    training = Training(settings, submit)
    for _ in range(epochs):
        training.run_epoch()
    return training


def assert_same(one, other):
    one, other = tensors_of(one), tensors_of(other)
    assert one.keys() == other.keys()
    for name, tensor in one.items():
        assert torch.equal(tensor.nan_to_num(), other[name].nan_to_num()), name


@pytest.mark.parametrize(
    ("cells", "worlds", "size", "parts"),
    [
        (5, 2, 2, [(0, 0, 2), (0, 2, 4), (0, 4, 5), (1, 0, 2), (1, 2, 4), (1, 4, 5)]),
        (5, 3, 11, [(0, 0, 5), (2, 0, 5)]),
        (5, 1, 5, [(0, 0, 5)]),
    ],
    ids=["parts of worlds", "whole worlds", "all"],
)
def test_blocks_are_whole_worlds_or_parts_of_one(cells, worlds, size, parts):
    blocks = blocks_of(DQNSettings(n_swimmers=cells, n_worlds=worlds, block=size))
    assert [(each.worlds[0], *each.cells) for each in blocks] == parts
    rows = range(cells * worlds)
    assert [row for each in blocks for row in rows[each.columns]] == list(rows)


@pytest.mark.parametrize(
    ("recipe", "world", "learning"),
    [
        ("swarm", {"varying_speed": True}, {}),
        ("swarm", MEDIUM, {}),
        ("drqn", {}, {}),
        ("ppo", {}, {"critic": "central"}),
        ("ppo", {"action": "continuous"}, {}),
    ],
    ids=["dqn", "medium", "drqn", "central critic", "continuous"],
)
def test_a_single_block_trains_as_all_cells_at_once(recipe, world, learning):
    one, other = (settings_for(recipe, world, n_worlds=2, block=size, **learning) for size in (0, 10))
    assert_same(trained(one), trained(other))


@pytest.mark.parametrize(
    ("world", "sizes"), [({"varying_speed": True}, (2, 7)), (MEDIUM, (5, 7))], ids=["alone", "medium"]
)
def test_cells_live_the_same_whatever_the_blocks(world, sizes):
    """But for what they explore, each cell has its own start, noise and company."""
    rollouts = []
    for size in (0, *sizes):
        made = Training(settings_for("swarm", world, n_worlds=3, block=size))
        made.algorithm.explorer.epsilon = 0.0
        made.env.restart()
        rollouts.append(torch.cat([made.algorithm.collector.collect(3) for _ in range(3)]))
    for other in rollouts[1:]:
        assert set(other.keys(True, True)) == set(rollouts[0].keys(True, True))
        for name in rollouts[0].keys(True, True):
            torch.testing.assert_close(other[name], rollouts[0][name], rtol=1e-4, atol=1e-4, msg=str(name))


class Late(Future):
    """A task that is done when it is asked for, after a later one."""

    waiting: list = []

    def __init__(self, *task):
        super().__init__()
        self.task = task
        self.waiting.append(self)

    def result(self, timeout=None):
        for late in [each for each in reversed(self.waiting) if not each.done()]:
            do, *arguments = pickle.loads(pickle.dumps(late.task))  # as it would arrive elsewhere
            late.set_result(do(*arguments))
        return super().result()


@pytest.mark.parametrize(("recipe", "staleness"), [("swarm", 0), ("ppo", 1), ("drqn", 1)])
def test_no_bit_depends_on_who_is_done_first(recipe, staleness):
    settings = settings_for(recipe, n_worlds=2, block=3, staleness=staleness)
    assert_same(trained(settings), trained(settings, Late))


def test_a_stale_policy_is_that_of_one_round_before():
    policies, learnt = [], []
    training = Training(
        settings_for(block=10, staleness=1), lambda *task: policies.append(task[3]) or Late(*task)
    )
    learn = training.algorithm.learn

    def noted(*arguments):
        learnt.append(weights(training.algorithm.explorer))
        return learn(*arguments)

    training.algorithm.learn = noted
    training.run_epoch()
    assert len(policies) == 3
    assert [weights(each) for each in policies] == [learnt[0], *learnt[:-1]]


def weights(policy):
    return [each.tolist() for each in policy.state_dict().values()]


def test_an_interrupted_run_goes_on_elsewhere_bit_for_bit(tmp_path):
    settings = settings_for(block=3, staleness=1, epochs=4)
    expected = whole(tmp_path / "whole", settings)
    calls = itertools.count()

    def lost(*task):
        if next(calls) == 15:
            raise KeyboardInterrupt
        return Late(*task)

    folder = tmp_path / "stopped"
    with pytest.raises(KeyboardInterrupt):
        running.train(*running.begin(folder, settings, lost))
    running.train(*running.resume(folder, Late))
    assert_equal_runs(RunFolder(folder), expected)


IN_PARTS = "learning.block must be at least the 3 cells of a world, whose cells share it here, got 2"
REFUSED = {
    "world.first_arrivals=1 world.field=radial world.interval_rule=common learning.block=2": IN_PARTS,
    "algorithm=ppo learning.critic=central learning.n_swimmers=3 learning.block=2": IN_PARTS,
    "learning.staleness=1 learning.collect=4": (
        "learning.staleness must go with a learning.block and a learning.collect above 0, got 1 with 0 and 4"
    ),
    "learning.staleness=2": "learning.staleness must be at most 1, got 2",
    "learning.block=-1": "learning.block must be at least 0, got -1",
    "launcher=processes": (
        "learning.block must be above 0, cells that launcher=processes lets decide in a task, got 0"
    ),
    "launcher=process": "launcher must be one of here, processes, ray, got 'process'; did you mean",
    "launcher=processes launcher.jobs=0 learning.block=2": "launcher.jobs must be",
    "launcher.cores=2": "key of a launcher must be one of launcher, launcher.address, launcher.jobs, got",
    "launcher.jobs=2": "jobs must come with launcher=processes or ray, got 2",
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_be_spread_is_a_line(words):
    assert REFUSED[words] in refused("train", "learning.n_swimmers=3", "tensorboard=false", *words.split())


@pytest.mark.parametrize(
    ("held", "line"),
    [
        ({"rule": lambda made: lambda: 0}, "EpsilonGreedy: .*pickle.*lambda"),
        ({"env": lambda made: made.env}, "EpsilonGreedy: holds its environment"),
        (None, "learning.block must be 0 where NoneType collects"),
    ],
    ids=["not picklable", "with its environment", "another collector"],
)
def test_what_decides_must_be_able_to_go_elsewhere(held, line):
    made = Training(settings_for()).algorithm
    for name, value in (held or {}).items():
        setattr(made.collector.policy, name, value(made))
    with pytest.raises(ValueError, match=line):
        SpreadCollector(made.collector if held else None, settings_for(block=2))


# --- processes that are killed ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("staleness", [0, 1])
def test_a_killed_process_costs_its_block_and_no_bit(tmp_path, staleness):
    settings = settings_for(n_swimmers=4000, block=700, staleness=staleness, epochs=6)
    file, killed = tmp_path / "notes", []

    def kill():
        while not killed:
            if tasks := at_work(file, 20):
                killed.append(tasks[-1])
                os.kill(tasks[-1][1], signal.SIGKILL)
            time.sleep(0.002)

    threading.Thread(target=kill, daemon=True).start()
    with Processes(2, retries=3) as executor:
        other = trained(settings, lambda *task: executor.submit(noted, file, *task), 6)
    assert_same(trained(settings, epochs=6), other)
    assert [name for name, places in begun(file).items() if len(places) > 1] == [killed[0][0]]


@pytest.mark.slow
def test_the_command_collects_in_processes_and_goes_on_here():
    words = ["learning.n_swimmers=6", "learning.block=2", "learning.collect=4", "learning.epochs=4"]
    words += ["world.life=4", "validation.cells=2", "tensorboard=false", "checkpoint_every=1"]
    assert run("train", *words, "hydra.run.dir=here")[0] == 0
    assert run("train", *words, "launcher=processes", "launcher.jobs=2", "hydra.run.dir=there")[0] == 0
    assert_equal_runs(RunFolder(Path("there")), RunFolder(Path("here")))
    assert "nothing is left to learn" in run("train", "resume=there", "launcher=processes")[1]
