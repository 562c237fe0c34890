"""Remote trainings: runs whose epochs, or whose decisions, are computed elsewhere, and whose folder is kept
here.

A piece of a training is a pure function of the settings and of the state it begins with, from one checkpoint
to the next; a block of decisions one of what `collected` takes. The driver writes the checkpoints, so that a
lost worker costs one piece or block, and a lost driver none.
"""

import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from safetensors.torch import load, save

from trainers.algorithms.collector import BLOCK
from trainers.algorithms.spread import Here, Submit
from trainers.jobs.cluster import Needs, Ray, launched
from trainers.jobs.executors import InProcess, LostProcess
from trainers.settings.composition import SettingsError, settings_from_stored
from trainers.settings.schema import Settings
from trainers.training import checkpoint as checkpoints
from trainers.training import run_folder as runs
from trainers.training.run import memory_needed, prepare, timing_of, train_in
from trainers.training.run_folder import RunError, RunFolder

RETRIES = 3  # of a block whose process was killed: memory that runs out would end each of them
LOADED = 6e8  # [bytes] of a process with torch
_finishing = threading.Lock()  # what draws figures does one at a time


class Piece(NamedTuple):
    """The state of a training after some epochs."""

    tensors: bytes  # of safetensors
    record: dict[str, int]
    timings: list[dict[str, Any]]  # of its epochs


def needs_of(settings: Settings, memory: float | None = None) -> Needs:
    """What a piece of a training needs of a node, or a task that takes so much memory [bytes]."""
    on_gpu, memory = settings.device != "cpu", 2 * memory_needed(settings) if memory is None else memory
    return Needs(settings.threads, float(on_gpu), LOADED + (0 if on_gpu else memory))


@contextmanager
def collectors(
    settings: Settings, launcher: str | None, jobs: int | None = None, address: str | None = None
) -> Iterator[Submit]:
    """What collects the decisions of a run, as `launched` says; after an error what is under way is dropped.

    Raises SettingsError where no blocks could go elsewhere, and as `launched` and `Ray.needing` do.
    """
    if launcher not in (None, "here") and not settings.learning.block:
        raise SettingsError(
            f"learning.block must be above 0, cells that launcher={launcher} lets decide in a task, got 0"
        )
    executor = launched(launcher, jobs, address, retries=RETRIES)
    try:
        if isinstance(executor, Ray):
            yield executor.needing(needs_of_block(settings)).submit
        else:
            yield Here if isinstance(executor, InProcess) else executor.submit
    except BaseException as error:
        executor.shutdown(cancel_futures=True)
        if isinstance(error, LostProcess):
            raise RunError(f"a block of decisions was begun {1 + RETRIES} times: {error}") from None
        raise
    executor.shutdown()


def needs_of_block(settings: Settings) -> Needs:
    """What the decisions of a block need of a node."""
    learning, world = settings.learning, settings.training_world()
    cells = len(settings.seeds) * min(learning.block, learning.n_swimmers * learning.n_worlds)
    decisions = min(learning.collect or world.max_decisions, world.max_decisions)
    return needs_of(settings, cells * (12 * world.observation_size * decisions + 8 * BLOCK))


def advance(settings: Settings, before: Piece | None, epochs: int) -> Piece:
    """So many further epochs of a training."""
    training = prepare(settings)
    if before is not None:
        checkpoints.restore(training, load(before.tensors), before.record)
    timings = []
    for _ in range(epochs):
        started, decisions, updates = time.perf_counter(), training.decisions, training.algorithm.updates
        training.run_epoch()
        timings.append(timing_of(training, decisions, updates, time.perf_counter() - started))
    held = {name: value.cpu().contiguous() for name, value in checkpoints.tensors_of(training).items()}
    return Piece(save(held), checkpoints.record_of(training), timings)


def train_through(executor: Executor, folder: Path, settings: Settings) -> None:
    """As `train_in`, but epochs are computed by an executor: what comes out is the same, bit for bit."""
    if not runs.is_run_folder(folder):
        RunFolder.create(folder, settings)
    run, stored = RunFolder.open(folder)
    if not run.finished:
        settings = settings_from_stored(stored, folder)
        with run.owned():
            _advance_to_the_end(executor, run, settings)
    with _finishing:
        train_in(folder, settings)


def _advance_to_the_end(executor: Executor, run: RunFolder, settings: Settings) -> None:
    folder, epochs, every = run.path / runs.CHECKPOINTS, settings.learning.epochs, settings.checkpoint_every
    found = checkpoints.read_newest(folder, settings.identity())
    state = None if found is None else Piece(save(found[0]), found[1], [])
    done = 0 if state is None else state.record["epoch"]
    timings = [each for each in run.rows(runs.TIMINGS) if int(each["epoch"]) <= done]
    while done < epochs:
        state = executor.submit(advance, settings, state, min(every - done % every, epochs - done)).result()
        done, timings = state.record["epoch"], timings + state.timings
        checkpoints.write(folder, done, load(state.tensors), state.record, settings.identity())
        run.rewrite(runs.TIMINGS, runs.TIMING_COLUMNS, timings)
