"""Flows from data on a regular grid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm._support.arrays import Array, join
from swarm._support.checks import check_number
from swarm.physics.flows.flow import FLOWS
from swarm.physics.grids.grid import Grid, Interpolant, check_units, read_grid


@FLOWS.register("gridded", data="path")
class GriddedFlow(Interpolant):
    """A flow interpolated from velocities on a regular grid with coordinates x and y: an xarray Dataset, or
    a NetCDF-4 file.

    `edges`, `interpolation`, `sha256` and `shape` are those of `GriddedField`. `velocity` names the variables
    of u_x and u_y; `spin` that of the angular velocity ω₀, half the vorticity, which is otherwise found by
    differentiation: of the interpolant where that is cubic; where it is linear, of the values by central
    differences. Without scales, u₀ and the spin's scale are measured: the largest on the grid. Paths keep the
    world's tolerance where the interpolation is cubic; a linear one has kinks at the grid lines.
    """

    def __init__(
        self,
        data: Any,
        *,
        edges: str,
        interpolation: str = "cubic",
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
        grid = read_grid(data, names, edges=edges, interpolation=interpolation, sha256=sha256)
        self.length_unit = check_units(grid.units, velocity, spin)
        self._differentiates = spin is None and interpolation == "cubic"
        further = [_central_spin(grid)] if spin is None and interpolation == "linear" else []
        super().__init__(grid, edges, interpolation, shape, *further)
        at_points, slope_x, slope_y = self.spline.at_points()
        spins = 0.5 * (slope_x[1] - slope_y[0]) if self._differentiates else at_points[2]
        sizes, slopes = self.spline.bounds(of=_speed_and_spin)
        self.max_speed = float(sizes[0])
        self.max_spin = float(0.5 * (slopes[1, 0] + slopes[0, 1]) if self._differentiates else sizes[1])
        self.max_shear = float(slopes[:2].max())
        fastest = float(np.hypot(*at_points[:2]).max()) if speed_scale is None else speed_scale
        self.speed_scale = check_number("speed_scale", fastest, above=0.0)
        strongest = float(np.abs(spins).max()) if spin_scale is None else spin_scale
        self.spin_scale = check_number("spin_scale", strongest, at_least=0.0)
        self._numbers = {"velocity": velocity, "spin": spin}
        self._numbers |= {"speed_scale": self.speed_scale, "spin_scale": self.spin_scale}

    def velocity_and_spin(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """u_x, u_y and ω₀ (...) at the places (x, y)."""
        if not self._differentiates:
            u_x, u_y, spin = self.spline(x, y)
            return u_x, u_y, spin
        values, slope_x, slope_y = self.spline.with_slopes(x, y)
        return values[0, ...], values[1, ...], 0.5 * (slope_x[1, ...] - slope_y[0, ...])

    def velocity(self, position: Array) -> Array:
        values = self.spline(position[..., 0], position[..., 1])
        return join(values[0], values[1])

    def spin(self, position: Array) -> Array:
        return self.velocity_and_spin(position[..., 0], position[..., 1])[2]


def _speed_and_spin(values: np.ndarray) -> np.ndarray:
    """|u| and, where they are there, |ω₀| from (u_x, u_y, ω₀)."""
    return np.stack([np.hypot(values[0], values[1]), *np.abs(values[2:])])


def _central_spin(grid: Grid) -> np.ndarray:
    """Half the vorticity (nx, ny) at the grid's points by central differences, of second order at edges
    too."""

    def slope(values: np.ndarray, axis: int) -> np.ndarray:
        spacing = grid.lattice.spacing[axis]
        if grid.lattice.periodic:
            return (np.roll(values, -1, axis) - np.roll(values, 1, axis)) / (2 * spacing)
        return np.gradient(values, spacing, axis=axis, edge_order=2 if values.shape[axis] > 2 else 1)

    return 0.5 * (slope(grid.values[1], 0) - slope(grid.values[0], 1))
