"""Training against a plain PyTorch loop: the same work, long runs, many seeds at once, the first step.

- Same work: an epoch of `linear_n4` as shipped against a loop of plain tensors, nn.Module, autograd and fused
  Adam that makes the same decisions and as many updates of the same size; and an update, its part of drawing
  from the buffer included, beside one of TorchRL's stock parts and a compiled one.
- Whole runs: from the first decision to the last, tables, checkpoints and logs included, against the epochs
  of the plain loop, which take turns with ours. Validation is left out on both sides.
- Many seeds: an epoch of 16 independent seeds at once against an epoch of one.
- Start-up: from the end of the imports to the first update.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
import torch

from benchmarks.plain_loop import PlainLoop, StockUpdate
from benchmarks.timing import best_times, printed_number
from trainers.algorithms.dqn import DQN
from trainers.settings.composition import settings_from
from trainers.training.loop import Training
from trainers.training.run import train
from trainers.training.run_folder import RunFolder

SAME_WORK, SAME_UPDATE, LONG_RUN, MANY_SEEDS, FIRST_STEP = 1.3, 1.5, 1.0, 6.0, 1.0  # targets
SEEDS = 16
START_UP = """
from time import perf_counter
import torch
from trainers.settings.composition import settings_from
from trainers.training.loop import Training
begun = perf_counter()
training = Training(settings_from(["experiment=linear_n4", "learning.updates=1"]))
training.env.restart()
training.algorithm.begin(0)
training.algorithm.learn(training.algorithm.collect(0.0), 0.0)
print(perf_counter() - begun)
"""


def row(
    what: str, seconds: float, ratio: float | None = None, at_most: float | None = None
) -> dict[str, Any]:
    """A line of the table."""
    return {"what": what, "seconds": seconds, "ratio": ratio, "at_most": at_most}


def shipped(n_seeds: int = 1, *words: str) -> Training:
    """`linear_n4` as shipped, without validation."""
    training = Training(settings_from(["experiment=linear_n4", f"n_seeds={n_seeds}", *words]))
    training._validate = lambda: np.full(n_seeds, np.nan)  # type: ignore[method-assign]
    return training


def epoch_of(training: Training) -> Callable[[], None]:
    """A call that trains for an epoch, as often as wanted."""

    def call() -> None:
        training.epoch = 0
        training.run_epoch()
        training.measures = training.measures[:0]

    return call


def updates_of(training: Training) -> Callable[[], None]:
    """A call that makes an update, and every sixth time draws the rows of the next six."""
    algorithm, waiting = training.algorithm, list[Any]()
    assert isinstance(algorithm, DQN)

    def call() -> None:
        if not waiting:
            waiting.extend(algorithm.buffer.batches(6, algorithm.rows, algorithm.draws))
        algorithm.update(waiting.pop())

    return call


def same_work(seconds: float) -> list[dict[str, Any]]:
    """Epochs and updates of each kind."""
    settings = settings_from(["experiment=linear_n4"])
    ours, plain, stock = shipped(1, "compile=never"), PlainLoop(settings), StockUpdate(settings)
    fast, our_epoch = shipped(1, "compile=always"), epoch_of(ours)
    our_epoch()
    epoch_of(fast)()
    plain.epoch()
    epochs = best_times({"ours": our_epoch, "plain": plain.epoch}, seconds=seconds)
    calls = {"update, ours": updates_of(ours), "update, ours compiled": updates_of(fast)}
    calls |= {"update, autograd": plain.update, "update, TorchRL's parts": stock.update}
    updates = best_times(calls, seconds=seconds)
    at_most = {"update, ours": SAME_UPDATE, "update, ours compiled": LONG_RUN}
    return [
        row("epoch, ours", epochs["ours"], epochs["ours"] / epochs["plain"], SAME_WORK),
        row("epoch, plain loop", epochs["plain"], 1.0),
        *(
            row(name, each, each / updates["update, autograd"], at_most.get(name))
            for name, each in updates.items()
        ),
    ]


def whole_run(what: str, at_most: float, *words: str) -> list[dict[str, Any]]:
    """A run in a folder of its own; after each of its epochs the plain loop makes one, on its own clock."""
    settings = settings_from(list(words))
    plain, plain_seconds = PlainLoop(settings), 0.0

    def take_turns(training: Training, seconds: float) -> None:
        nonlocal plain_seconds
        begun = perf_counter()
        plain.epoch()
        plain_seconds += perf_counter() - begun

    with TemporaryDirectory() as folder:
        begun = perf_counter()
        training = Training(settings)
        training._validate = lambda: np.zeros(1)  # type: ignore[method-assign]
        training.best_gain[:] = 0.0  # as if validated
        run = RunFolder.create(Path(folder) / "run", settings)
        train(training, run, report=take_turns)
        seconds = perf_counter() - begun - plain_seconds
    return [
        row(f"{what}, ours", seconds, seconds / plain_seconds, at_most),
        row(f"{what}, plain loop", plain_seconds, 1.0),
    ]


def many_seeds(seconds: float) -> list[dict[str, Any]]:
    """An epoch of sixteen seeds against an epoch of one, both on one thread, and sixteen on two."""
    one, many = (epoch_of(shipped(count, "compile=never")) for count in (1, SEEDS))

    def on_two_threads() -> None:
        torch.set_num_threads(2)
        many()
        torch.set_num_threads(1)

    calls = {"one": one, "many": many, "two threads": on_two_threads}
    times = best_times(calls, seconds=seconds)
    ratios = {name: time / times["one"] for name, time in times.items()}
    return [
        row("epoch, 1 seed", times["one"], 1.0),
        row(f"epoch, {SEEDS} seeds, 1 thread", times["many"], ratios["many"]),
        row(f"epoch, {SEEDS} seeds, 2 threads", times["two threads"], ratios["two threads"], MANY_SEEDS),
    ]


def start_up(repeats: int = 3) -> list[dict[str, Any]]:
    """The first update in fresh processes, the best of some."""
    seconds = min(printed_number(START_UP) for _ in range(repeats))
    return [row("from the imports to the first update [seconds]", seconds, seconds, FIRST_STEP)]


def run(seconds: float = 6.0) -> list[dict[str, Any]]:
    """All rows."""
    torch.set_num_threads(1)
    rows = same_work(seconds) + many_seeds(4 * seconds) + start_up()
    rows += whole_run("linear_n4 as shipped", SAME_WORK, "experiment=linear_n4")
    long = "experiment=linear_n4", "learning.epochs=500", "checkpoint_every=50"
    rows += whole_run("linear_n4, 500 epochs", LONG_RUN, *long)
    rows += whole_run("taylor_green_aware as shipped", LONG_RUN, "experiment=taylor_green_aware")
    return rows
