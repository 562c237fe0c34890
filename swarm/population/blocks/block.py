"""Blocks: a population in parts of a fixed size, each a pure function of its place, computed anywhere.

Cells that do not matter to each other are taken `streams.BLOCK` at a time, those of coupled worlds world by
world. Random numbers are those of the undivided population, so a block is the same whoever computes it, and
however often.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from swarm._support import streams
from swarm.optimal.physical_limit import Bounds
from swarm.optimal.problem import Progress, part_of
from swarm.physics.starts import NOISE_BLOCK, Starts, cells_of, draw_worlds
from swarm.physics.world import World
from swarm.policies.policy import AnyPolicy
from swarm.population.frames import Frames
from swarm.population.results import LIVES, SERIES, STARTS, as_dataset, columns_of, origin
from swarm.population.rollout import Moment, rollout
from swarm.population.statistics import Tally, tally

if TYPE_CHECKING:
    import xarray as xr

Record = Literal["statistics", "ends", "thinned", "all"]
PROCESS, LIVING = 1.5e8, 1000.0  # [bytes] of a process, and of a living cell, measured
NODES = 20  # of a medium, that take as much memory as a living cell
THINNED = 48  # moments of a thinned series, at most


class PopulationTest(NamedTuple):
    """A population test: all that its lives follow from."""

    world: World
    policies: dict[str, AnyPolicy]
    cells: int  # of each world
    worlds: int
    seed: int
    population: streams.Population = "test"
    episode: int = 0  # of the first world
    record: Record = "ends"
    bounds: Bounds | None = None

    @property
    def every(self) -> int:
        """One of so many moments is recorded."""
        return -(-(self.world.max_decisions + 1) // THINNED) if self.record == "thinned" else 1

    @property
    def has_series(self) -> bool:
        return self.record in ("thinned", "all")

    @property
    def sizes(self) -> dict[str, int]:
        moments = -(-(self.world.max_decisions + 1) // self.every)
        return {"world": self.worlds, "cell": self.cells, "decision": moments}


class Block(NamedTuple):
    """Some cells of some worlds."""

    number: int
    world: int  # the first
    worlds: int
    cell: int  # the first
    cells: int  # of each world


def blocks_of(test: PopulationTest) -> list[Block]:
    """The blocks of a test, in the order in which they are merged."""
    if test.cells <= streams.BLOCK or test.world.is_shared:
        most = worlds_at_once(test.world, test.cells)
        places = [(at, min(most, test.worlds - at), 0, test.cells) for at in range(0, test.worlds, most)]
    else:
        places = [
            (world, 1, cell, min(streams.BLOCK, test.cells - cell))
            for world in range(test.worlds)
            for cell in range(0, test.cells, streams.BLOCK)
        ]
    return [Block(number, *place) for number, place in enumerate(places)]


def worlds_at_once(world: World, cells: int) -> int:
    """How many worlds of so many cells are lived together."""
    nodes = 0 if world.medium is None else math.prod(world.medium.shape)
    return max(1, streams.BLOCK // (cells + nodes // NODES))


def lived(
    test: PopulationTest, block: Block, progress: Progress | None = None
) -> tuple[Tally, xr.Dataset | None]:
    """The lives of a block: their tally and, unless only `statistics` are recorded, their results; `progress`
    is called with the part that is over.
    """
    world, episode = test.world, test.episode + block.world
    which: dict[str, Any] = {"population": test.population, "first": block.cell}
    episodes = range(episode, episode + block.worlds)
    starts = draw_worlds(world, block.cells, test.seed, episodes, **which)
    if test.worlds == 1:
        starts = type(starts)(*(part[0] for part in starts))
    which |= {"episode": episode, "record": test.has_series, "every": test.every}
    which["frames"] = block.number == 0
    found = {}
    for number, (name, policy) in enumerate(test.policies.items()):
        tell = part_of(progress, number / len(test.policies), (number + 1) / len(test.policies))
        found[name] = lives(world, policy, starts, test.seed, name=name, progress=tell, **which)
    divided = len(blocks_of(test)) > 1
    places = {"every": test.every, "world": block.world, "cell": block.cell}
    indexed = test.has_series or not divided
    results = as_dataset(starts, found, origin(world, test.seed), **places, indexed=indexed)
    if test.has_series and divided:  # blocks end at different times
        results = results.reindex(decision=test.every * np.arange(test.sizes["decision"], dtype=np.int32))
    summed = tally(results, test.bounds, coupled=world.is_shared)
    return summed, None if test.record == "statistics" else results


def each_lived(
    test: PopulationTest,
    blocks: Sequence[Block],
    executor: Executor | None,
    progress: Progress | None = None,
) -> Iterator[tuple[Block, Tally, xr.Dataset | None]]:
    """Blocks as they are done, here or by an executor, which says how many `workers` it has; no more than
    twice as many are under way or waited for. `progress` is called with the part of all cells that is over.
    Raises what a block does.
    """
    sizes = {block: block.cells * block.worlds for block in blocks}
    cells = test.cells * test.worlds
    done = cells - sum(sizes.values())
    if executor is None:
        for block in blocks:
            tell = part_of(progress, done / cells, (done + sizes[block]) / cells)
            yield block, *lived(test, block, tell)
            done += sizes[block]
        return
    workers: int = getattr(executor, "workers", getattr(executor, "_max_workers", 1))
    left, futures = iter(blocks), dict[Future, Block]()
    try:
        while True:
            for block in itertools.islice(left, 2 * workers - len(futures)):
                futures[executor.submit(lived, test, block)] = block
            if not futures:
                return
            ready = wait(futures, return_when=FIRST_COMPLETED).done
            ended = [(futures.pop(future), future) for future in ready]
            for block, future in ended:
                yield block, *future.result()
                done += sizes[block]
                if progress is not None:
                    progress(done / cells)
    finally:
        for future in futures:
            future.cancel()


def memory_needed(world: World, cells: int, recorded: int = 3, *, every: int = 1) -> float:
    """Bytes that a test works with, roughly, and rather too few than too many; the lives under so many
    policies are recorded, one moment of `every`.
    """
    absent = {"eaten": world.medium is None, "torsion": world.torsions is None}
    columns = columns_of(world.dimensions == 3)
    series = [columns[name] for name in SERIES if not absent.get(name)]
    numbers = sum(_width(along, world) * np.dtype(dtype).itemsize for along, dtype, *_ in series)
    return cells * (16.0 * world.observation_size + recorded * (world.max_decisions // every + 1) * numbers)


def needed(world: World, record: Record, cells: int, *, workers: int = 1) -> tuple[float, float]:
    """About the bytes of memory and on the disk that a streamed test of three policies needs: a process for
    each worker with a block in it, and what is kept of every cell.
    """
    at_once = min(cells, streams.BLOCK)
    test = PopulationTest(world, {}, cells, 1, 0, record=record)
    series = memory_needed(world, 1, 3, every=test.every) - memory_needed(world, 1, 0)
    series = series if test.has_series else 0.0
    drawn = 2 * 8 * NOISE_BLOCK * (4 if world.has_noise else 0)
    columns = columns_of(world.dimensions == 3)
    ends = [(3, columns[name]) for name in LIVES] + [(1, columns[name]) for name in STARTS]
    kept = sum(times * np.dtype(dtype).itemsize * _width(along, world) for times, (along, dtype, *_) in ends)
    memory = (workers + 1) * PROCESS + workers * at_once * (LIVING + drawn + 2 * series + 2 * kept)
    return memory, 0.0 if record == "statistics" else cells * (kept + series)


def _width(along: tuple[str, ...], world: World) -> int:
    widths = {"axis": world.dimensions, "quaternion": 4, "record": world.n_records}
    return widths.get(along[-1] if along else "", 1)


def lives(
    world: World,
    policy: AnyPolicy,
    starts: Starts,
    seed: int,
    *,
    name: str,
    population: streams.Population,
    episode: int = 0,
    first: int = 0,
    record: bool = False,
    every: int = 1,
    frames: bool = True,
    progress: Progress | None = None,
) -> dict[str, np.ndarray]:
    """Everything measured of the lives under one policy: (cells, ...), series (cells, decisions + 1, ...) of
    so many decisions one; with several worlds (worlds, cells) stands for (cells); `frames` (frames, ...) of a
    medium.
    """
    cells, recorded = cells_of(starts), []
    filmed = Frames(world, world.medium) if frames and record and world.medium is not None else None
    arrived = np.zeros(cells, bool)
    decisions = np.zeros(cells, np.int32)
    gain = maximal = np.zeros(cells)
    moments = rollout(world, policy, starts, seed, population=population, episode=episode, first=first)
    for number, moment in enumerate(moments):
        if progress is not None:
            progress(number / world.max_decisions)
        if record and number % every == 0:
            recorded.append(_series(world, moment))
        if filmed is not None:
            filmed.take(moment.state)
        if moment.outcome is not None:
            gain = np.where(moment.alive, moment.outcome.gain, gain)  # others may eat where a cell has died
            arrived |= moment.outcome.terminated & moment.alive
            decisions += moment.alive
            maximal = np.maximum(maximal, gain)
    if not np.all(np.isfinite(gain)):
        *_, cell = place = tuple(int(each[0]) for each in np.nonzero(~np.isfinite(gain)))
        raise ValueError(
            f"gains must be finite, got {gain[place]} for cell {first + cell} under {name!r}: "
            "check what the field and the flow return"
        )
    values = [gain, maximal, arrived, world.time(moment.state), decisions]
    if world.race is not None:  # which also ends the lives of those that did not arrive
        values[list(LIVES).index("arrived")] = np.isfinite(moment.state.arrival_time)
        values += [moment.state.arrival_time, world.won(moment.state)]
    names = recorded[0] if recorded else ()
    series = {name: np.stack([row[name] for row in recorded], axis=len(cells)) for name in names}
    return dict(zip(LIVES, values, strict=False)) | series | ({} if filmed is None else filmed.series())


def _series(world: World, moment: Moment) -> dict[str, np.ndarray]:
    """What is plotted of a moment (cells, ...), NaN where a life is over."""
    state = moment.state
    values = {
        "time": world.time(state),
        "position": state.position,
        "heading": world.orientation(state),
        "curvature": world.curvature(state),
        "centre": world.centre(state),
        "concentration": world.concentration(state),
    }
    if world.torsions is not None:
        values["torsion"] = world.torsion(state)
    if state.medium is not None:
        values["eaten"] = state.medium.eaten
    row: dict[str, np.ndarray] = {name: np.array(value, SERIES[name][1]) for name, value in values.items()}
    for column in row.values():
        column[~moment.alive] = np.nan
    return row
