"""HDF5 files of strangers: nothing is read that is larger than its limit, whatever the file announces."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

MAX_READ = 2**20  # [bytes] at once of what describes data: names, attributes, their texts
MAX_NAMES = 1000  # of variables in a file
MAX_ATTRIBUTE = 16  # numbers, or fixed texts, of an attribute
MAX_CHUNK = 2**26  # [bytes] of numbers that are unpacked at once
FILTERS = {1: "deflate", 2: "shuffle", 3: "fletcher32", 4: "szip", 32000: "lzf", 32015: "zstd"}


class _Bounded:
    """A file of which no piece longer than `most` bytes is read: HDF5 sets memory aside for each, unused."""

    def __init__(self, file: Any) -> None:
        self.most = MAX_READ
        self._file = file
        self.read, self.seek, self.tell = file.read, file.seek, file.tell

    def readinto(self, buffer: Any) -> int:
        if len(buffer) > self.most:
            raise ValueError(
                f"it must describe its data in pieces of at most {self.most} bytes, got {len(buffer)}"
            )
        return self._file.readinto(buffer)


class Stored(NamedTuple):
    """An open file of variables: descriptions are read piece by piece, numbers only when they are asked
    for."""

    file: Any
    bounded: _Bounded

    def names(self) -> list[str]:
        """Of what is at the top of the file."""
        if len(self.file) > MAX_NAMES:
            raise ValueError(f"it must hold at most {MAX_NAMES} variables, got {len(self.file)}")
        return list(self.file)

    def variables(self) -> dict[str, Any]:
        """What is stored in the file itself, at its top."""
        import h5py

        own = [name for name in self.names() if isinstance(self.file.get(name, getlink=True), h5py.HardLink)]
        return {name: self.file[name] for name in own if isinstance(self.file[name], h5py.Dataset)}

    def numbers(self, item: Any) -> np.ndarray:
        """All numbers of a variable, which `check_stored` has passed."""
        self.bounded.most = max(MAX_READ, MAX_CHUNK, item.dtype.itemsize * math.prod(item.shape))
        try:
            return np.asarray(item[()])
        finally:
            self.bounded.most = MAX_READ


@contextmanager
def opened(path: str | os.PathLike) -> Iterator[Stored]:
    """A file to read; errors are of any kind."""
    import h5py

    with open(path, "rb") as plain, h5py.File(bounded := _Bounded(plain), "r") as file:
        yield Stored(file, bounded)


def check_stored(name: str, item: Any, at_most: int) -> None:
    """Raises ValueError unless a variable lies in the file itself, has so many values, and is unpacked in
    small pieces."""
    size = math.prod(item.shape or ())
    if size > at_most:
        raise ValueError(f"{name} must have at most {at_most} values, got {size}")
    if item.external or item.is_virtual:
        raise ValueError(f"{name} must be stored in the file itself, got a reference to another file")
    made = item.id.get_create_plist()
    for i in range(made.get_nfilters()):
        number, *_, text = made.get_filter(i)
        if number not in FILTERS:
            rule = f"{name} must be packed by {', '.join(FILTERS.values())} only"
            raise ValueError(f"{rule}, got the filter {as_text(text) or number}")
    chunk = math.prod(item.chunks or ()) * item.dtype.itemsize if item.chunks else 0
    if chunk > MAX_CHUNK:
        raise ValueError(f"{name} must be stored in chunks of at most {MAX_CHUNK} bytes, got {chunk}")


def attribute(item: Any, name: str) -> Any:
    """An attribute: text, or numbers as an array; None where it is missing or empty.

    Raises ValueError where it holds more than attributes do.
    """
    if name not in item.attrs:
        return None
    about = item.attrs.get_id(name)
    if about.shape is None or 0 in about.shape:
        return None
    size, dtype = math.prod(about.shape), about.dtype
    most = 1 if dtype.kind == "O" else MAX_ATTRIBUTE  # every text of variable length may be a long one
    if size > most or dtype.itemsize > MAX_READ:
        raise ValueError(f"attribute {name} must have at most {most} values, got {size}")
    if dtype.kind not in "fiuSUOb":
        raise ValueError(f"attribute {name} must be text or numbers, got {dtype}")
    value = item.attrs[name]
    return as_text(value) if dtype.kind in "SUO" else np.ravel(value)


def check_texts(items: Iterable[Any], at_most: int) -> None:
    """Raises ValueError unless all attributes, and texts that are stored as numbers are, make up no more
    bytes than that.
    """
    total = 0
    for item in items:
        if len(item.attrs) > MAX_NAMES:
            raise ValueError(f"it must have at most {MAX_NAMES} attributes, got {len(item.attrs)}")
        for name in item.attrs:
            about = item.attrs.get_id(name)
            size = math.prod(about.shape or (0,))
            if about.dtype.kind == "O" and not _is_text(about.dtype):  # references to dimensions
                if size > MAX_ATTRIBUTE:
                    raise ValueError(f"attribute {name} must have at most {MAX_ATTRIBUTE} values, got {size}")
            elif about.dtype.kind == "O":
                total += len(attribute(item, name) or "")
            else:
                total += size * about.dtype.itemsize
        if item.name != "/" and item.dtype.kind == "O":
            if not _is_text(item.dtype) or item.size > MAX_NAMES:
                raise ValueError(f"{item.name} must hold at most {MAX_NAMES} texts, got {item.size}")
            for place in np.ndindex(item.shape):
                total += len(item[place])
                _check_total(total, at_most)
        _check_total(total, at_most)


def _is_text(dtype: np.dtype) -> bool:
    import h5py

    return h5py.check_string_dtype(dtype) is not None


def _check_total(total: int, at_most: int) -> None:
    if total > at_most:
        raise ValueError(f"its texts must have at most {at_most} bytes in all, got {total} or more")


def as_text(value: Any) -> str:
    """Text of an attribute as files have it: in UTF-8 or Latin-1, alone or in an array, or empty."""
    if value is None or isinstance(value, (str, bytes)):
        found = value or ""
    else:
        first = np.ravel(np.asarray(value, object))[:1].tolist()
        found = first[0] if first and isinstance(first[0], (str, bytes)) else ""
    found = found.encode("utf-8", "surrogateescape") if isinstance(found, str) else found
    try:
        return found.rstrip(b"\0").decode()
    except UnicodeDecodeError:
        return found.rstrip(b"\0").decode("latin-1")
