"""NetCDF-4 files of data: checked before anything is read, known by their checksum, found again elsewhere."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarm._support import files
from swarm._support.checks import check_name
from swarm.physics.grids import hdf5
from swarm.physics.grids.units import AXES, SPACE, TIME

COORDINATES = (*SPACE, TIME)
# what is needed to unpack a variable, its units, and after what length a coordinate repeats
PACKING = ("scale_factor", "add_offset", "_FillValue", "missing_value", "_Unsigned", "dtype")
ATTRIBUTES = (*PACKING, "units", "period", "modulo")
MAX_FILE = 2**33  # [bytes]
MAX_VALUES = 2**26  # of one quantity; 512 MB
MAX_POINTS = 2**24  # of one coordinate


def checksum(path: str | os.PathLike) -> str:
    """SHA-256 of an ordinary file; raises FileNotFoundError or ValueError for anything else."""
    file = files.expanded(path)
    if not file.exists():
        raise FileNotFoundError(f"data must be a file that exists, got {file}")
    files.check_ordinary(file, at_most=MAX_FILE)
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def located(path: str, sha256: str | None, elsewhere: Iterable[Path]) -> str:
    """`path`, or the first of the places `elsewhere` where the file with this SHA-256 is.

    Raises FileNotFoundError where there are none, ValueError where there are only others.
    """
    places = list(dict.fromkeys([path, *map(str, elsewhere)]))
    found = {place: checksum(place) for place in places if os.path.isfile(place)}
    for place, number in found.items():
        if sha256 in (None, number):
            return place
    if not found:
        raise FileNotFoundError(f"data must be a file that exists, got none of {', '.join(places)}")
    others = ", ".join(f"{place} with {number}" for place, number in found.items())
    raise ValueError(f"data must be the file {path} with SHA-256 {sha256}, got {others}")


def open_netcdf(path: str | os.PathLike, names: Sequence[str] | None) -> Any:
    """The variables `names` (all over x and y where None) of a NetCDF-4 file, as a loaded xarray Dataset.

    Nothing but the file itself is followed, and nothing larger than the limits is loaded, whatever its header
    announces. Raises ValueError that names the file, the variable and the rule.
    """
    import h5py

    if not h5py.is_hdf5(path):
        raise ValueError(
            f"{path} must be a NetCDF-4 file; open others with xarray.open_dataset and pass the result"
        )
    try:
        return _read(path, names)
    except MemoryError:
        raise
    except Exception as error:  # h5py and xarray meet a broken file with errors of any kind
        raise ValueError(f"{path} must be a readable NetCDF-4 file: {str(error)[:300]}") from None


def _read(path: str | os.PathLike, names: Sequence[str] | None) -> Any:
    import xarray as xr

    with hdf5.opened(path) as file:
        stored = file.variables()
        quantities = [name for name, item in stored.items() if not _is_coordinate(name, item)]
        if names is None:
            most = len(COORDINATES) - ("z" in quantities or "z" not in stored)
            names = [name for name in quantities if len(AXES) <= len(stored[name].shape or ()) <= most]
        for name in names:
            _check(check_name("variable", name, quantities), stored[name], MAX_VALUES)
        over = {axis for name in names for axis in _dimensions(name, stored[name])}
        axes = [axis for axis in COORDINATES if axis in over & stored.keys()]
        axes = [axis for axis in axes if not _only_dimension(stored[axis])]
        for axis in axes:
            _check(axis, stored[axis], MAX_POINTS)
        variables = {name: _decoded(name, stored[name], file) for name in (*names, *axes)}
    coordinates = {axis: variables.pop(axis) for axis in axes}
    return xr.Dataset(variables, coordinates)


def _is_coordinate(name: str, item: Any) -> bool:
    """Whether a name is that of a coordinate; z may also be a quantity over x and y."""
    return name in COORDINATES and (name != "z" or len(item.shape or ()) == 1)


def _check(name: str, item: Any, at_most: int) -> None:
    """Raises where a variable is not what it should be, before any of it is read."""
    hdf5.check_stored(name, item, at_most)
    if item.dtype.kind not in "fiu" or item.dtype.itemsize > 16:
        raise ValueError(f"{name} must hold real numbers, got {item.dtype}")


def _only_dimension(item: Any) -> bool:
    """Whether it stands for a dimension that has no coordinate."""
    label = hdf5.attribute(item, "NAME")
    return isinstance(label, str) and label.startswith("This is a netCDF dimension but not a netCDF variable")


def _decoded(name: str, item: Any, file: hdf5.Stored) -> Any:
    """A variable as xarray decodes it: unpacked, and NaN where it is missing."""
    import xarray as xr

    found = {key: hdf5.attribute(item, key) for key in ATTRIBUTES}
    attributes: dict[str, Any] = {
        key: value[0] if isinstance(value, np.ndarray) and len(value) == 1 else value
        for key, value in found.items()
        if value is not None
    }
    variable = xr.Variable(_dimensions(name, item), file.numbers(item), attributes)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of several fill values, which are all taken
            return xr.conventions.decode_cf_variable(name, variable, decode_times=False).load()
    except Exception as error:
        raise ValueError(f"{name} must be decodable by {attributes}, got {error}") from None


def _dimensions(name: str, item: Any) -> tuple[str, ...]:
    if _is_coordinate(name, item):
        if len(item.shape or ()) != 1:
            raise ValueError(f"{name} must have one dimension, got {item.shape}")
        return (name,)
    if "DIMENSION_LIST" in item.attrs and item.attrs.get_id("DIMENSION_LIST").shape != (len(item.shape),):
        raise ValueError(f"{name} must have a name for each of its dimensions, got {item.shape}")
    if not all(len(dimension) for dimension in item.dims):
        raise ValueError(f"{name} must have named dimensions, got {item.shape}")
    return tuple(dimension[0].name.rsplit("/", 1)[-1] for dimension in item.dims)
