"""Flows from data on a regular grid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm._support.arrays import Array, join
from swarm._support.checks import check_number
from swarm.physics.flows.flow import FLOWS
from swarm.physics.grids.axes import SPACING_TOLERANCE
from swarm.physics.grids.grid import Grid, Reading, read_grid
from swarm.physics.grids.interpolant import NEGLIGIBLE, Interpolant
from swarm.physics.grids.units import check_units


@FLOWS.register("gridded", data="path")
class GriddedFlow(Interpolant):
    """A flow interpolated from velocities on a regular grid with coordinates x and y: an xarray Dataset, a
    NetCDF-4 file, or bare arrays by name.

    `edges` to `outside_time`, `sha256` and `shape` are those of `GriddedField`. `velocity` names the
    variables of u_x and u_y; `spin` that of the angular velocity ω₀, half the vorticity, which is otherwise
    found by differentiation: of the interpolant where that is cubic; where it is linear, of the values by
    central differences. Without scales, u₀ and the spin's scale are measured: the largest on the grid; of a
    flow that does not spin the spin's is 1. Paths keep the world's tolerance where the interpolation is
    cubic; a linear one has kinks at the grid lines, and data in time have some at their times.
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
        velocity: Sequence[str] = ("u_x", "u_y"),
        spin: str | None = None,
        speed_scale: float | None = None,
        spin_scale: float | None = None,
        sha256: str | None = None,
        shape: Sequence[int] | None = None,
    ) -> None:
        if len(velocity) != 2 or isinstance(velocity, str):
            raise ValueError(f"velocity must be the names of two variables, got {velocity!r}")
        names = [*velocity, *([] if spin is None else [spin])]
        reading = Reading(edges, interpolation, period, spacing_tolerance, fill, outside_time).checked()
        grid = read_grid(data, names, reading, sha256)
        self.length_unit = check_units(grid.units, velocity, spin)
        self._differentiates = spin is None and interpolation == "cubic"
        further = [_central_spin(grid)] if spin is None and interpolation == "linear" else []
        super().__init__(grid, reading, shape, *further)
        at_points, slope_x, slope_y = self.spline.at_points()
        spins = 0.5 * (slope_x[1] - slope_y[0]) if self._differentiates else at_points[2]
        fastest = float(np.hypot(*at_points[:2])[..., grid.known].max())
        strongest = float(np.abs(spins[..., grid.known]).max())
        # what rounding leaves of a flow that does not spin is no spin
        self._spins = strongest > NEGLIGIBLE * fastest / min(grid.lattice.spacing)
        sizes, slopes = self.spline.bounds(of=_speed_and_spin)
        self.max_speed = float(sizes[0])
        spin_bound = 0.5 * (slopes[1, 0] + slopes[0, 1]) if self._differentiates else sizes[1]
        self.max_spin = float(spin_bound) if self._spins else 0.0
        self.max_shear = float(slopes[:2].max())
        self.speed_scale = check_number(
            "speed_scale", fastest if speed_scale is None else speed_scale, above=0.0
        )
        measured = strongest if self._spins else 1.0
        self.spin_scale = check_number(
            "spin_scale", measured if spin_scale is None else spin_scale, at_least=0.0
        )
        self._numbers = {"velocity": velocity, "spin": spin}
        self._numbers |= {"speed_scale": self.speed_scale, "spin_scale": self.spin_scale}

    def velocity_and_spin(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """u_x, u_y and ω₀ (...) at the places (x, y)."""
        x, y, moment = self._moment(x, y)
        if not self._differentiates:
            u_x, u_y, spin = self.spline(x, y, moment)
        elif self._spins:
            values, slope_x, slope_y = self.spline.with_slopes(x, y, moment)
            u_x, u_y, spin = values[0, ...], values[1, ...], 0.5 * (slope_x[1, ...] - slope_y[0, ...])
        else:
            (u_x, u_y), spin = self.spline(x, y, moment), x
        return u_x, u_y, spin if self._spins else 0.0 * spin

    def velocity(self, position: Array) -> Array:
        values = self.spline(*self._places(position))
        return join(values[0], values[1])

    def spin(self, position: Array) -> Array:
        return self.velocity_and_spin(position[..., 0], position[..., 1])[2]


def _speed_and_spin(values: np.ndarray) -> np.ndarray:
    """|u| and, where they are there, |ω₀| from (u_x, u_y, ω₀)."""
    return np.stack([np.hypot(values[0], values[1]), *np.abs(values[2:])])


def _central_spin(grid: Grid) -> np.ndarray:
    """Half the vorticity (times, nx, ny) at the grid's points by central differences, of second order at
    edges too."""

    def slope(values: np.ndarray, axis: int) -> np.ndarray:
        spacing, points = grid.lattice.spacing[axis], axis + 1
        if grid.lattice.periodic[axis]:
            return (np.roll(values, -1, points) - np.roll(values, 1, points)) / (2 * spacing)
        order: Any = 2 if values.shape[points] > 2 else 1
        return np.gradient(values, spacing, axis=points, edge_order=order)

    return 0.5 * (slope(grid.values[1], 0) - slope(grid.values[0], 1))
