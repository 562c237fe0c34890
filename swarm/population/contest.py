"""Population tests: the same starts for every policy, and the lives that follow."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm._support import streams
from swarm._support.checks import check_count, check_flag, check_memory
from swarm.optimal import physical_limit
from swarm.physics.motion.arc import centre_of_curvature
from swarm.physics.starts import Starts, draw_worlds
from swarm.physics.world import World
from swarm.policies.policy import AnyPolicy, check_policy
from swarm.policies.strategies import Greedy
from swarm.population.frames import Frames
from swarm.population.results import LIVES, RIVAL, SERIES, as_dataset, origin
from swarm.population.rollout import Moment, rollout

if TYPE_CHECKING:
    import xarray as xr


def population_test(
    world: World,
    policies: Mapping[str, AnyPolicy],
    *,
    cells: int = 40,
    worlds: int = 1,
    life: float = 200.0,
    seed: int = 0,
    record: bool = True,
    limit: bool = True,
    population: streams.Population = "test",
    episode: int = 0,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Lives of `cells` cells in each of `worlds` worlds under each policy, all from the same starts and with
    the same random numbers.

    Per (policy, cell): gain, maximal_gain, arrived, lifetime, decisions; with `record` also per decision,
    from the start (0) on and NaN after the end: time, position, heading, curvature, centre (of curvature),
    concentration. In a race arrival_time and won are added, in a medium eaten (per decision), and `medium` at
    up to 48 times. With several worlds, those of one episode after the other, they are per (policy, world,
    cell). Attributes: seed, life, settings of the world (JSON), versions, commit, `coupled` (1) where what
    one cell does can matter to another, and the limit where there is one and `limit` is asked for. "greedy"
    is added where it is missing. `progress` is called with the part of all decisions that is over. Raises
    ValueError for a field or flow that returns NaN.
    """
    policies = _with_rival(policies)
    check_count("cells", cells)
    check_count("worlds", worlds)
    seed = streams.check_seed(seed)
    check_flag("record", record)
    world = world.replace(life=life)
    needed = memory_needed(world, cells * worlds, len(policies) if record else 0)
    check_memory(needed, f"cells must be fewer, or life shorter, got {cells * worlds} and {life:g}")
    starts = draw_worlds(world, cells, seed, range(episode, episode + worlds), population=population)
    everyone = type(starts)(*(part.reshape(-1, *part.shape[2:]) for part in starts))
    starts = starts if worlds > 1 else everyone
    drawn: dict[str, Any] = {"population": population, "episode": episode}
    lived = {}
    for number, (name, policy) in enumerate(policies.items()):
        if progress is not None:
            drawn["progress"] = functools.partial(_tell, progress, number, len(policies))
        lived[name] = lives(world, policy, starts, seed, name=name, record=record, **drawn)
    bound = physical_limit.limit(world, everyone) if limit else None
    return as_dataset(starts, lived, _attributes(world, seed, population, bound))


def _tell(progress: Callable[[float], None], before: int, policies: int, part: float) -> None:
    """Progress of one policy's lives as progress of all."""
    progress((before + part) / policies)


def _attributes(world: World, seed: int, population: str, bound: float | None) -> dict[str, Any]:
    """What the results of a population test say of it."""
    return {
        "title": "Population test: the same starts for every policy",
        "population": population,
        **origin(world, seed),
        **({"coupled": 1} if world.is_shared else {}),
        **({} if bound is None else {"limit": bound}),
    }


def memory_needed(world: World, cells: int, recorded: int = 3) -> float:
    """Bytes that a test works with, roughly, and rather too few than too many; the lives under so many
    policies are recorded.
    """
    series = [each for name, each in SERIES.items() if name != "eaten" or world.medium is not None]
    numbers = sum(2 ** len(along) * np.dtype(dtype).itemsize for along, dtype, *_ in series)
    return cells * (16.0 * world.observation_size + recorded * (world.max_decisions + 1) * numbers)


def _with_rival(policies: Mapping[str, AnyPolicy]) -> dict[str, AnyPolicy]:
    named: Mapping[Any, Any] = policies
    for name, policy in named.items():
        if not isinstance(name, str) or not name:
            raise TypeError(f"policies must be named by text, got {name!r}")
        check_policy(name, policy)
    if not isinstance(policies.get(RIVAL, Greedy()), Greedy):
        raise ValueError(f"policy {RIVAL!r} must be the greedy strategy, got {policies[RIVAL]!r}")
    return dict(policies) if RIVAL in policies else {**policies, RIVAL: Greedy()}


def lives(
    world: World,
    policy: AnyPolicy,
    starts: Starts,
    seed: int,
    *,
    name: str,
    population: streams.Population,
    episode: int = 0,
    record: bool = False,
    progress: Callable[[float], None] | None = None,
) -> dict[str, np.ndarray]:
    """Everything measured of the lives under one policy: (cells, ...), series (cells, decisions + 1, ...);
    with several worlds (worlds, cells) stands for (cells); frames (frames, ...) of a medium.
    """
    cells = starts.heading.shape
    recorded, frames = [], Frames(world, world.medium) if record and world.medium is not None else None
    arrived = np.zeros(cells, bool)
    decisions = np.zeros(cells, np.int32)
    gain = maximal = np.zeros(cells)
    lived = rollout(world, policy, starts, seed, population=population, episode=episode)
    for done, moment in enumerate(lived):
        if progress is not None:
            progress(done / world.max_decisions)
        if record:
            recorded.append(_series(world, moment))
        if frames is not None:
            frames.take(moment.state)
        if moment.outcome is not None:
            gain = np.where(moment.alive, moment.outcome.gain, gain)  # others may eat where a cell has died
            arrived |= moment.outcome.terminated & moment.alive
            decisions += moment.alive
            maximal = np.maximum(maximal, gain)
    if not np.all(np.isfinite(gain)):
        *_, cell = place = tuple(int(each[0]) for each in np.nonzero(~np.isfinite(gain)))
        raise ValueError(
            f"gains must be finite, got {gain[place]} for cell {cell} under {name!r}: "
            "check what the field and the flow return"
        )
    values = [gain, maximal, arrived, world.time(moment.state), decisions]
    if world.race is not None:  # which also ends the lives of those that did not arrive
        values[list(LIVES).index("arrived")] = np.isfinite(moment.state.arrival_time)
        values += [moment.state.arrival_time, world.won(moment.state)]
    names = recorded[0] if recorded else ()
    series = {name: np.stack([row[name] for row in recorded], axis=len(cells)) for name in names}
    return dict(zip(LIVES, values, strict=False)) | series | ({} if frames is None else frames.series())


def _series(world: World, moment: Moment) -> dict[str, np.ndarray]:
    """What is plotted of a moment (cells, ...), NaN where a life is over."""
    state, curvature = moment.state, world.curvature(moment.state)
    values = {
        "time": world.time(state),
        "position": state.position,
        "heading": world.heading_angle(state),
        "curvature": curvature,
        "centre": centre_of_curvature(state.pose, curvature),
        "concentration": world.concentration(state),
    }
    if state.medium is not None:
        values["eaten"] = state.medium.eaten
    row: dict[str, np.ndarray] = {name: np.array(value, SERIES[name][1]) for name, value in values.items()}
    for column in row.values():
        column[~moment.alive] = np.nan
    return row
