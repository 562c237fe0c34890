"""Tables that take long on the disk: shipped with the software, or kept once they have been computed.

A file is named by a digest of all its parameters and states them; with its tensors goes their digest. It is
safetensors, which cannot run anything; whatever is wrong with it, it is set aside and the tables are
computed anew.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from swarm._support import tensors
from swarm._support.terminal import Progress, tell
from swarm.optimal.helical import HelicalLimit, Spheres
from swarm.optimal.problem import Problem
from swarm.optimal.tables import Grids, Shapes, VortexLimit, VortexTables

SHIPPED = Path(__file__).parents[1] / "zoo" / "limits"
CACHE = "CHEMOSWARM_CACHE"  # environment variable: the folder for what is computed
SCHEME = 1  # rises when the same parameters give other tables
MAX_FILE = 256 * 2**20  # [bytes]

Tables = type[VortexLimit] | type[VortexTables] | type[HelicalLimit]


def cache_folder() -> Path:
    """Where tables are kept: $CHEMOSWARM_CACHE, else the platform's folder for caches of this software."""
    return Path(os.environ.get(CACHE) or platformdirs.user_cache_path("chemoswarm", appauthor=False))


def key_of(kind: Tables, problem: Problem, grids: Grids | Spheres) -> dict[str, Any]:
    """All that the tables depend on."""
    parameters = {item.name: getattr(problem, item.name) for item in dataclasses.fields(problem)}
    parameters = {name: value for name, value in parameters.items() if value is not None and name != "dense"}
    if problem.flow is not None:
        parameters["flow"] = {"speed_scale": problem.flow.speed_scale, "wavenumber": problem.flow.wavenumber}
    plain = {"kind": kind.name, "scheme": SCHEME, "grids": grids, **parameters}
    return json.loads(json.dumps(plain))


def file_name(key: dict[str, Any]) -> str:
    """The name of the file with these tables."""
    digest = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()
    where = "taylor_green" if "flow" in key else "space"
    return f"{where}_{key['kind']}_{digest[:16]}.safetensors"


@lru_cache(maxsize=8)
def tables(kind: Any, problem: Problem, grids: Grids | Spheres) -> Any:
    """The tables, shipped, kept or computed; what takes long or goes wrong is said in a line."""
    key = key_of(kind, problem, grids)
    for folder in (SHIPPED, cache_folder()):
        path = folder / file_name(key)
        try:
            if path.exists():
                return kind(problem, grids, read(path, key, kind.shapes(problem, grids)))
        except (OSError, ValueError) as error:
            tell(f"{path} is not used, its tables are computed anew: {error}")
    slow = problem.flow is not None
    where = "the Taylor–Green flow" if slow else "space"
    with shown_progress(f"Optimal {key['kind']} in {where}", slow) as progress:
        computed = kind.compute(problem, grids, progress)
    path = cache_folder() / file_name(key)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, key, computed.tensors)
    except OSError as error:
        tell(f"{path} could not be written, so its tables will be computed again: {error}")
    return computed


def write(path: Path, key: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """Writes tables, whole or not at all."""
    tensors.write(path, arrays, {"key": key, "digest": _digest(arrays)})


def read(path: Path, key: dict[str, Any], shapes: Shapes) -> dict[str, np.ndarray]:
    """The arrays of a file; raises ValueError unless they are all that `key` asks for, whole and finite."""

    def check(card: dict[str, Any], stored: tensors.Shapes) -> None:
        if card.get("key") != key:
            raise ValueError("it must hold the tables for these parameters")
        if stored.keys() != shapes.keys():
            raise ValueError(f"its tensors must be {', '.join(shapes)}, got {', '.join(stored)}")

    arrays, card = tensors.read(path, check, at_most=MAX_FILE)
    for name, (dtype, shape) in shapes.items():
        array = arrays[name]
        if array.dtype != dtype or array.shape != shape or not np.isfinite(array).all():
            raise ValueError(
                f"{name} must be finite {np.dtype(dtype)} {shape}, got {array.dtype} {array.shape}"
            )
    if card.get("digest") != _digest(arrays):
        raise ValueError("its tensors must be the ones it was written with")
    return arrays


def _digest(arrays: dict[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()


@contextmanager
def shown_progress(title: str, slow: bool = True) -> Iterator[Any]:
    """A bar on a terminal, else a line now and then, and for `slow` work one at once."""
    with Progress(title, 1.0) as bar:
        if bar.disable and slow:
            bar.say(f"{title}: computing it once, which may take a minute or two")
        yield bar.show
