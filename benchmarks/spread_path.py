"""Collecting by blocks: 10⁵ cells in Taylor–Green vortices, here, in processes and on the nodes of a cluster.

Seconds of a round of 16 decisions of every cell. Nodes are of one core each, on this machine; their rows need
Ray, and as many cores. What workers do is predicted by ⌈blocks / workers⌉ · t + d: t is what a block takes
here, d the driver's in a round with two processes, both of the processor; it bends where both are equal.
"""

from __future__ import annotations

import importlib.util
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from time import perf_counter, process_time, sleep
from typing import Any

from trainers.jobs.cluster import Ray
from trainers.jobs.executors import ONE_THREAD, InProcess, Processes
from trainers.settings.composition import settings_from
from trainers.training.loop import Training

CELLS, BLOCK, DECISIONS, ROUNDS = 100_000, 6_250, 16, 4
BLOCKS = CELLS // BLOCK
AT_LEAST = 1.5  # times as fast with two workers: the target
WORDS = [
    *("experiment=taylor_green_aware", f"learning.n_swimmers={CELLS}", f"learning.collect={DECISIONS}"),
    *("compile=never", "tensorboard=false", "validation.cells=2"),
]


def training_by(executor: Executor, *words: str) -> Training:
    """A training whose lives have begun, and whose workers have done a round."""
    training = Training(settings_from([*WORDS, *words]), executor.submit)
    training.env.restart()
    training.algorithm.begin(0)
    training.algorithm.collect(0.0)
    return training


def seconds_of(work: Callable[[], object]) -> tuple[float, float]:
    """Of a round, and of it the processor's on this side."""
    began, spent = perf_counter(), process_time()
    for _ in range(ROUNDS):
        work()
    return (perf_counter() - began) / ROUNDS, (process_time() - spent) / ROUNDS


def collecting(executor: Executor, block: int = BLOCK) -> tuple[float, float]:
    """Rounds of decisions alone, the first 64 of a life, whose random numbers are drawn at once."""
    training = training_by(executor, f"learning.block={block}")
    training.env.restart()
    return seconds_of(lambda: training.algorithm.collect(0.0))


def learning(executor: Executor, staleness: int) -> float:
    """Rounds of decisions and of updates, as many updates as take about as long."""
    training = training_by(
        executor, f"learning.block={BLOCK}", f"learning.staleness={staleness}", "learning.updates=150"
    )
    algorithm = training.algorithm
    return seconds_of(lambda: algorithm.learn(algorithm.collect(0.0), 0.0))[0]


def _loaded() -> str:
    """The node of a worker that has loaded all it needs, and leaves other tasks to others for a while."""
    import ray

    import trainers.algorithms.spread  # noqa: F401

    sleep(1.0)
    return ray.get_runtime_context().get_node_id()


@contextmanager
def nodes(count: int) -> Iterator[Executor]:
    """A cluster of so many nodes of a core each."""
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    import ray
    from ray.cluster_utils import Cluster

    each = {"num_cpus": 1, "object_store_memory": 500 * 2**20}
    made = Cluster(initialize_head=True, head_node_args=each | {"include_dashboard": False})
    try:
        for _ in range(count - 1):
            made.add_node(**each)
        made.wait_for_nodes()
        executor = Ray(made.address)
        ready = set[str]()
        while len(ready) < count:  # a worker loads for seconds, while another does all there is
            ready |= {each.result() for each in [executor.submit(_loaded) for _ in range(count)]}
        yield executor
    finally:
        ray.shutdown()
        made.shutdown()


def run() -> list[dict[str, Any]]:
    """A row for each place."""
    os.environ.update(ONE_THREAD | os.environ)
    at_once, _ = collecting(InProcess(), 0)
    blocks, spent = collecting(InProcess())
    rows = [_row("here, all cells at once", at_once), _row(f"here, {BLOCKS} blocks", blocks)]
    found: dict[int, float] = {}
    stale: dict[int, float] = {}
    driver = math.nan
    for workers in (1, 2):
        with Processes(workers) as executor:
            found[workers], driver = collecting(executor)
            if workers == 2:
                stale = {staleness: learning(executor, staleness) for staleness in (0, 1)}
    each = spent / BLOCKS

    def predicted(workers: int) -> float:
        return math.ceil(BLOCKS / workers) * each + driver

    for workers, seconds in found.items():
        rows.append(_row(f"{workers} process{'es' * (workers > 1)}", seconds, found[1], predicted(workers)))
    rows[-1]["at least"] = f"{AT_LEAST}"
    rows += [
        _row("2 processes and 150 updates", stale[0]),
        _row("2 processes and 150 updates, staleness 1", stale[1], stale[0]),
    ]
    if importlib.util.find_spec("ray") is not None:
        rows += _of_nodes(predicted)
    rows += [_row(f"{n} workers", None, found[1], predicted(n)) for n in (4, 8, 16)]
    bend = f"{spent / driver:.0f} workers, if there are as many blocks"
    return [*rows, _row(f"driver alone: it bends at {bend}", driver)]


def _of_nodes(predicted: Callable[[int], float]) -> list[dict[str, Any]]:
    found = {}
    for count in (1, 2):
        with nodes(count) as executor:
            found[count] = collecting(executor)[0]
    return [_row(f"{n} node{'s' * (n > 1)}", seconds, found[1], predicted(n)) for n, seconds in found.items()]


def _row(
    where: str, seconds: float | None, one: float | None = None, predicted: float | None = None
) -> dict[str, Any]:
    """A line of the table; the speed is that of `one` worker."""
    times = None if one is None else one / (predicted if seconds is None else seconds)  # type: ignore[operator]
    return {
        "where": where,
        "seconds": "" if seconds is None else f"{seconds:.2f}",
        "predicted": "" if predicted is None else f"{predicted:.2f}",
        "times as fast as one": "" if times is None else f"{times:.2f}",
        "at least": "",
    }
