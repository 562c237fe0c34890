"""Neighbours: the pairs of cells within a distance, in time that grows with the number of cells alone."""

from __future__ import annotations

from typing import Any, NamedTuple

from swarm._support.arrays import Array, added_up, is_numpy_or_torch, namespace
from swarm._support.compiler import NUMBA, call_outside, compiling, loops_on, outside
from swarm.physics.crowd.interactions import Dipole, Interaction, Pairwise

MANY = 256  # cells of a world from which on an interaction of finite reach goes through lists of neighbours


class Pairs(NamedTuple):
    """Pairs of cells that may interact, each in both directions."""

    receiver: Array  # (2 · pairs,) row of the cell that is moved
    maker: Array  # (2 · pairs,) row of the cell that moves it

    def drift(
        self, interaction: Any, x: Array, y: Array, heading: tuple[Array, Array]
    ) -> tuple[Array, Array, Array]:
        """u_x, u_y and spin like x, y and the components of the heading, all (nodes, ..., cells)."""
        xp, shape = namespace(x), x.shape
        x, y, ahead, aside = (xp.reshape(each, (shape[0], -1)) for each in (x, y, *heading))
        apart = (each[:, self.receiver] - each[:, self.maker] for each in (x, y))
        found = interaction.between(*apart, ahead[:, self.maker], aside[:, self.maker])
        index = xp.broadcast_to(self.receiver, (shape[0], self.receiver.shape[0]))
        u, v, spin = (xp.reshape(added_up(each, index, x.shape[1]), shape) for each in found)
        return u, v, spin


class Everyone(NamedTuple):
    """All pairs of the cells of a world, one after the other on the processor."""

    number: int  # by which `call_outside` knows the sum
    alive: Array  # (..., cells)

    def drift(
        self, interaction: Any, x: Array, y: Array, heading: tuple[Array, Array]
    ) -> tuple[Array, Array, Array]:
        """As of `Pairs`."""
        xp, rows = namespace(x), (-1, x.shape[-1])
        alive, *poses = (xp.reshape(each, rows) for each in (self.alive, x, y, *heading))
        found = call_outside(self.number, (3, *poses[0].shape), x, alive, *poses)
        found = xp.reshape(found, (3, *x.shape))
        return found[0, ...], found[1, ...], found[2, ...]


Together = Pairs | Everyone | None  # who interacts: some, all pair by pair, or all as the interaction finds


def summed(interaction: Interaction) -> int | None:
    """The number by which `Everyone` knows an interaction that loops sum up; None if there are none."""
    if not NUMBA or not isinstance(interaction, Dipole) or interaction.cutoff is not None:
        return None
    from swarm.physics.crowd.sums import Sums

    return outside(Sums(interaction))


def everyone(number: int | None, position: Array, alive: Array) -> Everyone | None:
    """All pairs where loops can sum them up: NumPy, or a tensor in the processor's memory."""
    return None if number is None or not loops_on(position) else Everyone(number, alive)


def neighbours(interaction: Interaction, position: Array, far: Array, alive: Array) -> Pairs | None:
    """The pairs that may come within an interaction's reach while cells come nearer by `far` (..., cells)
    [length]; None where all pairs are to be taken: few cells, no finite reach, jax, or while torch compiles.
    """
    reach = interaction.reach if isinstance(interaction, Pairwise) else None
    listed = is_numpy_or_torch(position) and not compiling(position)
    if reach is None or not listed or alive.shape[-1] < MANY:
        return None
    xp = namespace(position)
    worlds = -1, alive.shape[-1]
    margin = float(xp.max(xp.abs(far)))
    first, second = near_pairs(xp.reshape(position, (*worlds, 2)), reach + margin, xp.reshape(alive, worlds))
    return Pairs(xp.concat([first, second]), xp.concat([second, first]))


def near_pairs(position: Array, reach: float, alive: Array) -> tuple[Array, Array]:
    """Both rows (pairs,) of every pair of living cells of the same world that are within `reach` [length].

    `position` (worlds, cells, 2) [length], `alive` (worlds, cells) bool; rows count through all worlds, and
    every pair is there once. NumPy and torch only: how many pairs there are depends on the data. Cells are
    sorted by squares as wide as `reach`; neighbours are in the same square or one beside it.
    """
    xp = namespace(position)
    worlds, cells = alive.shape
    row = xp.nonzero(xp.reshape(alive, (-1,)))[0]
    place = xp.reshape(position, (-1, 2))[row, ...]
    low = xp.min(place, axis=0) if row.shape[0] else place
    square = xp.astype(xp.floor((place - low) / reach), xp.int64) + 1
    width, height = (int(xp.max(square[:, axis])) + 2 if row.shape[0] else 1 for axis in (0, 1))
    if worlds * width * height > 2**62:
        raise ValueError(f"cells must lie within {2**62} squares of {reach:g}, got {worlds * width * height}")
    key = (row // cells * width + square[:, 0]) * height + square[:, 1]
    order = xp.argsort(key)
    key, row, place = key[order], row[order], place[order, ...]
    places = xp.arange(row.shape[0], device=row.device)
    firsts, seconds = [], []
    for over, up in ((0, 0), (0, 1), (1, -1), (1, 0), (1, 1)):
        wanted = key + (over * height + up)
        begin = places + 1 if over == up == 0 else xp.searchsorted(key, wanted)
        count = xp.searchsorted(key, wanted, side="right") - begin
        first = xp.repeat(places, count)
        offset = xp.repeat(begin - (xp.cumulative_sum(count) - count), count)
        second = xp.arange(first.shape[0], device=row.device) + offset
        apart = place[first, ...] - place[second, ...]
        close = xp.nonzero(apart[:, 0] ** 2 + apart[:, 1] ** 2 <= reach**2)[0]
        firsts.append(row[first[close]])
        seconds.append(row[second[close]])
    return xp.concat(firsts), xp.concat(seconds)
