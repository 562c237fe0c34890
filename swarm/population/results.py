"""Results of population tests: labelled arrays, the settings of their world, and their NetCDF files."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm._support import files, provenance
from swarm.physics.grids import hdf5
from swarm.physics.starts import Starts, cells_of
from swarm.physics.world import World
from swarm.physics.world.rules import PARTS, in_units

if TYPE_CHECKING:
    import xarray as xr

RIVAL = "greedy"  # the policy that every other is compared with
MAX_FILE = 2**30  # [bytes] of a results file
MAX_TEXTS = 2**22  # [bytes] of its names and attributes

Column = tuple[tuple[str, ...], type, str, str]
LIVES: dict[str, Column] = {  # name: dimensions after (policy, cell), dtype, units, long name
    "gain": ((), np.float64, "concentration", "c(end of life) − c(0)"),
    "maximal_gain": ((), np.float64, "concentration", "largest c(t) − c(0) at any decision"),
    "arrived": ((), np.bool_, "", "whether the path reached the egg"),
    "lifetime": ((), np.float64, "time", "time from the start to the end of life"),
    "decisions": ((), np.int32, "", "decisions made"),
    "arrival_time": ((), np.float64, "time", "arrival at the egg, infinite for who never came"),  # of a race
    "won": ((), np.bool_, "", "whether it arrived in time"),
}
SERIES: dict[str, Column] = {
    "time": ((), np.float64, "time", "time lived"),
    "position": (("axis",), np.float32, "length", "position"),
    "heading": ((), np.float32, "rad", "heading, counter-clockwise from +x"),
    "curvature": ((), np.float32, "1/length", "curvature chosen for the interval that ends here"),
    "centre": (("axis",), np.float32, "length", "centre of curvature"),
    "concentration": ((), np.float32, "concentration", "concentration at the position"),
    "eaten": ((), np.float32, "amount", "eaten of the medium so far"),  # where there is one
    "torsion": ((), np.float32, "1/length", "torsion of the interval that ends here"),  # in space
}
FRAMES: dict[str, Column] = {  # name: dimensions after policy; of the first world's medium
    "medium": (("frame", "x", "y"), np.float32, "concentration", "deviation, or what is carried, at nodes"),
    "medium_origin": (("frame", "axis"), np.float64, "length", "low corner of the grid"),
    "medium_time": (("frame",), np.float64, "time", "time of the frame"),
}
STARTS: dict[str, Column] = {
    "start_position": (("cell", "axis"), np.float64, "length", "position at t = 0"),
    "start_heading": (("cell",), np.float64, "rad", "heading at t = 0, counter-clockwise from +x"),
    "past": (("cell", "record"), np.int32, "", "actions before t = 0, newest first"),
}
IN_SPACE: dict[str, Column] = {  # in place of those of the plane
    "heading": (("quaternion",), np.float32, "", "frame, a unit quaternion from body to lab"),
    "centre": (("axis",), np.float32, "length", "nearest point of the axis of the helix"),
    "start_heading": (("cell", "quaternion"), np.float64, "", "frame at t = 0, a unit quaternion"),
}
COORDINATES = ("policy", "world", "cell", "axis", "quaternion", "record", "decision", "frame", "x", "y")


class ResultsError(ValueError):
    """A file that holds no results of a population test."""


def as_dataset(
    starts: Starts,
    lives: Mapping[str, Mapping[str, np.ndarray]],
    attributes: dict[str, Any],
    *,
    every: int = 1,
    world: int = 0,
    cell: int = 0,
    indexed: bool = True,
) -> xr.Dataset:
    """Labelled results of every policy's lives: arrays (cells, ...), series (cells, decisions + 1, ...) of so
    many decisions one; with several worlds, each (worlds, cells, ...); frames (frames, ...). Worlds and cells
    are numbered from `world` and `cell` on; `indexed` as of `relabelled`.
    """
    measured, cells = next(iter(lives.values())), cells_of(starts)
    axes = starts.position.shape[-1]
    longest = max(life["time"].shape[-1] for life in lives.values()) if "time" in measured else 0
    arrays: dict[str, np.ndarray] = {
        name: values.astype(STARTS[name][1]) for name, values in zip(STARTS, starts[:3], strict=True)
    }
    for name, (_, dtype, *_) in {**LIVES, **SERIES, **FRAMES}.items():
        if name not in measured:
            continue
        each = [life[name] for life in lives.values()]
        if name in SERIES:
            each = [_padded(series, len(cells), longest) for series in each]
        elif name in FRAMES:
            most = max(map(len, each))
            each = [_padded(frames.astype(dtype), 0, most) for frames in each]
        arrays[name] = np.stack(each).astype(dtype)
    arrays["policy"], arrays["axis"] = np.array(list(lives)), np.array(["x", "y", "z"])[:axes]
    if axes == 3:
        arrays["quaternion"] = np.array(["w", "x", "y", "z"])
    arrays["cell"] = cell + np.arange(cells[-1], dtype=np.int32)
    if len(cells) > 1:
        arrays["world"] = world + np.arange(cells[0], dtype=np.int32)
    if longest:
        arrays["decision"] = every * np.arange(longest, dtype=np.int32)
    units = json.loads(attributes["world"]).get("units")
    return relabelled(arrays, units, indexed=indexed).assign_attrs(attributes)


def relabelled(arrays: Mapping[str, np.ndarray], own: Any, *, indexed: bool = True) -> xr.Dataset:
    """Results of their arrays by name, coordinates among them, in a world's own units where it has some; not
    `indexed` they are made faster, but nothing can be looked up by coordinates.
    """
    import xarray as xr

    space = "quaternion" in arrays
    columns, dimensions = columns_of(space), _dimensions(worlds="world" in arrays, space=space)
    variables = {
        name: (dimensions[name], values, labels(in_units(columns[name][2], own), columns[name][3]))
        for name, values in arrays.items()
        if name not in COORDINATES
    }
    known = {name: (name, arrays[name]) for name in COORDINATES if name in arrays}
    return xr.Dataset(variables, known if indexed else xr.Coordinates(known, indexes={}))


def labels(units: str, long_name: str) -> dict[str, str]:
    """Attributes of a variable; units where there are any."""
    return {"units": units, "long_name": long_name} if units else {"long_name": long_name}


def _padded(series: np.ndarray, axis: int, length: int) -> np.ndarray:
    missing = [(0, 0)] * series.ndim
    missing[axis] = 0, length - series.shape[axis]
    return np.pad(series, missing, constant_values=np.nan)


def pooled(results: xr.Dataset) -> xr.Dataset:
    """Results whose cells are those of all worlds, one world after the other."""
    if "world" not in results.dims:
        return results
    places = results.stack(place=("world", "cell")).drop_vars(("place", "world", "cell"))
    together = places.rename(place="cell").assign_coords(
        cell=np.arange(places.sizes["place"], dtype=np.int32)
    )
    expected = _dimensions(worlds=False, space="quaternion" in results.dims)
    return together.assign(
        {name: together[name].transpose(*expected[str(name)]) for name in together.data_vars}
    )


def columns_of(space: bool) -> dict[str, Column]:
    """All variables of results, by name."""
    columns = {**STARTS, **LIVES, **SERIES, **FRAMES}
    return columns | (IN_SPACE if space else {})


def _dimensions(worlds: bool, space: bool) -> dict[str, tuple[str, ...]]:
    """What the variables of results lie along."""
    several = ("world",) * worlds
    along = {name: extra for name, (extra, *_) in columns_of(space).items()}
    found = {name: (*several, *along[name]) for name in STARTS}
    found |= {name: ("policy", *several, "cell", *along[name]) for name in LIVES}
    found |= {name: ("policy", *along[name]) for name in FRAMES}
    return found | {name: ("policy", *several, "cell", "decision", *along[name]) for name in SERIES}


def origin(world: World, seed: int) -> dict[str, Any]:
    """Attributes of what was found in a world: all that is needed to repeat it."""
    return {
        "seed": seed,
        "life": world.life,
        "world": json.dumps(world.described()),
        "versions": json.dumps(provenance.versions()),
        "commit": provenance.commit() or "",
    }


def data_of(results: xr.Dataset) -> dict[str, Any]:
    """What the gridded field and flow of results were made from, as their world tells it: file, checksum,
    shape, edges, scales.
    """
    try:
        parts = json.loads(results.attrs["world"])
        return {name: parts[name] for name in ("field", "flow") if "sha256" in parts[name]}
    except (KeyError, TypeError, ValueError, RecursionError):
        return {}


def world_of(results: xr.Dataset) -> World:
    """The world that results were made in; raises ResultsError where its field or flow is a user's own, or
    its data are not where they were."""
    try:
        stored = json.loads(results.attrs["world"])
        for name in (
            PARTS.keys() & stored.keys()
        ):  # version 0.1 had no sensors and rewards, and told the class
            names = {kind.__name__: known for known, kind in PARTS[name].registered.items()}
            kind = stored[name]["type"]
            stored[name] = {**stored[name], "type": names.get(kind, kind)}
        return World(**stored)
    except Exception as error:  # a stranger's settings fail in any way
        reason = " ".join(str(error).split())[:300] or type(error).__name__
        raise ResultsError(f"results must state the world they were made in, got {reason}") from None


def save_population(results: xr.Dataset, path: str | os.PathLike) -> None:
    """Writes results as NetCDF, whole or not at all."""
    with files.replacing(path) as temporary:
        results.to_netcdf(temporary, engine="h5netcdf")


def load_population(path: str | os.PathLike) -> xr.Dataset:
    """Results that `save_population` wrote; raises ResultsError that names the file and the rule it breaks.

    The file is checked before anything is read: nothing outside it is followed, and it holds every number it
    announces.
    """
    import xarray as xr

    path = files.expanded(path)
    try:
        _check_header(path, files.check_ordinary(path, at_most=MAX_FILE))
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as opened:
            results = opened.load()
        _check_results(results)
        return results
    except ResultsError as error:
        reason = str(error)
    except FileNotFoundError:
        reason = "it is not there"
    except Exception as error:  # h5py and xarray meet a broken file with errors of any kind
        reason = f"it must be a NetCDF file, got {str(error)[:200]}"
    raise ResultsError(f"{path} holds no results of a population test: {reason}")


def _check_header(file: Path, size: int) -> None:
    import h5py

    known, announced = {*STARTS, *LIVES, *SERIES, *FRAMES, *COORDINATES}, 0
    with hdf5.opened(file) as stored:
        for name in stored.names():
            if not isinstance(stored.file.get(name, getlink=True), h5py.HardLink):
                raise ResultsError(f"{name!r} must be stored in the file itself, got a link")
            item = stored.file[name]
            if not isinstance(item, h5py.Dataset) or name not in known:
                raise ResultsError(f"it must hold {', '.join(sorted(known))}, got {name!r}")
            announced += math.prod(item.shape or ()) * item.dtype.itemsize
            if announced > size or item.id.get_create_plist().get_nfilters():
                raise ResultsError(
                    f"it must hold all of its numbers uncompressed, got {name!r} of shape {item.shape}"
                )
            hdf5.check_stored(name, item, size)
        missing = [name for name in ("gain", *STARTS) if name not in stored.file]
        if missing:
            raise ResultsError(f"it must hold {', '.join(missing)}")
        hdf5.check_texts([stored.file, *stored.file.values()], MAX_TEXTS)


def _check_results(results: xr.Dataset) -> None:
    expected = _dimensions(worlds="world" in results.dims, space="quaternion" in results.dims)
    for name, values in results.data_vars.items():
        if values.dims != (dimensions := expected.get(str(name))):
            raise ResultsError(f"{name!r} must have the dimensions {dimensions}, got {values.dims}")
    for name in ("seed", "life", "world"):
        if name not in results.attrs:
            raise ResultsError(f"it must have the attribute {name!r}")
    if RIVAL not in results["policy"].values:
        raise ResultsError(f"one of its policies must be {RIVAL!r}")
    if not np.all(np.isfinite(results["gain"].values)):
        raise ResultsError("its gains must be finite")
