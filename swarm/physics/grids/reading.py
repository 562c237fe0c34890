"""Reading quantities on a regular grid from xarray objects and NetCDF files, and checking all that can be
wrong."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarm._support.checks import check_name
from swarm.physics.grids.splines import MIN_POINTS, Lattice

AXES = ("x", "y")
EDGES = ("periodic", "clamped")
MAX_VALUES = 2**26  # of one quantity; 512 MB
MAX_POINTS = 2**24  # of one coordinate
HDF5 = b"\x89HDF\r\n\x1a\n"


class Grid:
    """Quantities on a lattice, as they were read and checked."""

    def __init__(self, values: np.ndarray, lattice: Lattice, units: dict[str, str]) -> None:
        self.values = values  # (quantities, nx, ny) float64
        self.lattice = lattice
        self.units = units  # of x, y and the quantities, where they are stated


def read_grid(data: Any, names: Sequence[str] | None, *, edges: str, interpolation: str) -> Grid:
    """The quantities `names` of an xarray Dataset, a DataArray or a NetCDF-4 file.

    Without `names` there must be one quantity only. Raises ValueError, TypeError or OSError that names the
    variable, the rule and what is there instead.
    """
    check_name("edges", edges, EDGES)
    check_name("interpolation", interpolation, MIN_POINTS)
    arrays = _arrays(data, names)
    for name, array in arrays.items():
        _check_array(name, array)
    x, y = (_coordinate(name, array, axis) for name, array in list(arrays.items())[:1] for axis in AXES)
    for name, array in arrays.items():
        for axis, places in zip(AXES, (x, y), strict=True):
            if not np.array_equal(_coordinate(name, array, axis), places, equal_nan=True):
                raise ValueError(
                    f"{axis} of {name} must be that of the other variables, got {array.sizes[axis]} points"
                )
    values = np.stack([_numbers(name, array) for name, array in arrays.items()])
    # coordinates may run downwards
    values = values[:, :: 1 if x[0] < x[-1] else -1, :: 1 if y[0] < y[-1] else -1]
    starts_and_steps = [
        _regular(axis, np.sort(places), interpolation) for axis, places in zip(AXES, (x, y), strict=True)
    ]
    origin, spacing = zip(*starts_and_steps, strict=True)
    lattice = Lattice(origin, spacing, values.shape[1:], edges == "periodic")
    _check_finite(list(arrays), values, lattice)
    if lattice.periodic:
        _check_period(list(arrays), values)
    first = next(iter(arrays.values()))
    stated = {axis: first[axis].attrs.get("units") for axis in AXES}
    stated |= {name: array.attrs.get("units") for name, array in arrays.items()}
    return Grid(values, lattice, {name: str(unit) for name, unit in stated.items() if unit is not None})


def _arrays(data: Any, names: Sequence[str] | None) -> dict[str, Any]:
    """The variables by name, as xarray DataArrays."""
    if isinstance(data, (str, os.PathLike)):
        data = open_netcdf(data, names)
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
        candidates = [str(name) for name, array in data.data_vars.items() if set(AXES) <= set(array.dims)]
        if len(candidates) != 1:
            raise ValueError(
                f"variable must be named where data hold more or less than one over x and y, got {candidates}"
            )
        names = candidates
    known = [str(name) for name in data.data_vars]
    return {name: data[check_name("variable", name, known)] for name in names}


def _check_array(name: str, array: Any) -> None:
    if set(array.dims) != set(AXES):
        raise ValueError(
            f"{name} must have the dimensions x and y and no others, got {tuple(str(d) for d in array.dims)}"
        )
    if array.size > MAX_VALUES:
        raise ValueError(f"{name} must have at most {MAX_VALUES} values, got {array.size}")
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} must hold real numbers, got {array.dtype}")


def _numbers(name: str, array: Any) -> np.ndarray:
    return np.asarray(array.transpose(*AXES).values, np.float64)


def _coordinate(name: str, array: Any, axis: str) -> np.ndarray:
    if axis not in array.coords:
        raise ValueError(
            f"{name} must have the coordinate {axis}, got {sorted(str(c) for c in array.coords)}"
        )
    places = array[axis]
    if places.dtype.kind not in "fiu":
        raise ValueError(f"{axis} must hold real numbers, got {places.dtype}")
    return np.asarray(places.values, np.float64)


def _regular(axis: str, places: np.ndarray, interpolation: str) -> tuple[float, float]:
    """First point and spacing of rising coordinates; raises ValueError unless they are evenly spaced."""
    fewest = MIN_POINTS[interpolation]
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
        x, y = (lattice.origin[axis] + lattice.spacing[axis] * index for axis, index in ((0, i), (1, j)))
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


# --- units --------------------------------------------------------------------------------------------------


def check_units(units: dict[str, str], velocity: Sequence[str] = (), spin: str | None = None) -> str | None:
    """The unit of length, where stated; raises ValueError where units contradict each other."""
    _check_same(units, AXES)
    _check_same(units, velocity)
    length = units.get("x", units.get("y"))
    per_time = None
    for name in velocity:
        stated = re.fullmatch(
            r"\s*(.+?)\s*(?:/\s*|[\s·.*]+)(\w+?)\s*((?:\^|\*\*)?\(?[-−]1\)?)?\s*", units.get(name, "")
        )
        if stated:
            per_time = stated[2]
            if length is not None and stated[1] != length:
                raise ValueError(f"{name} must be in {length} per time like x and y, got {units[name]!r}")
    if spin is not None and spin in units:
        unit = units[spin]
        if re.search("deg|rev|turn|Hz", unit):
            raise ValueError(f"{spin} must be in radians per time, got {unit!r}")
        if per_time is not None and not re.search(rf"\b{re.escape(per_time)}\b", unit):
            raise ValueError(f"{spin} must be in radians per {per_time} like {velocity[0]}, got {unit!r}")
    return length


def _check_same(units: dict[str, str], names: Sequence[str]) -> None:
    stated = {name: units[name] for name in names if name in units}
    if len(set(stated.values())) > 1:
        raise ValueError(
            f"{' and '.join(stated)} must have the same units, got {' and '.join(map(repr, stated.values()))}"
        )


# --- files --------------------------------------------------------------------------------------------------


def open_netcdf(path: str | os.PathLike, names: Sequence[str] | None) -> Any:
    """The variables `names` (all over x and y where None) of a NetCDF-4 file, as a loaded Dataset.

    The header is checked before anything is read: nothing but the file itself is followed, and nothing larger
    than the limits is loaded, whatever the header announces.
    """
    file = Path(path)
    if not file.exists():
        raise FileNotFoundError(f"data must be a file that exists, got {file}")
    if not file.is_file():
        raise ValueError(f"data must be an ordinary file, got {file}")
    with file.open("rb") as opened:
        signature = opened.read(len(HDF5))
    if signature != HDF5:
        hint = (
            "; open older files with xarray.open_dataset and pass the result"
            if signature[:3] == b"CDF"
            else ""
        )
        raise ValueError(f"{file} must be a NetCDF-4 file{hint}")
    try:
        return _read(file, names)
    except _HeaderError as error:
        raise ValueError(f"{file}: {error}") from None
    except MemoryError:
        raise
    except Exception as error:  # h5py and xarray meet a broken file with errors of any kind
        raise ValueError(f"{file} must be a readable NetCDF-4 file, got {str(error)[:200]}") from None


class _HeaderError(ValueError):
    pass


def _read(file: Path, names: Sequence[str] | None) -> Any:
    import h5py
    import xarray as xr

    with h5py.File(file, "r") as opened:
        own = [name for name in opened if isinstance(opened.get(name, getlink=True), h5py.HardLink)]
        stored = {name: opened[name] for name in own if isinstance(opened[name], h5py.Dataset)}
        if names is None:
            names = [name for name, item in stored.items() if name not in AXES and len(item.shape or ()) == 2]
        for name in names:
            check_name("variable", name, [known for known in stored if known not in AXES])
        variables = {}
        for name in [*names, *(axis for axis in AXES if axis in stored)]:
            _check_header(name, stored[name])
            variables[name] = (_dimensions(name, stored[name]), stored[name][()], _attributes(stored[name]))
    coordinates = {axis: variables.pop(axis) for axis in AXES if axis in variables}
    return xr.decode_cf(xr.Dataset(variables, coordinates), decode_times=False)


def _check_header(name: str, item: Any) -> None:
    """Raises where a variable is not what it should be, before any of it is read."""
    limit = MAX_POINTS if name in AXES else MAX_VALUES
    size = math.prod(item.shape or ())
    if size > limit:
        raise _HeaderError(f"{name} must have at most {limit} values, got {size}")
    if item.dtype.kind not in "fiu" or item.dtype.itemsize > 16:
        raise _HeaderError(f"{name} must hold real numbers, got {item.dtype}")
    if item.external or item.is_virtual:
        raise _HeaderError(f"{name} must be stored in the file itself, got a reference to another file")


def _dimensions(name: str, item: Any) -> tuple[str, ...]:
    if name in AXES and len(item.shape) == 1:
        return (name,)
    if not all(len(dimension) for dimension in item.dims):
        raise _HeaderError(f"{name} must have named dimensions, got {item.shape}")
    return tuple(dimension[0].name.rsplit("/", 1)[-1] for dimension in item.dims)


def _attributes(item: Any) -> dict[str, Any]:
    """What is needed to unpack a variable, and its units."""
    attributes = {}
    for name in ("units", "scale_factor", "add_offset", "_FillValue", "missing_value"):
        if name in item.attrs:
            value = item.attrs[name]
            attributes[name] = value.decode() if isinstance(value, bytes) else np.ravel(value)[0]
    return attributes
