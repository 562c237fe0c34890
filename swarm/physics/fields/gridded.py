"""Fields from data on a regular grid."""

from __future__ import annotations

import functools
import operator
from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm._support.arrays import Array
from swarm._support.checks import check_number, check_point
from swarm.physics.fields.field import FIELDS, warn_of_scale
from swarm.physics.grids.axes import SPACING_TOLERANCE
from swarm.physics.grids.grid import Reading, read_grid
from swarm.physics.grids.interpolant import NEGLIGIBLE, Interpolant
from swarm.physics.grids.units import check_units
from swarm.physics.motion.arc import components


@FIELDS.register("gridded", data="path")
class GriddedField(Interpolant):
    """A concentration field interpolated from values on a regular grid with coordinates x and y, in space z:
    an xarray Dataset or DataArray, a NetCDF-4 file, or bare arrays by name (values over (x, y[, z]), or
    (time, x, y[, z])).

    `edges`, of all axes or each (`("periodic", "clamped")`, or by name), says what lies beyond the grid:
    "periodic", it repeats, after `period` [length] where that is stated (here, or as the attribute `period`
    or `modulo` of a coordinate), else one spacing after its last point; "clamped", it ends there, and a cell
    that leaves is truncated. `interpolation` is "cubic" (smooth, fourth order) or "linear" (second). Points
    may be off by `spacing_tolerance` of the spacing. `fill` says what holes in the data (NaN) are: "inside",
    outside the domain; "nearest", as the nearest value; "zero". Data with an axis `time` are linear in time;
    `outside_time` says what holds outside it, "held" or an "error", and `at(time)` is the field at a time.

    Without a `gradient_scale` c_k is measured: the root mean square of |∇c| over the grid (and time); one
    that is off from it by more than twice is warned of.
    `variable` may be left out where the data hold only one. `sha256` and `shape`, as runs and results record
    them, must be those of the data and their grid. Raises TypeError, ValueError or OSError that names the
    variable, the rule and the value.
    """

    def __init__(
        self,
        data: Any,
        *,
        edges: Any,
        interpolation: str = "cubic",
        period: Any = None,
        spacing_tolerance: float = SPACING_TOLERANCE,
        fill: str | None = None,
        outside_time: str | None = None,
        variable: str | None = None,
        gradient_scale: float | None = None,
        egg_position: tuple[float, ...] = (0.0, 0.0),
        egg_radius: float | None = None,
        sha256: str | None = None,
        shape: Sequence[int] | None = None,
    ) -> None:
        names = None if variable is None else [variable]
        reading = Reading(edges, interpolation, period, spacing_tolerance, fill, outside_time)
        grid = read_grid(data, names, reading, sha256)
        super().__init__(grid, shape)
        self.length_unit = check_units(grid.units)
        _, *slopes = self.spline.at_points()
        squares = [slope**2 for slope in slopes]
        measured = float(np.sqrt(np.mean(functools.reduce(operator.add, squares)[..., grid.known])))
        has_gradient = measured > NEGLIGIBLE * np.abs(grid.values).max() / min(grid.lattice.spacing)
        if gradient_scale is None:
            if not has_gradient:
                raise ValueError("gradient_scale must be given where the field has no gradient, got None")
            gradient_scale = measured
        self.gradient_scale = check_number("gradient_scale", gradient_scale, above=0.0)
        if has_gradient:
            warn_of_scale(self.gradient_scale, measured, "over the grid")
        _, bounds = self.spline.bounds()
        self.max_gradient = float(functools.reduce(np.hypot, bounds[0]))
        if grid.times is not None:
            self.max_rate = float(self.spline.rates(grid.times)[0])
        self.egg_position = check_point("egg_position", egg_position)
        self.egg_radius = None if egg_radius is None else check_number("egg_radius", egg_radius, above=0.0)
        self._numbers = {"variable": grid.names[0], "gradient_scale": self.gradient_scale}
        self._numbers |= {"egg_position": self.egg_position, "egg_radius": self.egg_radius}

    def concentration(self, position: Array) -> Array:
        return self.spline(*self._places(*components(position)))[0]
