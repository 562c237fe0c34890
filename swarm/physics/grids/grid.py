"""Quantities on a regular grid: what data must be to be one, and what fields and flows make of it."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from swarm._support import files
from swarm._support.arrays import Array
from swarm._support.checks import check_name
from swarm.physics.grids.netcdf import AXES, MAX_VALUES, checksum, open_netcdf
from swarm.physics.grids.spline import MIN_POINTS, Lattice, Spline

EDGES = ("periodic", "clamped")


class Grid(NamedTuple):
    """Quantities on a lattice, as they were read and checked."""

    names: tuple[str, ...]  # of the quantities
    values: np.ndarray  # (quantities, nx, ny) float64
    lattice: Lattice
    units: dict[str, str]  # of x, y and the quantities, where they are stated
    path: str | None  # of the file; None for data in memory
    sha256: str | None  # of the file


def read_grid(
    data: Any, names: Sequence[str] | None, *, edges: str, interpolation: str, sha256: str | None
) -> Grid:
    """The quantities `names` of an xarray Dataset, a DataArray or a NetCDF-4 file.

    Without `names` there must be one quantity only; with `sha256` the file must have that checksum. Raises
    ValueError, TypeError or OSError that names the variable, the rule and what is there instead.
    """
    check_name("edges", edges, EDGES)
    check_name("interpolation", interpolation, MIN_POINTS)
    path = str(files.expanded(data)) if isinstance(data, (str, os.PathLike)) else None
    found = None if path is None else checksum(path)
    if sha256 not in (None, found):
        raise ValueError(f"data must be the file {path} with SHA-256 {sha256}, got one with {found}")
    arrays = _arrays(data if path is None else open_netcdf(path, names), names)
    first = next(iter(arrays.values()))
    for name, array in arrays.items():
        _check_array(name, array)
    origin, spacing = zip(*(_regular(first[axis], interpolation) for axis in AXES), strict=True)
    rising = [array.transpose(*AXES).sortby(list(AXES)).values for array in arrays.values()]
    values = np.stack([np.asarray(quantity, np.float64) for quantity in rising])
    lattice = Lattice(origin, spacing, values.shape[1:], edges == "periodic")
    _check_finite(list(arrays), values, lattice)
    if lattice.periodic:
        _check_period(list(arrays), values)
    stated = {axis: first[axis].attrs.get("units") for axis in AXES}
    stated |= {name: array.attrs.get("units") for name, array in arrays.items()}
    units = {name: str(unit) for name, unit in stated.items() if unit is not None}
    return Grid(tuple(arrays), values, lattice, units, path, found)


def _arrays(data: Any, names: Sequence[str] | None) -> dict[str, Any]:
    """The variables by name, as xarray DataArrays."""
    import xarray as xr

    if isinstance(data, xr.DataArray):
        if names is not None and len(names) > 1:
            raise TypeError(f"data must be a Dataset with {', '.join(names)}, got a DataArray")
        return {"data" if data.name is None else str(data.name): data}
    if not isinstance(data, xr.Dataset):
        raise TypeError(
            "data must be an xarray Dataset or DataArray, or the path of a NetCDF file, "
            f"got {type(data).__name__}"
        )
    if names is None:
        names = [str(name) for name, array in data.data_vars.items() if set(AXES) <= set(array.dims)]
        if len(names) != 1:
            raise ValueError(
                f"variable must be named where data hold more or less than one over x and y, got {names}"
            )
    return {name: data[check_name("variable", name, map(str, data.data_vars))] for name in names}


def _check_array(name: str, array: Any) -> None:
    if set(array.dims) != set(AXES):
        raise ValueError(
            f"{name} must have the dimensions x and y and no others, got {tuple(map(str, array.dims))}"
        )
    if array.size > MAX_VALUES:
        raise ValueError(f"{name} must have at most {MAX_VALUES} values, got {array.size}")
    for axis in AXES:
        if axis not in array.coords:
            raise ValueError(f"{name} must have the coordinate {axis}, got {sorted(map(str, array.coords))}")
    for each, numbers in ((name, array), *((axis, array[axis]) for axis in AXES)):
        if numbers.dtype.kind not in "fiu":
            raise ValueError(f"{each} must hold real numbers, got {numbers.dtype}")


def _regular(coordinate: Any, interpolation: str) -> tuple[float, float]:
    """Lowest point and spacing of a coordinate; raises ValueError unless its points are evenly spaced."""
    axis, fewest = coordinate.name, MIN_POINTS[interpolation]
    places = np.sort(np.asarray(coordinate.values, np.float64))
    if len(places) < fewest:
        raise ValueError(
            f"{axis} must have at least {fewest} points for {interpolation} interpolation, got {len(places)}"
        )
    if not np.all(np.isfinite(places)):
        raise ValueError(f"{axis} must be finite, got {places[~np.isfinite(places)][0]:g}")
    start, spacing = float(places[0]), float(places[-1] - places[0]) / (len(places) - 1)
    # single precision coordinates are evenly spaced but for their rounding
    slack = 1e-6 * spacing + 4e-7 * float(np.abs(places).max())
    error = np.abs(places - (start + spacing * np.arange(len(places))))
    worst = int(error.argmax())
    if spacing <= 0 or error[worst] > min(slack, 0.1 * spacing):
        raise ValueError(
            f"{axis} must be evenly spaced, got {places[worst]:g} at index {worst} "
            f"instead of {start + spacing * worst:g}"
        )
    return start, spacing


def _check_finite(names: list[str], values: np.ndarray, lattice: Lattice) -> None:
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        quantity, i, j = bad[0]
        x, y = np.asarray(lattice.origin) + np.asarray(lattice.spacing) * (i, j)
        raise ValueError(
            f"{names[quantity]} must be finite everywhere, got {values[quantity, i, j]} at x = {x:g}, "
            f"y = {y:g} (index {i}, {j} from the lowest x and y; {len(bad)} in all)"
        )


def _check_period(names: list[str], values: np.ndarray) -> None:
    """A periodic grid must not state its first line again as its last."""
    for axis, dimension in ((1, "x"), (2, "y")):
        lines = np.moveaxis(values, axis, 0)
        scale = np.ptp(values, axis=(1, 2)).max()
        repeats = np.abs(lines[0] - lines[-1]).max() <= 1e-9 * scale
        if repeats and np.abs(lines[1] - lines[0]).max() > 1e-9 * scale:
            raise ValueError(
                f"{dimension} of a periodic grid must end one spacing before its period: the last line of "
                f"{', '.join(names)} must not repeat the first, got the same values"
            )


class Interpolant:
    """What fields and flows on a grid share: its quantities and `further` ones (nx, ny), interpolated."""

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


# --- units --------------------------------------------------------------------------------------------------


def check_units(units: dict[str, str], velocity: Sequence[str] = (), spin: str | None = None) -> str | None:
    """The unit of length, where stated; raises ValueError where units contradict each other."""
    for names in (AXES, velocity):
        stated = {name: units[name] for name in names if name in units}
        if len(set(stated.values())) > 1:
            found = " and ".join(map(repr, stated.values()))
            raise ValueError(f"{' and '.join(stated)} must have the same units, got {found}")
    length = units.get("x", units.get("y"))
    per_time = None
    for name in velocity:
        parts = re.fullmatch(
            r"\s*(.+?)\s*(?:/\s*|[\s·.*]+)(\w+?)\s*((?:\^|\*\*)?\(?[-−]1\)?)?\s*", units.get(name, "")
        )
        if parts:
            per_time = parts[2]
            if length is not None and parts[1] != length:
                raise ValueError(f"{name} must be in {length} per time like x and y, got {units[name]!r}")
    if spin is not None and spin in units:
        unit = units[spin]
        if re.search("deg|rev|turn|Hz", unit):
            raise ValueError(f"{spin} must be in radians per time, got {unit!r}")
        if per_time is not None and not re.search(rf"\b{re.escape(per_time)}\b", unit):
            raise ValueError(f"{spin} must be in radians per {per_time} like {velocity[0]}, got {unit!r}")
    return length
