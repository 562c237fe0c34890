"""Tables of the Taylor–Green flow on the disk: shipped with the software, or kept once they have been
computed.

A file is named by a digest of all its parameters and states them; with its tensors goes their digest. It is
safetensors, which cannot run anything; whatever is wrong with it, it is set aside and the tables are
computed anew.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from swarm._support import files
from swarm.optimal.problem import Problem
from swarm.optimal.tables import VortexLimit, VortexTables

SHIPPED = Path(__file__).parents[1] / "zoo" / "limits"
CACHE = "CHEMOSWARM_CACHE"  # environment variable: the folder for what is computed
SCHEME = 1  # rises when the same parameters give other tables
MAX_FILE = 256 * 2**20  # [bytes]
MAX_HEADER = 64 * 2**10  # [bytes]
METADATA = "chemoswarm"

Tables = type[VortexLimit] | type[VortexTables]
NAMES: dict[Tables, str] = {VortexLimit: "limit", VortexTables: "policy"}


def cache_folder() -> Path:
    """Where tables are kept: $CHEMOSWARM_CACHE, else chemoswarm in the user's folder for caches."""
    if chosen := os.environ.get(CACHE):
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "chemoswarm"


def key_of(kind: Tables, problem: Problem, grids: tuple[tuple[int, int], ...]) -> dict[str, Any]:
    """All that the tables depend on."""
    assert problem.flow is not None
    parameters = {item.name: getattr(problem, item.name) for item in dataclasses.fields(problem)}
    parameters["flow"] = {"speed_scale": problem.flow.speed_scale, "wavenumber": problem.flow.wavenumber}
    plain = {"kind": NAMES[kind], "scheme": SCHEME, "grids": grids, **parameters}
    return json.loads(json.dumps(plain))


def file_name(key: dict[str, Any]) -> str:
    """The name of the file with these tables."""
    digest = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()
    return f"taylor_green_{key['kind']}_{digest[:16]}.safetensors"


@lru_cache(maxsize=8)
def tables(kind: Any, problem: Problem, grids: tuple[tuple[int, int], ...]) -> Any:
    """The tables, shipped, kept or computed; what takes long or goes wrong is said in a line."""
    key = key_of(kind, problem, grids)
    for folder in (SHIPPED, cache_folder()):
        path = folder / file_name(key)
        try:
            if path.exists():
                return kind(problem, grids, read(path, key, kind.shapes(problem, grids)))
        except (OSError, ValueError) as error:
            _say(f"{path} is not used, its tables are computed anew: {error}")
    with shown_progress(f"Optimal {key['kind']} in the Taylor–Green flow") as progress:
        computed = kind.compute(problem, grids, progress)
    path = cache_folder() / file_name(key)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, key, computed.tensors)
    except OSError as error:
        _say(f"{path} could not be written, so its tables will be computed again: {error}")
    return computed


def write(path: Path, key: dict[str, Any], tensors: dict[str, np.ndarray]) -> None:
    """Writes tables, whole or not at all."""
    from safetensors.numpy import save

    metadata = {METADATA: json.dumps({"key": key, "digest": _digest(tensors)}, sort_keys=True)}
    ordered = {name: np.ascontiguousarray(tensors[name]) for name in sorted(tensors)}
    files.write_bytes(path, save(ordered, metadata=metadata))


def read(
    path: Path, key: dict[str, Any], shapes: dict[str, tuple[type, tuple[int, ...]]]
) -> dict[str, np.ndarray]:
    """The tensors of a file; raises ValueError unless they are all that `key` asks for, whole and finite."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    data = files.read_bytes(path, at_most=MAX_FILE)
    stated = _metadata(data)
    if stated.get("key") != key:
        raise ValueError("it must hold the tables for these parameters")
    try:
        tensors = load(data)
    except SafetensorError as error:
        raise ValueError(f"it must be a valid safetensors file, got {error}") from None
    if set(tensors) != set(shapes):
        raise ValueError(f"its tensors must be {', '.join(sorted(shapes))}, got {', '.join(sorted(tensors))}")
    for name, (dtype, shape) in shapes.items():
        tensor = tensors[name]
        if tensor.dtype != dtype or tensor.shape != shape or not np.isfinite(tensor).all():
            raise ValueError(
                f"{name} must be finite {np.dtype(dtype)} {shape}, got {tensor.dtype} {tensor.shape}"
            )
    if stated.get("digest") != _digest(tensors):
        raise ValueError("its tensors must be the ones it was written with")
    return tensors


def _metadata(data: bytes) -> dict[str, Any]:
    rule = "it must be a safetensors file with the parameters of its tables"
    if len(data) < 8:
        raise ValueError(rule)
    (size,) = struct.unpack("<Q", data[:8])
    if size > min(MAX_HEADER, len(data) - 8):
        raise ValueError(rule)
    try:
        stated = json.loads(json.loads(data[8 : 8 + size])["__metadata__"][METADATA])
    except (ValueError, KeyError, TypeError, RecursionError):
        raise ValueError(rule) from None
    if not isinstance(stated, dict):
        raise ValueError(rule)
    return stated


def _digest(tensors: dict[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(np.ascontiguousarray(tensors[name]).tobytes())
    return digest.hexdigest()


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


@contextmanager
def shown_progress(title: str) -> Iterator[Any]:
    """A bar on a terminal, else one line."""
    if not sys.stderr.isatty():
        _say(f"{title}: computing it once, which may take a minute or two")
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)
