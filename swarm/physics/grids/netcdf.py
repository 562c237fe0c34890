"""NetCDF-4 files of data: checked before anything is read, known by their checksum, found again elsewhere."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarm._support import files
from swarm._support.checks import check_name

AXES = ("x", "y")
MAX_FILE = 2**33  # [bytes]
MAX_VALUES = 2**26  # of one quantity; 512 MB
MAX_POINTS = 2**24  # of one coordinate


def checksum(path: str | os.PathLike) -> str:
    """SHA-256 of an ordinary file; raises FileNotFoundError or ValueError for anything else."""
    file = files.expanded(path)
    if not file.exists():
        raise FileNotFoundError(f"data must be a file that exists, got {file}")
    if not file.is_file():
        raise ValueError(f"data must be an ordinary file, got {file}")
    if file.stat().st_size > MAX_FILE:
        raise ValueError(f"{file} must have at most {MAX_FILE} bytes, got {file.stat().st_size}")
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
    import h5py
    import xarray as xr

    with h5py.File(path, "r") as opened:
        own = [name for name in opened if isinstance(opened.get(name, getlink=True), h5py.HardLink)]
        stored = {name: opened[name] for name in own if isinstance(opened[name], h5py.Dataset)}
        if names is None:
            names = [name for name, item in stored.items() if name not in AXES and len(item.shape or ()) == 2]
        for name in names:
            check_name("variable", name, [known for known in stored if known not in AXES])
        wanted = {name: stored[name] for name in (*names, *AXES) if name in stored}
        for name, item in wanted.items():
            _check_header(name, item)
        variables = {
            name: (_dimensions(name, item), item[()], _attributes(item)) for name, item in wanted.items()
        }
    coordinates = {axis: variables.pop(axis) for axis in AXES if axis in variables}
    return xr.decode_cf(xr.Dataset(variables, coordinates), decode_times=False)


def _check_header(name: str, item: Any) -> None:
    """Raises where a variable is not what it should be, before any of it is read."""
    limit = MAX_POINTS if name in AXES else MAX_VALUES
    size = math.prod(item.shape or ())
    if size > limit:
        raise ValueError(f"{name} must have at most {limit} values, got {size}")
    if item.dtype.kind not in "fiu" or item.dtype.itemsize > 16:
        raise ValueError(f"{name} must hold real numbers, got {item.dtype}")
    if item.external or item.is_virtual:
        raise ValueError(f"{name} must be stored in the file itself, got a reference to another file")


def _dimensions(name: str, item: Any) -> tuple[str, ...]:
    if name in AXES and len(item.shape) == 1:
        return (name,)
    if not all(len(dimension) for dimension in item.dims):
        raise ValueError(f"{name} must have named dimensions, got {item.shape}")
    return tuple(dimension[0].name.rsplit("/", 1)[-1] for dimension in item.dims)


def _attributes(item: Any) -> dict[str, Any]:
    """What is needed to unpack a variable, and its units."""
    wanted = ("units", "scale_factor", "add_offset", "_FillValue", "missing_value")
    values = {name: item.attrs[name] for name in wanted if name in item.attrs}
    return {
        name: value.decode() if isinstance(value, bytes) else np.ravel(value)[0]
        for name, value in values.items()
    }
