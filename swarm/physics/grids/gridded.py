"""Fields and flows from data on a regular grid: an xarray Dataset or DataArray, or a NetCDF-4 file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm._support.arrays import join
from swarm._support.checks import check_number, check_point
from swarm.physics.grids.reading import Grid, check_units, read_grid
from swarm.physics.grids.splines import Spline

if TYPE_CHECKING:
    import xarray as xr

Array = Any


class _OnGrid:
    """What gridded fields and flows have in common."""

    def __init__(self, grid: Grid, values: np.ndarray, edges: str, interpolation: str) -> None:
        self.spline = Spline(values, grid.lattice, interpolation)
        self.edges = edges
        self.interpolation = interpolation
        self.box = grid.lattice.box  # the domain, where starts are drawn by default
        # A grid that repeats is known everywhere; of another one cells can leave.
        self.inside = None if edges == "periodic" else self._inside

    def _inside(self, position: Array) -> Array:
        """Whether `position` (..., 2) lies in the domain, bool (...)."""
        (left, right), (bottom, top) = self.box
        x, y = position[..., 0], position[..., 1]
        return (x >= left) & (x <= right) & (y >= bottom) & (y <= top)

    def _described(self, **numbers: Any) -> str:
        lattice = self.spline.lattice
        parts = [
            f"{lattice.shape[0]} × {lattice.shape[1]} points in {self.box}",
            self.edges,
            self.interpolation,
        ]
        parts += [f"{name}={value:g}" for name, value in numbers.items() if value is not None]
        return f"{type(self).__name__}({', '.join(parts)})"


class GriddedField(_OnGrid):
    """A concentration field interpolated from values on a regular grid with coordinates x and y.

    `edges` says what lies beyond the grid: "periodic", it repeats one spacing after its last point;
    "clamped", it ends there, and a cell that leaves is truncated. `interpolation` is "cubic" (smooth, fourth
    order) or "linear" (second). Without a `gradient_scale` c_k is measured: the root mean square of |∇c| over
    the grid. `variable` may be left out where the data hold only one. Raises TypeError, ValueError or OSError
    that names the variable, the rule and the value.
    """

    def __init__(
        self,
        data: xr.Dataset | xr.DataArray | str | os.PathLike,
        *,
        edges: str,
        interpolation: str = "cubic",
        variable: str | None = None,
        gradient_scale: float | None = None,
        egg_position: tuple[float, float] = (0.0, 0.0),
        egg_radius: float | None = None,
    ) -> None:
        names = None if variable is None else [variable]
        grid = read_grid(data, names, edges=edges, interpolation=interpolation)
        self.length_unit = check_units(grid.units)
        super().__init__(grid, grid.values, edges, interpolation)
        if gradient_scale is None:
            _, slope_x, slope_y = self.spline.at_points()
            gradient_scale = float(np.sqrt(np.mean(slope_x**2 + slope_y**2)))
            if not gradient_scale > 0:
                raise ValueError("gradient_scale must be given where the field has no gradient, got None")
        self.gradient_scale = check_number("gradient_scale", gradient_scale, above=0.0)
        _, slopes = self.spline.bounds()
        self.max_gradient = float(np.hypot(*slopes[0]))
        self.egg_position = check_point("egg_position", egg_position)
        self.egg_radius = None if egg_radius is None else check_number("egg_radius", egg_radius, above=0.0)

    def concentration(self, position: Array) -> Array:
        """Concentration (...) at `position` (..., 2)."""
        return self.spline(position[..., 0], position[..., 1])[0]

    def __repr__(self) -> str:
        return self._described(gradient_scale=self.gradient_scale)


class GriddedFlow(_OnGrid):
    """A flow interpolated from velocities on a regular grid with coordinates x and y.

    `edges` and `interpolation` are those of `GriddedField`. `velocity` names the variables of u_x and u_y;
    `spin` that of the angular velocity ω₀, half the vorticity, which is otherwise found by differentiation:
    of the interpolant where that is cubic; where it is linear, of the values by central differences. Without
    scales, u₀ and the spin's scale are measured: the largest on the grid. Paths keep the world's tolerance
    where the interpolation is cubic; a linear one has kinks at the grid lines.
    """

    def __init__(
        self,
        data: xr.Dataset | str | os.PathLike,
        *,
        edges: str,
        interpolation: str = "cubic",
        velocity: tuple[str, str] = ("u_x", "u_y"),
        spin: str | None = None,
        speed_scale: float | None = None,
        spin_scale: float | None = None,
    ) -> None:
        if len(velocity) != 2 or isinstance(velocity, str):
            raise ValueError(f"velocity must be the names of two variables, got {velocity!r}")
        names = [*velocity, *([] if spin is None else [spin])]
        grid = read_grid(data, names, edges=edges, interpolation=interpolation)
        self.length_unit = check_units(grid.units, velocity, spin)
        values = grid.values
        if spin is None and interpolation == "linear":
            values = np.concatenate([values, _central_spin(grid)[None]])
        super().__init__(grid, values, edges, interpolation)
        self._differentiates = len(values) == 2
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

    def velocity_and_spin(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """u_x, u_y and ω₀ (...) at the places (x, y)."""
        if not self._differentiates:
            u_x, u_y, spin = self.spline(x, y)
            return u_x, u_y, spin
        values, slope_x, slope_y = self.spline.with_slopes(x, y)
        return values[0, ...], values[1, ...], 0.5 * (slope_x[1, ...] - slope_y[0, ...])

    def velocity(self, position: Array) -> Array:
        """Velocity u (..., 2) at `position` (..., 2)."""
        values = self.spline(position[..., 0], position[..., 1])
        return join(values[0], values[1])

    def spin(self, position: Array) -> Array:
        """Angular velocity ω₀ (...) at `position` (..., 2)."""
        return self.velocity_and_spin(position[..., 0], position[..., 1])[2]

    def __repr__(self) -> str:
        return self._described(speed_scale=self.speed_scale, spin_scale=self.spin_scale)


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
