"""Starts: the poses and pasts that cells begin with, and the noise of their lives, drawn cell by cell."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from swarm._support import streams
from swarm._support.checks import check_count
from swarm.physics.world import World

NOISE_BLOCK = 64  # decisions whose random numbers are drawn at once, everywhere
_ATTEMPTS = 1000


class Starts(NamedTuple):
    """What a life begins with; every policy can be given the same."""

    position: np.ndarray  # (cells, 2) [length]; in space (cells, 3)
    heading: np.ndarray  # (cells,) in [−π, π) [rad]; in space frames (cells, 4), unit quaternions
    past: np.ndarray  # (cells, N_T) actions, newest first


class SpreadStarts(NamedTuple):
    """What a life begins with in a world whose cells are not alike: `Starts`, and what each cell is."""

    position: np.ndarray
    heading: np.ndarray
    past: np.ndarray
    factors: np.ndarray  # (cells, 2) of speed and curvature


def cells_of(starts: Starts) -> tuple[int, ...]:
    """The shape (..., cells) of starts."""
    return starts.position.shape[:-1]


def draw_starts(
    world: World,
    cells: int,
    seed: int,
    *,
    population: streams.Population = "test",
    episode: int = 0,
    first: int = 0,
) -> Starts:
    """Starts uniform in the world's box and in heading, in space over all rotations, with a random past, in
    float64; those of the cells from the `first` of a population on.

    Poses are the same for every N_T. Starts within reach of the egg or outside the domain are drawn again; a
    past that leaves the domain is cut short, see `World.start`. Raises ValueError where the box leaves no
    room.
    """
    check_count("cells", cells)
    streams.check_seed(seed)

    where: Any = {"population": population, "episode": episode, "first": first}
    drawn: Any = functools.partial(_drawn, seed, cells, **where)
    pose, axes = functools.partial(_draw_poses, world), world.dimensions
    poses = drawn("start", pose)
    for attempt in range(1, _ATTEMPTS):
        taken = _in_egg(world, poses[:, :axes])
        for inside in world.domains:
            taken = taken | ~np.asarray(inside(poses[:, :axes]))
        if not taken.any():
            break
        poses = np.where(taken[:, None], drawn("start", pose, attempt), poses)
    else:
        rule = "outside the egg (position, radius)" if world.egg else "in the domain of field and flow, egg"
        raise ValueError(f"start_box must leave room {rule} = {world.egg}, got {world.box}")
    records, actions = world.n_records, world.n_actions
    past = drawn("past", lambda generator, rows: generator.integers(actions, size=(rows, records)))
    heading = poses[:, 2].copy() if axes == 2 else _rotations(poses[:, axes:])
    starts = Starts(poses[:, :axes].copy(), heading, past)
    if world.spread is None:
        return starts
    normal = drawn("spread", lambda generator, rows: generator.standard_normal((rows, 2)))
    return cast(Starts, SpreadStarts(*starts, world.spread.factors(normal)))  # a tuple cannot grow


def draw_worlds(
    world: World,
    cells: int,
    seed: int,
    episodes: Sequence[int],
    *,
    population: streams.Population = "test",
    first: int = 0,
) -> Starts:
    """Starts (worlds, cells, …) of several worlds, each of the episode that is named; in each those of the
    cells from the `first` on.
    """
    which: Any = {"population": population, "first": first}
    drawn = [draw_starts(world, cells, seed, episode=each, **which) for each in episodes]
    return type(drawn[0])(*(np.stack(parts) for parts in zip(*drawn, strict=True)))


def draw_shared(
    world: World,
    cells: int,
    seeds: Sequence[int],
    episode: np.ndarray,
    chosen: np.ndarray,
    *,
    population: streams.Population = "test",
    first: int = 0,
) -> dict[str, np.ndarray]:
    """What `World.start` takes (worlds, cells, …) where the worlds are shared out evenly among `seeds`, block
    after block: world w of a block has rows `first` + w · cells … of its seed's `episode` (worlds,). Worlds
    that are not `chosen` (worlds,) bool get the starts of one that is.
    """
    found: dict[str, np.ndarray] = {}
    blocks = np.split(np.arange(len(episode)), len(seeds))
    for seed, block in zip(seeds, blocks, strict=True):
        for number in np.unique(episode[block[chosen[block]]]).tolist():
            members = block[chosen[block] & (episode[block] == number)]
            where: dict[str, Any] = {"population": population, "episode": number, "first": first}
            drawn = draw_starts(world, len(block) * cells, seed, **where)._asdict()
            noise = draw_record_noise(world, len(block) * cells, seed, **where)
            drawn |= {} if noise is None else {"noise": noise}
            for name, part in drawn.items():
                rows = part.reshape(len(block), cells, *part.shape[1:])
                whole = found.setdefault(
                    name, np.broadcast_to(rows[:1], (len(episode), *rows.shape[1:])).copy()
                )
                whole[members] = rows[members - block[0]]
    return found


def noise_of(world: World) -> Callable[..., np.ndarray]:
    """What draws the numbers (cells, decisions, channels) that `World.step` takes as noise."""
    return draw_noise if world.binding_rate is None else draw_noise_and_bindings


def draw_record_noise(world: World, cells: int, seed: int, **where: Any) -> np.ndarray | None:
    """Standard normal numbers (cells, N_T) for the records that a life begins with; None where they are
    exact. `where` is the population, the episode and the `first` cell, as for `draw_starts`.
    """
    if world.concentration_noise == 0:
        return None
    records = world.n_records
    return _drawn(
        seed, cells, "records", lambda chance, rows: chance.standard_normal((rows, records)), **where
    )


def draw_noise(seed: int, cells: int, decisions: int, *, block: int = 0, **where: Any) -> np.ndarray:
    """Standard normal numbers (cells, decisions, 3) for the world's perturbations, of one block of an
    episode's decisions; `where` as for `draw_record_noise`.
    """
    size = decisions, 3
    return _drawn(
        seed, cells, "noise", lambda chance, rows: chance.standard_normal((rows, *size)), block, **where
    )


def draw_noise_and_bindings(seed: int, cells: int, decisions: int, **block: Any) -> np.ndarray:
    """`draw_noise`, and numbers in [0, 1) of a stream of their own that decide how many molecules bind."""
    uniform = draw_chance(seed, cells, decisions, purpose="bindings", **block)
    return np.concatenate([draw_noise(seed, cells, decisions, **block), uniform[..., None]], axis=-1)


def draw_chance(
    seed: int,
    cells: int,
    decisions: int,
    *,
    purpose: streams.Purpose = "policy",
    block: int = 0,
    **where: Any,
) -> np.ndarray:
    """Numbers (cells, decisions) in [0, 1) for policies that leave something to chance, as `draw_noise`."""
    return _drawn(seed, cells, purpose, lambda chance, rows: chance.random((rows, decisions)), block, **where)


def _drawn(
    seed: int,
    cells: int,
    purpose: streams.Purpose,
    draw: Callable[[np.random.Generator, int], np.ndarray],
    *index: int,
    population: streams.Population = "test",
    episode: int = 0,
    first: int = 0,
) -> np.ndarray:
    return streams.by_cell(draw, cells, population, purpose, seed, episode, *index, first=first)


class Draws:
    """The random numbers of every decision, drawn by `draw_noise` or `draw_chance` a block at a time.

    Cells are (groups, ...): those of a group live in step, and the groups are shared out evenly among the
    `seeds`, whose rows from the `first` on they take one after the other. Numbers depend on nothing but what
    is asked for, so copies of whoever asks may share them. `place` takes a whole block to where it is needed,
    a device for instance.
    """

    def __init__(
        self,
        draw: Callable[..., np.ndarray],
        cells: tuple[int, ...],
        seeds: Sequence[int],
        *,
        population: streams.Population = "test",
        first: int = 0,
        dtype: Any = np.float64,
        place: Callable[[np.ndarray], Any] = np.asarray,
    ) -> None:
        self._draw, self._population, self._dtype, self._place = draw, population, dtype, place
        self._cells, self._seeds, self._first = cells, tuple(seeds), first
        groups = cells[0] // len(self._seeds)  # of each seed
        self._seed, self._group = np.divmod(np.arange(cells[0]), groups)
        self._keys = np.full((cells[0], 3), -1)  # seed, episode and block of the numbers that are at hand
        self._numbers = np.empty(0)
        self._placed: Any = None

    def at(self, episode: np.ndarray | int, decision: np.ndarray | int) -> Any:
        """Numbers (groups, ..., k) of each group's `decision` (groups,) in its `episode` (groups,)."""
        block, turn = np.divmod(np.broadcast_to(decision, self._seed.shape), NOISE_BLOCK)
        keys = np.stack(np.broadcast_arrays(self._seed, episode, block), axis=-1)
        stale = (keys != self._keys).any(axis=-1)
        if stale.any():
            self._refill(keys, stale)
        within = (slice(None),) * (len(self._cells) - 1)
        if (turn == turn[0]).all():
            return self._placed[(slice(None), *within, int(turn[0]))]
        return self._placed[(np.arange(len(turn)), *within, turn)]

    def _refill(self, keys: np.ndarray, stale: np.ndarray) -> None:
        wanted = np.unique(keys[stale], axis=0).tolist()
        count = self._cells[0] // len(self._seeds)
        numbers = None if stale.all() else self._numbers.copy()
        for seed, episode, block in wanted:
            cells = count * math.prod(self._cells[1:])
            where = {"episode": episode, "block": block, "first": self._first}
            drawn = self._draw(self._seeds[seed], cells, NOISE_BLOCK, population=self._population, **where)
            drawn = drawn.reshape(count, *self._cells[1:], *drawn.shape[1:]).astype(self._dtype, copy=False)
            if len(wanted) == 1 and numbers is None:  # all groups are in it: nothing is copied
                numbers = drawn
                break
            if numbers is None:
                numbers = np.empty((self._cells[0], *drawn.shape[1:]), self._dtype)
            here = (keys == (seed, episode, block)).all(axis=-1)
            numbers[here] = drawn[self._group[here]]
        assert numbers is not None
        self._numbers, self._placed, self._keys = numbers, self._place(numbers), keys


def _draw_poses(world: World, generator: np.random.Generator, cells: int) -> np.ndarray:
    turns = [(-np.pi, np.pi)] if world.dimensions == 2 else 3 * [(0.0, 1.0)]
    low, high = np.array([*world.box, *turns]).T
    return low + (high - low) * generator.random((cells, len(low)))


def _rotations(numbers: np.ndarray) -> np.ndarray:
    """Unit quaternions (cells, 4), uniform over all rotations where numbers (cells, 3) are in [0, 1)
    (Shoemake 1992, Graphics Gems III, 124).
    """
    part, first, second = numbers.T
    angles, sizes = 2 * np.pi * np.stack([second, first, first, second]), np.stack([part, 1 - part])
    waves = np.stack([np.cos(angles[0]), np.sin(angles[1]), np.cos(angles[2]), np.sin(angles[3])], axis=-1)
    return waves * np.sqrt(sizes)[[0, 1, 1, 0]].T


def _in_egg(world: World, position: np.ndarray) -> np.ndarray:
    if world.egg is None:
        return np.zeros(len(position), bool)
    centre, radius = world.egg
    distance: np.ndarray = functools.reduce(np.hypot, (position - np.asarray(centre)).T)
    return distance <= radius
