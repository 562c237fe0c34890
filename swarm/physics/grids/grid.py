"""Quantities on a regular grid: what data must be to be one."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from swarm._support import files
from swarm._support.checks import check_installed, check_name, check_number, optional
from swarm.physics.grids import axes
from swarm.physics.grids.hdf5 import as_text
from swarm.physics.grids.netcdf import COORDINATES, MAX_VALUES, checksum, open_netcdf
from swarm.physics.grids.spline import MIN_POINTS, Lattice
from swarm.physics.grids.units import AXES, SPACE, TIME

EDGES = ("periodic", "clamped")
OUTSIDE = ("error", "held")
FILLS = ("inside", "nearest", "zero")  # of holes: where data are missing, as on land, or no particle was seen


class Reading(NamedTuple):
    """How data are read; see `GriddedField`."""

    edges: Any
    interpolation: str = "cubic"
    period: Any = None
    spacing_tolerance: float = axes.SPACING_TOLERANCE
    fill: str | None = None
    outside_time: str | None = None

    def checked(self, along: Sequence[str] | None = None) -> Reading:
        """With edges and period for each axis that data lie along, by default as many as these are given for;
        raises ValueError or TypeError for what is not known.
        """
        along = axes.axes_of(self.edges, self.period) if along is None else along
        edges = axes.per_axis("edges", self.edges, lambda name, value: check_name(name, value, EDGES), along)
        check_name("interpolation", self.interpolation, MIN_POINTS)
        number = optional(check_number)
        period = axes.per_axis(
            "period", self.period, lambda name, value: number(name, value, above=0.0), along
        )
        once = self.period is None or isinstance(self.period, (int, float))
        for axis, edge, length in zip(along, edges, period, strict=True):
            if length is not None and edge != "periodic" and (not once or "periodic" not in edges):
                raise ValueError(f"period along {axis} must be None, whose edges are {edge}, got {length:g}")
        tolerance = check_number("spacing_tolerance", self.spacing_tolerance, at_least=0.0)
        if tolerance >= 0.5:
            raise ValueError(f"spacing_tolerance must be below 0.5, got {tolerance:g}")
        for name, known in (("fill", FILLS), ("outside_time", OUTSIDE)):
            optional(check_name)(name, getattr(self, name), known=known)
        return self._replace(edges=edges, period=period, spacing_tolerance=tolerance)

    def parameters(self) -> dict[str, Any]:
        """As they are recorded: what is the same for all axes once."""
        told = self._asdict()
        for name in ("edges", "period"):
            told[name] = told[name][0] if len(set(told[name])) == 1 else list(told[name])
        return told


class Grid(NamedTuple):
    """Quantities on a lattice, as they were read and checked."""

    names: tuple[str, ...]  # of the quantities
    values: np.ndarray  # (quantities, times, nx, ny) float64, in space (…, nz)
    lattice: Lattice
    times: np.ndarray | None  # (times,) rising; None for what does not change
    known: np.ndarray  # (nx, ny[, nz]) bool: where the values are the data's, at all times
    whole: np.ndarray | None  # bool, which grid cells make up the domain; None for all
    units: dict[str, str]  # of coordinates and quantities, where they are stated
    path: str | None  # of the file; None for data in memory
    sha256: str  # of the file; of data in memory that of their numbers
    reading: Reading  # how they were read, for each axis

    @property
    def shape(self) -> list[int]:
        """Points in time, where it has some, and along each axis."""
        return [*(() if self.times is None else (len(self.times),)), *self.lattice.shape]


def read_grid(data: Any, names: Sequence[str] | None, reading: Reading, sha256: str | None) -> Grid:
    """The quantities `names` of an xarray Dataset, a DataArray, a NetCDF-4 file, or bare arrays by name.

    Without `names` there must be one quantity only; with `sha256` the data must have that checksum. Raises
    ValueError, TypeError or OSError that names the variable, the rule and what is there instead.
    """
    check_installed("grids need", "xarray", "scipy", "h5py", "h5netcdf", "pint", extra="results")
    reading.checked()  # before anything is read
    path = str(files.expanded(data)) if isinstance(data, (str, os.PathLike)) else None
    found = None if path is None else checksum(path)
    if found is not None and sha256 not in (None, found):
        raise ValueError(f"data must be the file {path} with SHA-256 {sha256}, got one with {found}")
    arrays = _arrays(data if path is None else open_netcdf(path, names), names)
    for name, array in arrays.items():
        _check_array(name, array)
    arrays = {name: _ordered(array) for name, array in arrays.items()}
    along, *others = {tuple(axis for axis in SPACE if axis in array.dims) for array in arrays.values()}
    if others:
        raise ValueError(f"{', '.join(arrays)} must have the same dimensions, got {sorted([along, *others])}")
    reading = reading.checked(along)
    times = _times(arrays, reading)
    moments = 1 if times is None else len(times)
    numbers = [np.asarray(array.values, np.float64) for array in arrays.values()]
    values = np.stack([np.broadcast_to(each, (moments, *each.shape[-len(along) :])) for each in numbers])
    lattice, values = axes.lattice_of(arrays, values, reading)
    known = np.isfinite(values)
    if not known.all():
        if reading.fill is None:
            _raise_hole(list(arrays), values, known, lattice)
        values = _filled(values, reading.fill, lattice.spacing, lattice.periodic)
    everywhere = np.all(known, axis=(0, 1)) if reading.fill == "inside" else np.ones(lattice.shape, bool)
    whole = None if everywhere.all() else _whole_cells(everywhere, lattice.periodic)
    if whole is not None and not whole.any():
        raise ValueError(f"{', '.join(arrays)} must be finite at all corners of a grid cell, got none such")
    number = found or _digest(values, known, lattice, times)
    if sha256 not in (None, number):
        raise ValueError(f"data must have the SHA-256 {sha256}, got {number}")
    axes_of_all = {str(axis): array[axis] for array in arrays.values() for axis in array.dims}
    units = {name: as_text(array.attrs.get("units")) for name, array in (axes_of_all | arrays).items()}
    stated = {name: text for name, text in units.items() if text.strip()}
    return Grid(tuple(arrays), values, lattice, times, everywhere, whole, stated, path, number, reading)


def _digest(values: np.ndarray, known: np.ndarray, lattice: Lattice, times: np.ndarray | None) -> str:
    about = (lattice.origin, lattice.spacing, values.shape, None if times is None else times.tolist())
    digest = hashlib.sha256(repr(about).encode())
    for numbers in (values.astype("<f8"), known):
        digest.update(np.ascontiguousarray(numbers).data)
    return digest.hexdigest()


def _arrays(data: Any, names: Sequence[str] | None) -> dict[str, Any]:
    """The variables by name, as xarray DataArrays."""
    import xarray as xr

    if isinstance(data, xr.DataArray):
        if names is not None and len(names) > 1:
            raise TypeError(f"data must be a Dataset with {', '.join(names)}, got a DataArray")
        return {"data" if data.name is None else str(data.name): data}
    if isinstance(data, Mapping) and not isinstance(data, xr.Dataset):
        data = _labelled(data)
    if not isinstance(data, xr.Dataset):
        raise TypeError(
            "data must be an xarray Dataset or DataArray, or the path of a NetCDF file, "
            f"or bare arrays by name, got {type(data).__name__}"
        )
    if names is None:
        names = [str(name) for name, array in data.data_vars.items() if set(AXES) <= set(array.dims)]
        if len(names) != 1:
            raise ValueError(
                f"variable must be named where data hold more or less than one over x and y, got {names}"
            )
    return {name: data[check_name("variable", name, map(str, data.data_vars))] for name in names}


def _labelled(data: Mapping[Any, Any]) -> Any:
    """Bare arrays by name, the coordinates x, y (z and time) among them, as a Dataset: they must be in
    order."""
    import xarray as xr

    arrays = {str(name): np.asarray(array) for name, array in data.items()}
    along = [axis for axis in COORDINATES if axis in arrays]
    if "z" in along and arrays["z"].ndim == len(AXES):  # a quantity
        along.remove("z")
    for axis in AXES:
        if axis not in along:
            raise ValueError(f"data must have the coordinate {axis}, got {sorted(arrays)}")
    for axis in along:
        axes.check_numbers(axis, arrays[axis])
        if arrays[axis].ndim != 1:
            raise ValueError(f"{axis} must have one dimension, got {arrays[axis].shape}")
        axes.check_points(axis, arrays[axis], 1, "")
        axes.check_strict(axis, arrays[axis])
    places = tuple(axis for axis in along if axis != TIME)
    over = {
        tuple(len(arrays[axis]) for axis in dims): dims for dims in (places, (*along[len(places) :], *places))
    }
    variables = {}
    for name in arrays.keys() - set(along):
        if arrays[name].shape not in over:
            shapes = " or ".join(map(str, over))
            raise ValueError(f"{name} must have the shape {shapes} of its axes, got {arrays[name].shape}")
        variables[name] = over[arrays[name].shape], arrays[name]
    return xr.Dataset(variables, {axis: arrays[axis] for axis in along})


def _check_array(name: str, array: Any) -> None:
    if set(array.dims) - {TIME} not in (set(AXES), set(SPACE)):
        raise ValueError(
            f"{name} must have the dimensions x and y, z and time if need be, and no others, "
            f"got {tuple(map(str, array.dims))}"
        )
    if array.size > MAX_VALUES:
        raise ValueError(f"{name} must have at most {MAX_VALUES} values, got {array.size}")
    axes.check_numbers(name, array)
    for axis in array.dims:
        if axis == TIME and array.sizes[TIME] == 1:  # of one moment it does not matter which
            continue
        if axis not in array.coords:
            raise ValueError(f"{name} must have the coordinate {axis}, got {sorted(map(str, array.coords))}")
        axes.check_numbers(axis, array[axis])


def _ordered(array: Any) -> Any:
    """With rising coordinates, over time (where it has more than one), x, y and z."""
    if array.sizes.get(TIME) == 1:
        array = array.isel({TIME: 0}, drop=True)
    order = [axis for axis in (TIME, *SPACE) if axis in array.dims]
    return array.transpose(*order).sortby(order)


def _times(arrays: Mapping[str, Any], reading: Reading) -> np.ndarray | None:
    timed = [array for array in arrays.values() if TIME in array.dims]
    if not timed:
        return None
    if reading.outside_time is None:
        raise ValueError(f"outside_time must be one of {', '.join(OUTSIDE)} where data have a time, got None")
    times = np.array(timed[0][TIME].values, np.float64)
    axes.check_points(TIME, times, 2, "")
    if not np.all(np.diff(times) > 0):
        twice = times[:-1][np.diff(times) <= 0][0]
        raise ValueError(f"{TIME} must have every moment once, got {twice:g} twice")
    return times


def _raise_hole(names: list[str], values: np.ndarray, known: np.ndarray, lattice: Lattice) -> None:
    bad = np.argwhere(~known)
    quantity, _, *index = bad[0]
    places = np.asarray(lattice.origin) + np.asarray(lattice.spacing) * index
    along = SPACE[: len(index)]
    at = ", ".join(f"{axis} = {place:g}" for axis, place in zip(along, places, strict=True))
    raise ValueError(
        f"{names[quantity]} must be finite everywhere, got {values[tuple(bad[0])]} at {at} "
        f"(index {', '.join(map(str, index))} from the lowest {' and '.join(along)}; {len(bad)} in all); "
        f"fill, one of {', '.join(FILLS)}, says what such holes are"
    )


def _filled(
    values: np.ndarray, how: str | None, spacing: Sequence[float], periodic: Sequence[bool]
) -> np.ndarray:
    """Values (..., points along each axis) without holes: those of the nearest point there is, or 0.

    Raises ValueError where there is nothing to fill from.
    """
    known = np.isfinite(values)
    if how == "zero":
        return np.where(known, values, 0.0)
    result, axes = values.copy(), len(spacing)
    for at in np.ndindex(values.shape[: values.ndim - axes]):
        if not known[at].any():
            raise ValueError(f"data must be finite somewhere, got none of {known[at].size} values")
        if not known[at].all():
            result[at] = values[at][_nearest(known[at], spacing, periodic)]
    return result


def _nearest(known: np.ndarray, spacing: Sequence[float], periodic: Sequence[bool]) -> tuple[np.ndarray, ...]:
    """Index arrays of the nearest known point of each point."""
    from scipy.ndimage import distance_transform_edt

    widths = [length // 2 + 1 if again else 0 for length, again in zip(known.shape, periodic, strict=True)]
    padded = np.pad(known, [(width, width) for width in widths], mode="wrap") if any(widths) else known
    index = distance_transform_edt(~padded, spacing, return_distances=False, return_indices=True)
    inner = tuple(slice(width, width + length) for width, length in zip(widths, known.shape, strict=True))
    parts = zip(index, widths, known.shape, strict=True)
    return tuple((part[inner] - width) % length for part, width, length in parts)


def _whole_cells(known: np.ndarray, periodic: Sequence[bool]) -> np.ndarray:
    """Which grid cells have values at all their corners, from points (points along each axis)."""
    for axis, again in enumerate(periodic):
        corners = np.moveaxis(known, axis, 0)
        after = np.roll(corners, -1, 0) if again else corners[1:]
        known = np.moveaxis(after & corners[: len(after)], 0, axis)
    return known
