"""Storage: blocks of results put together, in memory or in a NetCDF file that is written part by part."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import safetensors.numpy

from swarm._support import files
from swarm.population.results import COORDINATES, SERIES, relabelled

if TYPE_CHECKING:
    import xarray as xr

WORDS = "words"  # a part's coordinates that are no numbers, in its metadata


def joined(parts: Iterable[xr.Dataset], sizes: Mapping[str, int], attributes: dict[str, Any]) -> xr.Dataset:
    """Results of a whole population, of which each part holds cells of some worlds; `sizes` are the whole's.

    Frames are those of the first part.
    """
    import xarray as xr

    whole: dict[str, xr.Variable] = {}
    for part in parts:
        for name, values in part.variables.items():
            if name not in whole:
                shape = [sizes.get(str(each), part.sizes[each]) for each in values.dims]
                filled = np.full(shape, np.nan if name in SERIES else 0, values.dtype)
                whole[str(name)] = xr.Variable(values.dims, filled, values.attrs)
            whole[str(name)].values[_place(part, values.dims)] = values.values
    coordinates = {name: whole.pop(name) for name in COORDINATES if name in whole}
    return xr.Dataset(whole, coordinates, attributes)


def parts_of(path: Path) -> Path:
    """The folder where the parts of a file lie until it is whole."""
    return path.with_name(f"{path.name}.parts")


class Storage:
    """A NetCDF file, and beside it until it is whole the folder of its parts, each a file of arrays."""

    def __init__(self, path: str | os.PathLike, identity: dict[str, Any]) -> None:
        self.path, self.told = files.expanded(path), json.dumps(identity, sort_keys=True, indent=1)
        self.folder = parts_of(self.path)
        if self.path.exists() and not self.is_whole:
            raise FileExistsError(f"{self.path} must be new or hold the same population, got another file")

    @property
    def is_whole(self) -> bool:
        """Whether the file is there, of the same population."""
        import xarray as xr

        try:
            with xr.open_dataset(self.path, engine="h5netcdf", decode_times=False) as there:
                return bool(there.attrs.get("identity") == self.told)
        except (OSError, ValueError):
            return False

    @contextmanager
    def owned(self) -> Iterator[None]:
        """Within, no other process writes; raises FileExistsError where one does, or where the parts that are
        there are of another population.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with files.owned(self.folder):
            about = self.folder / "population.json"
            if about.exists() and (stored := about.read_text(encoding="utf-8")) != self.told:
                then, now = json.loads(stored), json.loads(self.told)
                other = ", ".join(key for key in now if then.get(key) != now[key])
                raise FileExistsError(
                    f"{self.folder} must hold parts of this population, got another {other}"
                )
            files.write_text(about, self.told)
            yield

    def _file(self, number: int) -> Path:
        return self.folder / f"{number:07d}.safetensors"

    def has(self, number: int) -> bool:
        return self._file(number).exists()

    def write(self, number: int, part: xr.Dataset) -> None:
        """Writes a part, whole or not at all."""
        columns = {str(name): each.values for name, each in part.variables.items()}
        words = {name: each.tolist() for name, each in columns.items() if each.dtype.kind in "OUT"}
        numbers = {name: np.ascontiguousarray(each) for name, each in columns.items() if name not in words}
        with files.replacing(self._file(number)) as temporary:
            safetensors.numpy.save_file(numbers, temporary, {WORDS: json.dumps(words)})

    def part(self, number: int) -> xr.Dataset:
        """A part that is there, in which nothing can be looked up by coordinates."""
        with safetensors.safe_open(self._file(number), "numpy") as stored:
            words = json.loads(stored.metadata()[WORDS])
            columns = {name: np.array(each) for name, each in words.items()}
            columns |= {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
        return relabelled(columns, json.loads(json.loads(self.told)["world"]).get("units"), indexed=False)

    def opened(self) -> xr.Dataset:
        """The whole, whose numbers are read when they are asked for."""
        import xarray as xr

        return xr.open_dataset(self.path, engine="h5netcdf", decode_times=False)

    def join(
        self,
        parts: Iterable[xr.Dataset],
        sizes: Mapping[str, int],
        attributes: Callable[[], dict[str, Any]],
    ) -> None:
        """Writes what `joined` returns part by part, in chunks of a part's cells, and removes the parts; the
        attributes are asked for when all are written.
        """
        import h5netcdf
        import h5py

        made: dict[str, Any] = {}  # by h5py, which does not look up its dimensions for every part
        with (
            files.replacing(self.path) as temporary,
            h5py.File(temporary, "w", rdcc_nbytes=0) as whole,
            h5netcdf.File(whole, "w") as file,
        ):
            for part in parts:
                for name, values in part.variables.items():
                    numbers, labels = values.values, dict(values.attrs)
                    if numbers.dtype == bool:  # as xarray stores it
                        numbers, labels = numbers.astype(np.int8), labels | {"dtype": "bool"}
                    if name not in made:
                        for each in values.dims:
                            if each not in file.dimensions:
                                file.dimensions[each] = sizes.get(str(each), part.sizes[each])
                        _variable(file, str(name), values.dims, numbers, labels)
                        made[str(name)] = whole[str(name)]
                    made[str(name)][_place(part, values.dims)] = numbers
            for key, value in {**attributes(), "identity": self.told}.items():
                file.attrs[key] = value
        shutil.rmtree(self.folder, ignore_errors=True)


def _variable(file: Any, name: str, dimensions: Any, numbers: np.ndarray, labels: dict[str, Any]) -> None:
    import h5py

    options: dict[str, Any] = {"fillvalue": np.nan} if numbers.dtype.kind == "f" else {}
    if "cell" in dimensions:
        pieces = zip(dimensions, numbers.shape, strict=True)
        options["chunks"] = tuple(1 if each == "policy" else size for each, size in pieces)
    dtype = h5py.string_dtype() if numbers.dtype.kind in "OUT" else numbers.dtype
    made = file.create_variable(name, dimensions, dtype, **options)
    for key, value in labels.items():
        made.attrs[key] = value


def _place(part: xr.Dataset, dimensions: Iterable[Any]) -> tuple[slice, ...]:
    """Where a part's values lie within the whole's."""
    first = {each: int(part[each].values[0]) for each in ("world", "cell") if each in part.sizes}
    return tuple(slice(first.get(each, 0), first.get(each, 0) + part.sizes[each]) for each in dimensions)
