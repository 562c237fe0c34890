"""The mesh of a medium, and the kernel δ_h by which its nodes and the cells see each other.

Nodes are the centres of meshes: node i of an axis of n lies at origin + (i + ½) h, periodic or not. A
B-spline gives each cell weights of the nodes around it, which sum to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, is_numpy_or_torch, join, namespace

Array = Any
Box = tuple[tuple[float, float], tuple[float, float]]

WIDTHS = {"linear": 2, "cubic": 4}  # nodes of a kernel per axis


class Footprint(NamedTuple):
    """The k = (2 or 4)² nodes that each cell sees, one cell's after the other's."""

    index: Array  # (..., cells · k) in the flattened grid
    weight: Array  # (..., cells · k), sum 1 over the nodes of a cell
    place: Array  # (..., cells · k, 2) [length]; on a torus that image of the node which is near the cell
    cells: int

    def by_cell(self, numbers: Array) -> Array:
        """Sums (..., cells) of numbers (..., cells · k) over each cell's nodes."""
        xp = namespace(numbers)
        return xp.sum(xp.reshape(numbers, (*numbers.shape[:-1], self.cells, -1)), axis=-1)

    def read(self, grid: Array) -> Array:
        """What a grid (..., nx, ny) holds at the nodes (..., cells · k)."""
        xp = namespace(grid)
        return xp.take_along_axis(xp.reshape(grid, (*grid.shape[:-2], -1)), self.index, axis=-1)


@dataclass(frozen=True)
class Mesh:
    """`shape` nodes in a `box`. The grid's low corner, its `origin` (..., 2), may move."""

    box: Box  # [length]
    shape: tuple[int, int]  # nodes (nx, ny)
    periodic: bool  # what passes an edge comes in at the other; else nothing passes
    endless: bool  # the box is a torus for cells too
    kernel: str

    @cached_property
    def size(self) -> tuple[float, float]:
        """Width and height of the box [length]."""
        (left, right), (bottom, top) = self.box
        return right - left, top - bottom

    @cached_property
    def spacing(self) -> tuple[float, float]:
        """h along x and y [length]."""
        return self.size[0] / self.shape[0], self.size[1] / self.shape[1]

    def corner(self, like: Array) -> Array:
        """Low corner (2,) of the box."""
        return as_array(np.array([low for low, _ in self.box]), like)

    def coordinates(self, origin: Array) -> tuple[Array, Array]:
        """x (..., nx) and y (..., ny) of the nodes."""
        x, y = (
            origin[..., axis, None] + as_array((np.arange(n) + 0.5) * h, origin)
            for axis, (n, h) in enumerate(zip(self.shape, self.spacing, strict=True))
        )
        return x, y

    def places(self, origin: Array) -> Array:
        """Positions (..., nx · ny, 2) of all nodes."""
        x, y = self.coordinates(origin)
        return _pairs(x, y)

    def inside(self, position: Array, origin: Array) -> Array:
        """Whether `position` (..., cells, 2) lies in the box; on a torus everything does."""
        if self.endless:
            return position[..., 0] == position[..., 0]
        x, y = (position[..., axis] - origin[..., axis, None] for axis in (0, 1))
        return (x >= 0) & (x <= self.size[0]) & (y >= 0) & (y <= self.size[1])

    def footprint(self, position: Array, origin: Array) -> Footprint:
        """What cells at `position` (..., cells, 2) see; outside the box what is nearest within."""
        (row, weight_x, x), (column, weight_y, y) = (
            self._along(axis, position[..., axis], origin[..., axis, None]) for axis in (0, 1)
        )
        xp, flat = namespace(position), (*position.shape[:-2], -1)
        index = xp.reshape(row[..., :, None] * self.shape[1] + column[..., None, :], flat)
        weight = xp.reshape(weight_x[..., :, None] * weight_y[..., None, :], flat)
        place = xp.reshape(_pairs(x, y), (*flat, 2))
        return Footprint(index, weight, place, position.shape[-2])

    def _along(self, axis: int, x: Array, low: Array) -> tuple[Array, Array, Array]:
        """Numbers, weights and places (..., cells, width) of the nodes along an axis."""
        xp, nodes, spacing = namespace(x), self.shape[axis], self.spacing[axis]
        at = (x - low) * (1 / spacing) - 0.5  # in nodes
        if not self.endless:
            at = xp.clip(at, -0.5, nodes - 0.5)
        first, width = xp.floor(at), WIDTHS[self.kernel]
        weight = (_linear if self.kernel == "linear" else _cubic)(at - first)
        whole = xp.int64 if is_numpy_or_torch(first) else xp.asarray(0).dtype  # jax knows none but its own
        steps = as_array(np.arange(width) - (width // 2 - 1), x, dtype=whole)
        near = number = xp.astype(first, whole)[..., None] + steps
        if self.periodic:
            number = number % nodes
        else:  # a wall is a mirror
            number = xp.where(number < 0, -1 - number, number)
            near = number = xp.where(number >= nodes, 2 * nodes - 1 - number, number)
        return number, weight, low[..., None] + (xp.astype(near, x.dtype) + 0.5) * spacing

    def centred(self, origin: Array, position: Array, alive: Array) -> tuple[Array, tuple[Array, Array]]:
        """The low corner (..., 2) with the living cells' mean within half a node of the middle, and the nodes
        (...) that it moves by along each axis."""
        xp = namespace(position)
        counted = xp.astype(alive, position.dtype)
        number = xp.sum(counted, axis=-1)
        corner, moves = [], []
        for axis, (h, size) in enumerate(zip(self.spacing, self.size, strict=True)):
            low = origin[..., axis]
            mean = xp.sum(position[..., axis] * counted, axis=-1) / xp.clip(number, 1, None)
            move = xp.where(number > 0, xp.round((mean - low - 0.5 * size) / h), xp.zeros_like(mean))
            corner.append(low + move * h)
            moves.append(move)
        return join(*corner), (moves[0], moves[1])


def _pairs(x: Array, y: Array) -> Array:
    """All pairs (..., n · m, 2) of the coordinates (..., n) and (..., m)."""
    xp = namespace(x)
    pair = join(*xp.broadcast_arrays(x[..., :, None], y[..., None, :]))
    return xp.reshape(pair, (*pair.shape[:-3], -1, 2))


def _linear(part: Array) -> Array:
    return join(1 - part, part)


def _cubic(part: Array) -> Array:
    rest = 1 - part
    far, farther = part * part * part / 6, rest * rest * rest / 6
    return join(farther, 2 / 3 - part * part + 3 * far, 2 / 3 - rest * rest + 3 * farther, far)
