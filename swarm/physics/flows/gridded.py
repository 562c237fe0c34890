"""Flows from data on a regular grid."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm._support.arrays import Array, join
from swarm._support.checks import check_number
from swarm.physics.flows.flow import FLOWS
from swarm.physics.grids.axes import SPACING_TOLERANCE
from swarm.physics.grids.grid import Reading, read_grid
from swarm.physics.grids.interpolant import NEGLIGIBLE, Interpolant
from swarm.physics.grids.spline import Lattice
from swarm.physics.grids.units import check_units
from swarm.physics.motion.arc import components

CURLS = {2: ((0, 1),), 3: ((1, 2), (2, 0), (0, 1))}  # ∂ₐu_b − ∂_bu_a of the vorticity's components


@FLOWS.register("gridded", data="path")
class GriddedFlow(Interpolant):
    """A flow interpolated from velocities on a regular grid with coordinates x and y, in space z: an xarray
    Dataset, a NetCDF-4 file, or bare arrays by name.

    `edges` to `outside_time`, `sha256` and `shape` are those of `GriddedField`. `velocity` names the
    variables of u_x and u_y, in space u_z; `spin` that of the angular velocity ω₀, half the vorticity, in
    space `vorticity` those of its three components. Without names it is found by differentiation: of the
    interpolant where that is cubic; where it is linear, of the values by central differences. Without scales,
    u₀ and the spin's scale are measured: the largest on the grid; of a flow that does not spin the spin's is
    1. Paths keep the world's tolerance where the interpolation is cubic; a linear one has kinks at the grid
    lines, and data in time have some at their times.
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
        vorticity: Sequence[str] | None = None,
        speed_scale: float | None = None,
        spin_scale: float | None = None,
        sha256: str | None = None,
        shape: Sequence[int] | None = None,
    ) -> None:
        given = self._check_names(velocity, spin, vorticity)
        reading = Reading(edges, interpolation, period, spacing_tolerance, fill, outside_time)
        grid = read_grid(data, [*velocity, *given], reading, sha256)
        axes = len(grid.lattice.shape)
        if len(velocity) != axes:
            raise ValueError(f"velocity must be the names of {axes} variables, got {velocity!r}")
        self.length_unit = check_units(grid.units, velocity, spin)
        self._differentiates = not given and interpolation == "cubic"
        found_here = not given and interpolation == "linear"
        further = _turning(_central_slopes(grid.values[:axes], grid.lattice)) if found_here else []
        super().__init__(grid, shape, *further)
        at_points, *along = self.spline.at_points()
        turning = np.stack(_turning(along)) if self._differentiates else at_points[axes:]
        fastest = float(_size(at_points[:axes])[..., grid.known].max())
        strongest = float(_spin_of(turning)[..., grid.known].max())
        # what rounding leaves of a flow that does not spin is no spin
        self._spins = strongest > NEGLIGIBLE * fastest / min(grid.lattice.spacing)
        sizes, slopes = self.spline.bounds(of=functools.partial(_speed_and_spin, axes))
        self.max_speed = float(sizes[0])
        curls = [0.5 * (slopes[b, a] + slopes[a, b]) for a, b in CURLS[axes]]
        spin_bound = _size(np.array(curls)) if self._differentiates else sizes[1]
        self.max_spin = float(spin_bound) if self._spins else 0.0
        self.max_shear = float(slopes[:axes].max())
        self.speed_scale = check_number(
            "speed_scale", fastest if speed_scale is None else speed_scale, above=0.0
        )
        measured = strongest if self._spins else 1.0
        self.spin_scale = check_number(
            "spin_scale", measured if spin_scale is None else spin_scale, at_least=0.0
        )
        self._numbers = {"velocity": velocity, "spin": spin}
        self._numbers |= {} if vorticity is None else {"vorticity": vorticity}
        self._numbers |= {"speed_scale": self.speed_scale, "spin_scale": self.spin_scale}

    def velocity_and_spin(self, *places: Array) -> tuple[Array, ...]:
        """u_x, u_y and ω₀ (...) at the places (x, y), in space the components of velocity and vorticity."""
        axes = len(places)
        places, moment = self._places(*places)
        if not self._differentiates:
            found = self.spline(places, moment)
        elif self._spins:
            values, *slopes = self.spline.with_slopes(places, moment)
            found = *(values[i, ...] for i in range(axes)), *_turning(slopes)
        else:
            found = *self.spline(places, moment), *(places[0],) * len(CURLS[axes])
        return found if self._spins else (*found[:axes], *(0.0 * each for each in found[axes:]))

    velocity_and_vorticity = velocity_and_spin

    def velocity(self, position: Array) -> Array:
        values = self.spline(*self._places(*components(position)))
        return join(*values[: self.coordinates])

    def spin(self, position: Array) -> Array:
        return self.velocity_and_spin(*components(position))[2]

    def vorticity(self, position: Array) -> Array:
        """(..., 3), in space."""
        return join(*self.velocity_and_spin(*components(position))[3:])

    @staticmethod
    def _check_names(velocity: Sequence[str], spin: str | None, vorticity: Sequence[str] | None) -> list[str]:
        """The names of what turns, as far as they are given."""
        if isinstance(velocity, str) or len(velocity) not in (2, 3):
            raise ValueError(
                f"velocity must be the names of two variables, or three in space, got {velocity!r}"
            )
        if spin is not None and len(velocity) == 3:
            raise ValueError(f"spin must be None in space, where vorticity has three names, got {spin!r}")
        if vorticity is not None and (isinstance(vorticity, str) or len(vorticity) != len(velocity) != 2):
            raise ValueError(f"vorticity must be the names of three variables, in space, got {vorticity!r}")
        return [*([] if spin is None else [spin]), *(vorticity or ())]


def _turning(slopes: Sequence[Array]) -> list[Array]:
    """The spin, in space the components of the vorticity, from velocities' slopes along each axis."""
    curls = [slopes[a][b, ...] - slopes[b][a, ...] for a, b in CURLS[len(slopes)]]
    return [0.5 * curls[0]] if len(curls) == 1 else curls


def _size(vectors: np.ndarray) -> np.ndarray:
    """Length (...) of vectors (axes, ...)."""
    return np.abs(functools.reduce(np.hypot, vectors))


def _spin_of(turning: np.ndarray) -> np.ndarray:
    """|ω₀| from it, in space from the vorticity (3, ...)."""
    return np.abs(turning[0]) if len(turning) == 1 else 0.5 * _size(turning)


def _speed_and_spin(axes: int, values: np.ndarray) -> np.ndarray:
    """|u| and, where it is there, |ω₀| from what is interpolated."""
    turning = [_spin_of(values[axes:])] if len(values) > axes else []
    return np.stack([_size(values[:axes]), *turning])


def _central_slopes(values: np.ndarray, lattice: Lattice) -> list[np.ndarray]:
    """Derivatives of values (quantities, times, nx, ny[, nz]) along each axis, by central differences, of
    second order at edges too."""
    slopes = []
    for axis, (spacing, again) in enumerate(zip(lattice.spacing, lattice.periodic, strict=True), 2):
        if again:
            slopes.append((np.roll(values, -1, axis) - np.roll(values, 1, axis)) / (2 * spacing))
        else:
            order: Any = 2 if values.shape[axis] > 2 else 1
            slopes.append(np.gradient(values, spacing, axis=axis, edge_order=order))
    return slopes
