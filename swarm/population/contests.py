"""Contests: several policies in one world, each steering a share of its cells, and who wins the race.

Which cells a policy steers rotates from world to world. Seats are dealt out evenly: with the counts n_p of
N cells, cell i of the first world is steered by the policy that is then furthest behind its share n_p/N. In
world w it is steered by whoever has seat (i + w) mod N. A turn is N / gcd(n_1, n_2, …) worlds, after which
the seats are as at first. All worlds of a turn have the same starts and the same random numbers, those of
episode ⌊w / turn⌋; so within a turn every policy has had every start, as often as its share says, and a start
that is better than another is no policy's luck. Turns are independent, the worlds of one are not: intervals
are over turns.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm._support import streams
from swarm._support.checks import check_count, check_memory, check_number
from swarm._support.tables import Table, percent
from swarm.optimal.problem import Progress, part_of
from swarm.physics.perception import SENSORS, Memory, Sensor, Situation
from swarm.physics.starts import draw_worlds
from swarm.physics.world import State, World
from swarm.physics.world.rules import in_units
from swarm.policies.policy import AnyPolicy, begin, check_policy, decide, is_continuous
from swarm.population.blocks.block import worlds_at_once
from swarm.population.results import labels, origin
from swarm.population.rollout import rollout
from swarm.population.statistics import share_interval

if TYPE_CHECKING:
    import xarray as xr

Array = Any

KEPT = 32.0  # [bytes] of a cell, once its life is over


def contest(
    world: World,
    policies: Mapping[str, AnyPolicy],
    shares: Mapping[str, float] | None = None,
    *,
    cells: int = 40,
    worlds: int = 40,
    seed: int = 0,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Races of several policies in the same `worlds`, each policy steering its share of the `cells`.

    `shares` above 0 are relative to one another, by default alike; each becomes a whole number of cells, at
    least one. Starts rotate, see the [module][swarm.population.contests]. A policy that reads another
    sensor's records than the world's, as its `sensor` says, is shown those.

    Per policy: `won`, its share of all wins; `won_interval` (policy, bound), 95%, over turns; `crowd`, its
    share of the cells. Per (world, cell): `steered_by`, the policy's number; `winner`, `arrival_time`
    (infinite for who never came), `gain` and in a medium `eaten`. Per world: `turn`. Worlds are lived some at
    a time, so that memory stays bounded. `progress` is called with the part that is over. Raises TypeError or
    ValueError that names the rule: without a race, for shares that leave a policy without a cell, for worlds
    that are no whole turns, for a policy that does not fit the world or whose sensor the world cannot serve.
    """
    if world.first_arrivals is None:
        raise ValueError("a contest must be in a world with first_arrivals, got a world without a race")
    together, first = crowd_of(world, policies, shares, cells=cells)
    counts = tuple(np.bincount(first.steered_by).tolist())
    turn = cells // math.gcd(*counts)
    if check_count("worlds", worlds) % turn:
        rule = f"worlds must be a multiple of {turn}, so that every policy has had every start"
        raise ValueError(f"{rule} with {counts} of {cells} cells, got {worlds}")
    seed = streams.check_seed(seed)
    check_memory(KEPT * cells * worlds, f"cells × worlds must be fewer, got {cells} × {worlds}")
    steered_by = first.steered_by[(np.arange(cells) + np.arange(worlds)[:, None]) % cells]
    episodes, most = np.arange(worlds) // turn, worlds_at_once(world, cells)
    parts = []
    for at in range(0, worlds, most):
        some = slice(at, min(at + most, worlds))
        crowd = dataclasses.replace(first, steered_by=steered_by[some])
        told = part_of(progress, some.start / worlds, some.stop / worlds)
        parts.append(_race(together, crowd, seed, episodes[some], told))
        if told is not None:
            told(1.0)
    ended = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return _dataset(world, list(policies), counts, steered_by, episodes, ended, seed)


def crowd_of(
    world: World,
    policies: Mapping[str, AnyPolicy],
    shares: Mapping[str, float] | None = None,
    *,
    cells: int = 40,
) -> tuple[World, Crowd]:
    """The first world of a `contest`: the world that records what all of the policies read, and its crowd."""
    counts = _counts(policies, shares, check_count("cells", cells))
    views, together = _views(world, policies)
    return together, Crowd(list(policies), views, _seats(counts))


def race_in(world: World) -> World:
    """The world; where nobody races there, one with a race that the first arrival ends, and in which all
    decide at the same moments."""
    if world.first_arrivals is not None:
        return world
    rule = world.interval_rule if len(set(world.intervals)) == 1 else "common"
    return world.replace(first_arrivals=1, interval_rule=rule)


def _counts(
    policies: Mapping[str, AnyPolicy], shares: Mapping[str, float] | None, cells: int
) -> tuple[int, ...]:
    """How many cells each policy steers: its share, and what rounding leaves to the largest remainders."""
    for name, policy in policies.items():
        check_policy(name, policy)
        if is_continuous(policy):
            raise ValueError(f"policy {name!r} must take actions in a contest, got {policy!r}")
    if len(policies) < 2:
        raise ValueError(f"policies must be at least two, got {list(policies)}")
    shares = dict.fromkeys(policies, 1.0) if shares is None else shares
    if set(shares) != set(policies):
        raise ValueError(f"shares must be of {', '.join(policies)}, got {', '.join(map(str, shares))}")
    given = [check_number(f"share of {name!r}", shares[name], above=0.0) for name in policies]
    exact = np.array(given) / sum(given) * cells
    counts = np.floor(exact + 1e-9).astype(int)
    counts[np.argsort(counts - exact, kind="stable")[: cells - counts.sum()]] += 1
    if counts.min() < 1:
        raise ValueError(f"shares must leave every policy a cell of {cells}, got {dict(shares)}")
    return tuple(counts.tolist())


def _seats(counts: Sequence[int]) -> np.ndarray:
    """Which policy has each seat (cells,): the one furthest behind its share; they repeat with a turn."""
    times = math.gcd(*counts)
    each = np.array(counts) // times
    dealt = np.zeros(len(each), int)
    seats = []
    for i in range(int(each.sum())):
        chosen = int(np.argmax(each * (i + 1) / each.sum() - dealt))
        dealt[chosen] += 1
        seats.append(chosen)
    return np.array(seats * times)


# --- what each policy sees ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Together:
    """A sensor that records what several do: once what all records begin with, then what each adds."""

    sensors: tuple[Sensor, ...]
    name = "together"

    @property
    def names(self) -> Sequence[str]:
        further = (f"{i}_{name}" for i, each in enumerate(self.sensors) for name in each.names[2:])
        return *Memory.names, *further

    @property
    def needs_time(self) -> bool:
        return any(getattr(each, "needs_time", False) for each in self.sensors)

    @property
    def senses_others(self) -> bool:
        return any(getattr(each, "senses_others", False) for each in self.sensors)

    def record(self, world: World, time: Array, situation: Situation) -> Sequence[Array]:
        records = [tuple(each.record(world, time, situation)) for each in self.sensors]
        return *records[0][:2], *(number for record in records for number in record[2:])

    def bounds(self, world: World) -> Sequence[float]:
        bounds = [tuple(each.bounds(world)) for each in self.sensors]
        return *bounds[0][:2], *(number for each in bounds for number in each[2:])

    def columns(self, sensor: Sensor) -> list[int]:
        """Where the numbers of one of the sensors stand in a record."""
        place = self.sensors.index(sensor)
        first = 2 + sum(len(each.names) - 2 for each in self.sensors[:place])
        return [0, 1, *range(first, first + len(sensor.names) - 2)]


class _View(NamedTuple):
    """A policy, and the world as it looks to it."""

    policy: AnyPolicy
    world: World
    columns: list[int]  # of a record, those that it reads

    def of(self, state: State) -> State:
        return state._replace(memory=state.memory[..., self.columns])


@dataclass(frozen=True)
class Crowd:
    """Several policies as one, which carries what each of them does."""

    names: Sequence[str]
    views: Sequence[_View]
    steered_by: np.ndarray  # (cells,) or (worlds, cells) number of the policy

    def begin(self, world: World, state: State) -> list[Any]:
        return [begin(view.policy, view.world, view.of(state)) for view in self.views]

    def act_carrying(
        self, world: World, state: State, uniform: Array, carry: list[Any]
    ) -> tuple[Array, list[Any]]:
        action, carries = np.zeros(self.steered_by.shape, np.int64), []
        for i, (view, held) in enumerate(zip(self.views, carry, strict=True)):
            chosen, held = decide(view.policy, view.world, view.of(state), uniform, held)
            action = np.where(self.steered_by == i, chosen, action)
            carries.append(held)
        return action, carries


def _views(world: World, policies: Mapping[str, AnyPolicy]) -> tuple[list[_View], World]:
    """How the world looks to each policy, and the world that records what all of them read."""
    worlds = []
    for name, policy in policies.items():
        try:
            needed = getattr(policy, "sensor", None)
            sensor = world.sensor if needed is None else SENSORS.make(needed)
            seen = world if sensor == world.sensor else world.replace(sensor=sensor)
            if hasattr(policy, "check_fits"):
                policy.check_fits(seen)
        except (TypeError, ValueError) as error:
            kind = TypeError if isinstance(error, TypeError) else ValueError
            raise kind(f"policy {name!r} must be able to steer cells of this world: {error}") from None
        worlds.append(seen)
    sensors = [seen.sensor for seen in worlds]
    together = _Together(tuple(each for i, each in enumerate(sensors) if each not in sensors[:i]))
    pairs = zip(policies.values(), worlds, strict=True)
    views = [_View(policy, seen, together.columns(seen.sensor)) for policy, seen in pairs]
    return views, worlds[0] if len(together.sensors) == 1 else world.replace(sensor=together)


# --- the race -----------------------------------------------------------------------------------------------


def _race(
    world: World,
    crowd: Crowd,
    seed: int,
    episodes: np.ndarray,
    progress: Progress | None,
) -> dict[str, np.ndarray]:
    """What is told of each cell (worlds, cells) at the end of all lives."""
    starts = draw_worlds(world, crowd.steered_by.shape[1], seed, episodes.tolist())
    gain = np.zeros(crowd.steered_by.shape)
    for done, moment in enumerate(rollout(world, crowd, starts, seed, episode=episodes)):
        state = moment.state
        if moment.outcome is not None:
            gain = np.where(moment.alive, moment.outcome.gain, gain)  # others may eat where a cell has died
        if progress is not None:
            progress(done / world.max_decisions)
    if not np.all(np.isfinite(gain)):
        raise ValueError("gains must be finite, got NaN: check what the field and the flow return")
    found = {"winner": world.won(state), "arrival_time": state.arrival_time, "gain": gain}
    return found if state.medium is None else {**found, "eaten": state.medium.eaten}


def _dataset(
    world: World,
    names: list[str],
    counts: Sequence[int],
    steered_by: np.ndarray,
    turns: np.ndarray,
    ended: dict[str, np.ndarray],
    seed: int,
) -> xr.Dataset:
    import xarray as xr

    won = [(ended["winner"] & (steered_by == i)).sum(axis=-1) for i in range(len(names))]
    wins = np.stack([np.bincount(turns, each).astype(int) for each in won])
    found = np.array([share_interval(each, wins.sum(axis=0)) for each in wins])
    by_cell = ("world", "cell")
    variables: dict[str, tuple[Any, np.ndarray, str, str]] = {
        "won": ("policy", found[:, 0], "share of all wins", ""),
        "won_interval": (("policy", "bound"), found[:, 1:], "95% interval of it, over turns", ""),
        "crowd": ("policy", np.array(counts) / sum(counts), "share of the cells", ""),
        "turn": ("world", turns.astype(np.int32), "worlds of a turn have the same starts", ""),
        "steered_by": (by_cell, steered_by.astype(np.int32), "number of the policy", ""),
    }
    about = {
        "winner": ("whether it arrived in time", ""),
        "arrival_time": ("arrival at the egg", in_units("time", world.units)),
        "gain": ("c(end of life) − c(0)", "concentration"),
        "eaten": ("eaten of the medium", "amount"),
    }
    variables |= {name: (by_cell, values, *about[name]) for name, values in ended.items()}
    numbers = [np.arange(size, dtype=np.int32) for size in steered_by.shape]
    return xr.Dataset(
        {name: (*placed, labels(units, told)) for name, (*placed, told, units) in variables.items()},
        {"policy": names, "bound": ["low", "high"], **dict(zip(by_cell, numbers, strict=True))},
        {
            "title": "Contest: several policies in the same worlds, each steering a share of the cells",
            **origin(world, seed),
        },
    )


def table(results: xr.Dataset) -> Table:
    """A row per policy, who won most first."""
    rows = []
    order = np.argsort(-results["won"].values, kind="stable")
    for i in order.tolist():
        mine = results["steered_by"] == i
        came = mine & np.isfinite(results["arrival_time"])
        low, high = results["won_interval"].values[i].tolist()
        share = float(results["won"][i])
        rows.append(
            [
                str(results["policy"].values[i]),
                percent(float(results["crowd"][i])),
                None if np.isnan(share) else percent(share),
                None if np.isnan(low) else f"{percent(low)} … {percent(high)}",
                int((results["winner"] & mine).sum()),
                f"{float(results['gain'].where(mine).mean()):.2f}",
                f"{int(came.sum())}/{int(mine.sum())}",
                f"{float(results['arrival_time'].where(came).mean()):.1f}" if came.any() else None,
            ]
        )
    headings = ["policy", "of the crowd", "of the wins", "95% interval", "wins", "gain"]
    return Table([*headings, "arrived", "time to egg"], rows)
