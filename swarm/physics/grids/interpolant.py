"""What fields and flows make of quantities on a grid: a domain, values between the points, a time."""

from __future__ import annotations

import copy
import functools
import numbers
import operator
from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from swarm._support.arrays import Array, as_array, look_up, namespace
from swarm._support.compiler import compiling
from swarm.physics.grids.grid import Grid
from swarm.physics.grids.spline import Moment, Placed, Spline
from swarm.physics.motion.arc import components

NEGLIGIBLE = 1e-9  # of the largest value, per spacing: below it a slope is rounding


class Interpolant:
    """The quantities of a grid and `further` ones (times, nx, ny[, nz]), interpolated.

    Where the data have a time axis, `at(time)` is a view at that time, or those times; the interpolant itself
    is one at time 0.
    """

    def __init__(self, grid: Grid, shape: Sequence[int] | None, *further: np.ndarray) -> None:
        reading = grid.reading
        if shape is not None and list(shape) != grid.shape:
            raise ValueError(f"shape must be that of the grid, {grid.shape}, got {shape!r}")
        self.spline = Spline(np.stack([*grid.values, *further]), grid.lattice, reading.interpolation)
        self.box = grid.lattice.box  # the domain, where starts are drawn by default
        self.coordinates = len(self.box)
        self._domain = None if grid.whole is None else Placed(grid.whole.ravel())
        # A grid that repeats is known everywhere; of another one cells can leave.
        endless = all(grid.lattice.periodic) and self._domain is None
        self.inside = None if endless else self._inside
        self._outside_time, self._time = reading.outside_time, 0.0
        self._times, self._moments = grid.times, None if grid.times is None else Placed(grid.times)
        if grid.times is not None:
            self.at = self._at
            if reading.outside_time == "error":  # a life must end before the data do
                self.times = float(grid.times[0]), float(grid.times[-1])
        self._data = reading.parameters()
        self._record = {"path": grid.path, "sha256": grid.sha256, "shape": grid.shape}
        self._numbers: dict[str, Any] = {}  # parameters that are not the grid's

    def _inside(self, position: Array) -> Array:
        """Whether `position` (..., coordinates) lies in the domain, bool (...)."""
        places = components(position)
        sides = zip(places, self.box, self.spline.lattice.periodic, strict=True)
        within = [(place >= low) & (place <= high) for place, (low, high), again in sides if not again]
        if self._domain is not None:
            within.append(look_up(self._domain.like(position)[0], self.spline.cell(places)))
        return functools.reduce(operator.and_, within)

    # --- time -----------------------------------------------------------------------------------------------

    def _at(self, time: Any) -> Self:
        """As it is at `time` (a number, or an array that broadcasts with positions' (...)), linear between
        the data's times.

        Outside them the first and the last are held, or it is a ValueError; within a trace, where no time is
        known yet, an outside one gives NaN.
        """
        view = copy.copy(self)
        number = isinstance(time, numbers.Real) or (isinstance(time, np.ndarray) and time.ndim == 0)
        view._time = float(time) if number else time
        if self._outside_time == "error":
            self._check_time(view._time)
        return view

    def _check_time(self, time: Any) -> None:
        if not isinstance(time, float) and compiling(time):
            return
        assert self._times is not None
        first, last = float(self._times[0]), float(self._times[-1])
        try:
            good = (time >= first) & (time <= last)
            if bool(good if isinstance(time, float) else namespace(time).all(good)):
                return
        except (TypeError, RuntimeError):  # inside a trace
            return
        earliest, latest = (time, time) if isinstance(time, float) else (float(time.min()), float(time.max()))
        raise ValueError(
            f"time must lie within that of the data, {first:g} to {last:g}, "
            f"got {latest if earliest >= first else earliest:g}; outside_time='held' goes on with the nearest"
        )

    def _places(self, *places: Array) -> tuple[tuple[Array, ...], Moment | None]:
        """Coordinates (...), and the moment that goes with them."""
        if self._moments is None or self._times is None:
            return places, None
        last, time = len(self._times) - 2, self._time
        if isinstance(time, float):
            if self._outside_time == "error":
                self._check_time(time)
            number = min(max(int(np.searchsorted(self._times, time, side="right")) - 1, 0), last)
            begin, end = self._times[number : number + 2].tolist()
            return places, (number, min(max((time - begin) / (end - begin), 0.0), 1.0))
        like = places[0]
        xp = namespace(like)
        time = xp.astype(as_array(time, like) if isinstance(time, np.ndarray) else time, like.dtype)
        times = self._moments.like(like)[0]
        flat = (
            xp.searchsorted(times, xp.reshape(time, (-1,)) * 1, side="right") - 1
        )  # torch wants it in one piece
        number = xp.reshape(xp.astype(xp.clip(flat, 0, last), xp.int32), time.shape)
        begin, end = look_up(times, number), look_up(times, number + 1)
        share = (time - begin) / (end - begin)
        held = xp.clip(share, 0.0, 1.0)
        if self._outside_time == "error":  # which has been refused where it is known
            held = xp.where((share >= 0) & (share <= 1), held, xp.nan)
        *places, number, held = xp.broadcast_arrays(*places, number, held)
        return tuple(places), (number, held)

    # --- records --------------------------------------------------------------------------------------------

    def parameters(self) -> dict[str, Any]:
        """What makes it again from its file, which its checksum tells from all others."""
        return {**self._data, **self._numbers, **self._record}

    def __repr__(self) -> str:
        points = " × ".join(map(str, self.spline.lattice.shape))
        times = [] if self._times is None else [f"{len(self._times)} times"]
        scales = [f"{name}={value:g}" for name, value in self._numbers.items() if name.endswith("scale")]
        edges = self._data["edges"]
        kind = [edges if isinstance(edges, str) else " and ".join(edges), self._data["interpolation"]]
        parts = [f"{points} points in {self.box}", *times, *kind, *scales]
        return f"{type(self).__name__}({', '.join(parts)})"
