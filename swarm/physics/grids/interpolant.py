"""What fields and flows on a grid have in common: their spline, their domain, and what is told of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm._support.arrays import Array
from swarm.physics.grids.grid import Grid
from swarm.physics.grids.spline import Spline


class Interpolant:
    """Quantities of a grid, interpolated, with `further` ones (nx, ny)."""

    def __init__(
        self, grid: Grid, edges: str, interpolation: str, shape: Sequence[int] | None, *further: np.ndarray
    ) -> None:
        points = list(grid.lattice.shape)
        if shape is not None and list(shape) != points:
            raise ValueError(f"shape must be that of the grid, {points}, got {shape!r}")
        self.spline = Spline(np.stack([*grid.values, *further]), grid.lattice, interpolation)
        self.box = grid.lattice.box  # the domain, where starts are drawn by default
        # A grid that repeats is known everywhere; of another one cells can leave.
        self.inside = None if grid.lattice.periodic else self._inside
        self._data = {"edges": edges, "interpolation": interpolation}
        self._record = {"path": grid.path, "sha256": grid.sha256, "shape": points}
        self._numbers: dict[str, Any] = {}  # parameters that are not the grid's

    def _inside(self, position: Array) -> Array:
        """Whether `position` (..., 2) lies in the domain, bool (...)."""
        (left, right), (bottom, top) = self.box
        x, y = position[..., 0], position[..., 1]
        return (x >= left) & (x <= right) & (y >= bottom) & (y <= top)

    def parameters(self) -> dict[str, Any]:
        """What makes it again from its file, which its checksum tells from all others."""
        return {**self._data, **self._numbers, **self._record}

    def __repr__(self) -> str:
        points = " × ".join(map(str, self.spline.lattice.shape))
        scales = [f"{name}={value:g}" for name, value in self._numbers.items() if name.endswith("scale")]
        parts = [f"{points} points in {self.box}", *self._data.values(), *scales]
        return f"{type(self).__name__}({', '.join(parts)})"
