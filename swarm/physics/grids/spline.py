"""Tensor-product splines through values on a regular grid, on any array library.

Linear splines are exact to second order in the spacing. Cubic ones are B-splines: twice continuously
differentiable, exact to fourth order, their derivatives to third. Control values are found once, in float64
by SciPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarm._support.arrays import Array, as_array, kept_for, namespace

DEGREES = {"linear": 1, "cubic": 3}
MIN_POINTS = {"linear": 2, "cubic": 4}
_BLOCK = 64  # lines of cells


@dataclass(frozen=True)
class Lattice:
    """Where the grid points are, and what lies beyond them."""

    origin: tuple[float, ...]  # the first point [length]
    spacing: tuple[float, ...]  # [length]
    shape: tuple[int, ...]  # points along x and y, in space z
    periodic: tuple[bool, ...]  # along each: it repeats, one spacing after its last point; else it ends

    @property
    def box(self) -> tuple[tuple[float, float], ...]:
        """((x_low, x_high), (y_low, y_high), …) of the domain: one period, or from edge to edge [length]."""
        sides = zip(self.origin, self.spacing, self.cells, strict=True)
        return tuple((low, low + cells * step) for low, step, cells in sides)

    @property
    def cells(self) -> tuple[int, ...]:
        """Grid cells along each axis."""
        return tuple(n if again else n - 1 for n, again in zip(self.shape, self.periodic, strict=True))


class Placed:
    """Arrays that are kept in the library, on the device and with the dtype of whoever asks for them."""

    def __init__(self, *arrays: np.ndarray) -> None:
        self._arrays = arrays
        self._kept: dict[Any, tuple[Array, ...]] = {}

    def like(self, like: Array) -> tuple[Array, ...]:
        """The arrays: floats with the dtype of `like`, whole numbers as int32, flags as they are."""

        def placed() -> tuple[Array, ...]:
            xp = namespace(like)
            dtypes = {"f": None, "i": xp.int32, "b": xp.bool}
            return tuple(as_array(each, like, dtype=dtypes[each.dtype.kind]) for each in self._arrays)

        return kept_for(like, self._kept, placed)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_kept": {}}


Moment = tuple[Any, Any]  # number of a grid in time, and the share of the way to the next one


class Spline:
    """Several quantities on one lattice, at one time or several, interpolated together.

    Beyond the edges of a lattice that is not periodic each quantity goes on with its value at the edge.
    """

    def __init__(self, values: np.ndarray, lattice: Lattice, interpolation: str) -> None:
        """`values` (quantities, times, nx, ny[, nz]) at the lattice's points."""
        self.lattice, self.axes = lattice, len(lattice.shape)
        self.degree = DEGREES[interpolation]
        # (quantities, times, …), along each axis with those beyond its edges
        self.coefficients = self._coefficients(np.asarray(values, np.float64))
        steps, offsets = np.arange(self.degree + 1), np.zeros(1, int)  # of a patch from its corner
        for size in self.coefficients.shape[2:]:
            offsets = (offsets[:, None] * size + steps).ravel()
        self._tables = Placed(self.coefficients.reshape(len(self.coefficients), -1), offsets)

    def _coefficients(self, values: np.ndarray) -> np.ndarray:
        """Control values, with those beyond the edges that the basis functions reach."""
        beyond = (0, 1) if self.degree == 1 else (1, 2)
        for axis, periodic in enumerate(self.lattice.periodic, 2):
            if self.degree == 3:
                values = (_periodic_control if periodic else _clamped_control)(values, axis)
        widths = [beyond if periodic else (0, 0) for periodic in self.lattice.periodic]
        return np.pad(values, [(0, 0), (0, 0), *widths], mode="wrap")

    # --- evaluation -----------------------------------------------------------------------------------------

    def __call__(self, places: Sequence[Array], moment: Moment | None = None) -> tuple[Array, ...]:
        """Each quantity (...) at the places (x, y[, z]), between two grids in time where there is a
        `moment`.
        """
        values, within = self._patches(places, moment)
        for axis in reversed(range(self.axes)):
            values = _weighted(values, self._weights(within[axis]), axis + 1)
        return tuple(values[i, ...] for i in range(values.shape[0]))

    def with_slopes(self, places: Sequence[Array], moment: Moment | None = None) -> list[Array]:
        """Quantities (quantities, ...) and their derivatives along each axis at the places (x, y[, z])."""
        patch, within = self._patches(places, moment)
        weights, slopes = [self._weights(each) for each in within], []
        for axis in reversed(range(self.axes)):
            tilted = _weighted(patch, self._slopes(within[axis], axis), axis + 1)
            for further in reversed(range(axis)):
                tilted = _weighted(tilted, weights[further], further + 1)
            slopes.append(tilted)
            patch = _weighted(patch, weights[axis], axis + 1)
        return [patch, *reversed(slopes)]

    def cell(self, places: Sequence[Array]) -> Array:
        """Number of the grid cell of each place (x, y[, z]), counted along the last axis first."""
        number = self._cell(places[0], 0)[0]
        for axis in range(1, self.axes):
            number = number * self.lattice.cells[axis] + self._cell(places[axis], axis)[0]
        return number

    def _patches(self, places: Sequence[Array], moment: Moment | None) -> tuple[Array, list[Array]]:
        """Control values (quantities, n, n[, n], ...) around each place, and the place in its cell."""
        first = places[0]
        xp = namespace(first)
        table, offsets = self._tables.like(first)
        sizes, within = self.coefficients.shape[2:], []
        corner: Array = None
        for axis, place in enumerate(places):
            cell, inside = self._cell(place, axis)
            corner = cell if corner is None else corner * sizes[axis] + cell
            within.append(inside)
        if moment is not None:
            corner = corner + moment[0] * math.prod(sizes)
        count = (self.degree + 1) ** self.axes
        index = xp.reshape(corner[None, ...] + xp.reshape(offsets, (count, *(1,) * first.ndim)), (-1,))
        patch = xp.take(table, index, axis=1)
        if moment is not None:  # its share goes with the last axes of the patches
            shape = (table.shape[0], count, *first.shape)
            later = xp.reshape(xp.take(table, index + math.prod(sizes), axis=1), shape)
            patch = xp.reshape(patch, shape)
            patch = patch + moment[1] * (later - patch)
        return xp.reshape(patch, (table.shape[0], *(self.degree + 1,) * self.axes, *first.shape)), within

    def _cell(self, place: Array, axis: int) -> tuple[Array, Array]:
        """Number of the grid cell that a coordinate lies in, and where in it, from 0 to 1."""
        xp = namespace(place)
        points = self.lattice.shape[axis]
        steps = (place - self.lattice.origin[axis]) * (1 / self.lattice.spacing[axis])
        if self.lattice.periodic[axis]:
            steps = steps - points * xp.floor(steps * (1 / points))
            last = points - 1
        else:
            steps = xp.clip(steps, 0.0, float(points - 1))
            last = points - 2
        # rounding may put a place on the end of the last cell
        cell = xp.clip(xp.floor(steps), 0.0, float(last))
        return xp.astype(cell, xp.int32), steps - cell

    def _weights(self, t: Array) -> list[Array]:
        if self.degree == 1:
            return [1 - t, t]
        s, square, cube = 1 - t, t * t, t * t * t
        middle = [0.5 * cube - square + 2 / 3, 0.5 * (square + t - cube) + 1 / 6]
        return [s * s * s * (1 / 6), *middle, cube * (1 / 6)]

    def _slopes(self, t: Array, axis: int) -> list[Array]:
        """Derivatives of the weights by the coordinate."""
        per = 1 / self.lattice.spacing[axis]
        if self.degree == 1:
            one = namespace(t).ones_like(t)
            return [-per * one, per * one]
        s, square = 1 - t, t * t
        middle = [per * (1.5 * square - 2 * t), per * (0.5 + t - 1.5 * square)]
        return [(-0.5 * per) * s * s, *middle, (0.5 * per) * square]

    # --- bounds ---------------------------------------------------------------------------------------------

    def bounds(self, *, of: Callable[[np.ndarray], np.ndarray] = np.abs) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (quantities,) of the values, by default of their size, and (quantities, axes) of the slopes'
        size, at all times.

        Each piece lies in the convex hull of its Bézier control values, and so do its derivatives in that of
        their differences. `of` maps control values (quantities, ...) to what is to be bounded, a convex
        function of them.
        """
        values, slopes, axes = [], [], tuple(range(1, self.axes + 1))
        for control in self._controls(self.coefficients):
            values.append(of(control).max(axis=axes))
            steps = [np.abs(np.diff(control, axis=axis)).max(axis=axes) for axis in axes]
            slopes.append(self.degree * np.stack(steps, axis=-1) / np.asarray(self.lattice.spacing))
        return np.max(values, axis=0), np.max(slopes, axis=0)

    def rates(self, times: np.ndarray) -> np.ndarray:
        """Bounds (quantities,) of the size of the derivatives by time, between grids at the `times`."""
        axes = tuple(range(1, self.axes + 1))
        steps = np.diff(self.coefficients, axis=1) / np.diff(times).reshape(-1, *(1,) * self.axes)
        return np.max([np.abs(control).max(axis=axes) for control in self._controls(steps)], axis=0)

    def _controls(self, coefficients: np.ndarray) -> Iterator[np.ndarray]:
        """Bézier control values (quantities, along each axis), block by block, to spare memory."""
        cells = coefficients.shape[2] - self.degree
        for time in range(coefficients.shape[1]):
            for first in range(0, cells, _BLOCK):
                block = coefficients[:, time, first : first + _BLOCK + self.degree]
                for axis in range(1, self.axes + 1):
                    block = self._bezier(block, axis)
                yield block

    def _bezier(self, control: np.ndarray, axis: int) -> np.ndarray:
        """Bézier control values along an axis: of each cell `degree` + 1, the last of one being the first of
        the next."""
        if self.degree == 1:
            return control
        c = np.moveaxis(control, axis, 0)
        thirds = [(2 * c[1:-2] + c[2:-1]) / 3, (c[1:-2] + 2 * c[2:-1]) / 3]
        points = (c[:-2] + 4 * c[1:-1] + c[2:]) / 6
        result = np.empty((3 * len(points) - 2, *c.shape[1:]))
        result[::3], result[1::3], result[2::3] = points, *thirds
        return np.moveaxis(result, 0, axis)

    def at_points(self) -> list[np.ndarray]:
        """`with_slopes` at the lattice's own points and times, (quantities, times, nx, ny[, nz]) each."""
        sides = zip(self.lattice.origin, self.lattice.spacing, self.lattice.shape, strict=True)
        x, *others = (start + step * np.arange(points) for start, step, points in sides)
        others = list(np.meshgrid(*others, indexing="ij"))
        shape = (len(self.coefficients), self.coefficients.shape[1], *self.lattice.shape)
        whole = [np.empty(shape) for _ in range(self.axes + 1)]
        for number in range(shape[1]):
            at, share = max(min(number, shape[1] - 2), 0), float(number > 0 and number == shape[1] - 1)
            moment = (at, share) if shape[1] > 1 else None
            for i, place in enumerate(x):  # line by line, to spare memory
                found = self.with_slopes([np.full_like(others[0], place), *others], moment)
                for part, each in zip(whole, found, strict=True):
                    part[:, number, i] = each
        return whole


def _weighted(patch: Array, weights: list[Array], axis: int) -> Array:
    """Σ weights · patch over `axis`, in an order that does not depend on the number of places."""
    take = (slice(None),) * axis
    total = patch[(*take, 0, ...)] * weights[0]
    for i in range(1, len(weights)):
        total = total + patch[(*take, i, ...)] * weights[i]
    return total


def _periodic_control(values: np.ndarray, axis: int) -> np.ndarray:
    """Control values c of a cubic B-spline on a ring: (c_{i−1} + 4c_i + c_{i+1})/6 = v_i."""
    from scipy.ndimage import spline_filter1d

    return spline_filter1d(values, 3, axis, mode="grid-wrap")


def _clamped_control(values: np.ndarray, axis: int) -> np.ndarray:
    """Control values c_{−1} … c_n of the cubic B-spline whose first two and last two pieces are one cubic
    each: that end condition ("not a knot") keeps the order of the interior up to the edges.

    SciPy's spline has its knots elsewhere; on evenly spaced ones c_i is v_i less a sixth of the second
    derivative.
    """
    from scipy.interpolate import make_interp_spline

    v = np.moveaxis(values, axis, 0)
    places = np.arange(len(v))
    c = v - make_interp_spline(places, v)(places, 2) / 6
    first, last = 6 * v[:1] - 4 * c[:1] - c[1:2], 6 * v[-1:] - 4 * c[-1:] - c[-2:-1]
    return np.moveaxis(np.concatenate([first, c, last]), 0, axis)
