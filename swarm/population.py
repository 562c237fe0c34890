"""Population tests: the same starts for every policy, the lives that follow, and their statistics."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm import files, provenance, streams
from swarm.checks import check_count, check_flag
from swarm.fields import LinearField, RadialField
from swarm.flows import StillWater, TaylorGreen
from swarm.starts import Starts, draw_noise, draw_starts
from swarm.strategies import Greedy, Policy
from swarm.swimmer import centre_of_curvature
from swarm.world import World

if TYPE_CHECKING:
    import xarray as xr

RIVAL = "greedy"  # the policy that every other is compared with
BLOCK = 128  # decisions whose random numbers are drawn at once
RESAMPLES = 9999  # of the bootstrap
MAX_FILE = 2**30  # [bytes] of a results file
PARTS: dict[str, type] = {part.__name__: part for part in (LinearField, RadialField, StillWater, TaylorGreen)}

_Column = tuple[tuple[str, ...], type, str, str]
_LIVES: dict[str, _Column] = {  # name: dimensions after (policy, cell), dtype, units, long name
    "gain": ((), np.float64, "concentration", "c(end of life) − c(0)"),
    "maximal_gain": ((), np.float64, "concentration", "largest c(t) − c(0) at any decision"),
    "arrived": ((), np.bool_, "", "whether the path reached the egg"),
    "lifetime": ((), np.float64, "time", "time from the start to the end of life"),
    "decisions": ((), np.int32, "", "decisions made"),
}
_SERIES: dict[str, _Column] = {
    "time": ((), np.float64, "time", "time lived"),
    "position": (("axis",), np.float32, "length", "position"),
    "heading": ((), np.float32, "rad", "heading, counter-clockwise from +x"),
    "curvature": ((), np.float32, "1/length", "curvature chosen for the interval that ends here"),
    "centre": (("axis",), np.float32, "length", "centre of curvature"),
    "concentration": ((), np.float32, "concentration", "concentration at the position"),
}
_STARTS: dict[str, _Column] = {
    "start_position": (("cell", "axis"), np.float64, "length", "position at t = 0"),
    "start_heading": (("cell",), np.float64, "rad", "heading at t = 0, counter-clockwise from +x"),
    "past": (("cell", "record"), np.int32, "", "actions before t = 0, newest first"),
}


class ResultsError(ValueError):
    """A file that holds no results of a population test."""


def population_test(
    world: World,
    policies: Mapping[str, Policy],
    *,
    cells: int = 40,
    life: float = 200.0,
    seed: int = 0,
    record: bool = True,
    limit: bool = True,
    population: streams.Population = "test",
    episode: int = 0,
) -> xr.Dataset:
    """Lives of `cells` cells under each policy, all from the same starts and with the same random numbers.

    Per (policy, cell): gain, maximal_gain, arrived, lifetime, decisions; with `record` also per decision,
    from the start (0) on and NaN after the end: time, position, heading, curvature, centre (of curvature),
    concentration. Attributes: seed, life, settings of the world (JSON), versions, commit, and the limit where
    there is one and `limit` is asked for. "greedy" is added where it is missing. Raises ValueError for a
    field or flow that returns NaN.
    """
    policies = _with_rival(policies)
    check_count("cells", cells)
    seed = streams.check_seed(seed)
    check_flag("record", record)
    world = world.replace(life=life)
    starts = draw_starts(world, cells, seed, population=population, episode=episode)
    lives = {
        name: _lives(world, policy, name, starts, seed, population, episode, record)
        for name, policy in policies.items()
    }
    bound = _limit(world, starts) if limit else None
    attributes = {
        "title": "Population test: the same starts for every policy",
        "seed": seed,
        "life": world.life,
        "population": population,
        "world": json.dumps(settings(world)),
        "versions": json.dumps(provenance.versions()),
        "commit": provenance.commit() or "",
    }
    if bound is not None:
        attributes["limit"] = bound
    return _dataset(starts, lives, attributes)


def _with_rival(policies: Mapping[str, Policy]) -> dict[str, Policy]:
    named: Mapping[Any, Any] = policies
    for name, policy in named.items():
        if not isinstance(name, str) or not name:
            raise TypeError(f"policies must be named by text, got {name!r}")
        if not callable(getattr(policy, "act", None)):
            raise TypeError(f"policy {name!r} must have act(world, state, uniform), got {policy!r}")
    if not isinstance(policies.get(RIVAL, Greedy()), Greedy):
        raise ValueError(f"policy {RIVAL!r} must be the greedy strategy, got {policies[RIVAL]!r}")
    return dict(policies) if RIVAL in policies else {**policies, RIVAL: Greedy()}


def _limit(world: World, starts: Starts) -> float | None:
    try:
        from swarm.optimal import limit
    except ImportError:
        return None
    return limit(world, starts)


def _lives(
    world: World,
    policy: Policy,
    name: str,
    starts: Starts,
    seed: int,
    population: streams.Population,
    episode: int,
    record: bool,
) -> dict[str, np.ndarray]:
    """Everything measured of the lives under one policy: (cells, ...), series (cells, decisions + 1, ...)."""
    cells = len(starts.heading)
    state = world.start(*starts)
    recorder = _Recorder(world, cells) if record else None
    if recorder:
        recorder.add(state, np.ones(cells, bool))
    arrived = np.zeros(cells, bool)
    decisions = np.zeros(cells, np.int32)
    gain = maximal = np.zeros(cells)
    for decision in range(world.max_decisions):
        block, turn = divmod(decision, BLOCK)
        if turn == 0:
            uniform = streams.generator(population, "policy", seed, episode, block).random((cells, BLOCK))
            if world.has_noise:
                noise = draw_noise(seed, cells, BLOCK, population=population, episode=episode, block=block)
        alive = ~state.finished
        action = policy.act(world, state, uniform[:, turn])
        state, outcome = world.step(state, action, noise[:, turn] if world.has_noise else None)
        gain = outcome.gain
        arrived |= outcome.terminated & alive
        decisions += alive
        maximal = np.maximum(maximal, gain)
        if recorder:
            recorder.add(state, alive)
        if state.finished.all():
            break
    if not np.all(np.isfinite(gain)):
        cell = int(np.flatnonzero(~np.isfinite(gain))[0])
        raise ValueError(
            f"gains must be finite, got {gain[cell]} for cell {cell} under {name!r}: "
            "check what the field and the flow return"
        )
    measured = {
        "gain": gain,
        "maximal_gain": maximal,
        "arrived": arrived,
        "lifetime": world.time(state),
        "decisions": decisions,
    }
    return measured | (recorder.series() if recorder else {})


class _Recorder:
    """Collects what is plotted of every life; NaN where a life is over."""

    def __init__(self, world: World, cells: int) -> None:
        self.world = world
        self.length = 0
        self.columns: dict[str, np.ndarray] = {
            name: np.full((world.max_decisions + 1, cells, *(2 for _ in extra)), np.nan, dtype)
            for name, (extra, dtype, _, _) in _SERIES.items()
        }

    def add(self, state: Any, alive: np.ndarray) -> None:
        curvature = self.world.curvature(state)
        row = {
            "time": self.world.time(state),
            "position": state.position,
            "heading": self.world.heading_angle(state),
            "curvature": curvature,
            "centre": centre_of_curvature(state.pose, curvature),
            "concentration": self.world.field.concentration(state.position),
        }
        for name, values in row.items():
            self.columns[name][self.length, alive] = values[alive]
        self.length += 1

    def series(self) -> dict[str, np.ndarray]:
        return {name: np.moveaxis(column[: self.length], 0, 1) for name, column in self.columns.items()}


def _dataset(
    starts: Starts, lives: Mapping[str, Mapping[str, np.ndarray]], attributes: dict[str, Any]
) -> xr.Dataset:
    import xarray as xr

    variables: dict[str, Any] = {}
    for name, values in zip(_STARTS, (starts.position, starts.heading, starts.past), strict=True):
        dimensions, dtype, units, long_name = _STARTS[name]
        variables[name] = (dimensions, values.astype(dtype), _labels(units, long_name))
    measured = next(iter(lives.values()))
    longest = max(life["time"].shape[1] for life in lives.values()) if "time" in measured else 0
    for name, (extra, dtype, units, long_name) in {**_LIVES, **_SERIES}.items():
        if name not in measured:
            continue
        along = ("decision",) if name in _SERIES else ()
        stacked = [_padded(life[name], longest) if along else life[name] for life in lives.values()]
        dimensions = ("policy", "cell", *along, *extra)
        variables[name] = (dimensions, np.stack(stacked).astype(dtype), _labels(units, long_name))
    coordinates: dict[str, Any] = {
        "policy": list(lives),
        "cell": np.arange(len(starts.heading), dtype=np.int32),
        "axis": ["x", "y"],
    }
    if longest:
        coordinates["decision"] = np.arange(longest, dtype=np.int32)
    return xr.Dataset(variables, coordinates, attributes)


def _labels(units: str, long_name: str) -> dict[str, str]:
    return {"units": units, "long_name": long_name} if units else {"long_name": long_name}


def _padded(series: np.ndarray, length: int) -> np.ndarray:
    missing = [(0, 0), (0, length - series.shape[1])] + [(0, 0)] * (series.ndim - 2)
    return np.pad(series, missing, constant_values=np.nan)


# --- statistics ---------------------------------------------------------------------------------------------


def statistics(results: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Per policy: `mean`, `std`, `min`, `max` of the cells' gains, `ci95` of the mean, `fraction_of_limit`,
    `difference_to_greedy` (`mean`, `ci95`; cell by cell) and `wins`, the number of cells that beat greedy.

    The intervals are 95% percentile bootstraps over cells, seeded by the test's own seed; None with a single
    cell. `std` is over the cells (divided by their number). `fraction_of_limit` is None without a limit.
    """
    gains = results["gain"].values  # (policies, cells)
    rival = results["gain"].sel(policy=RIVAL).values
    ahead = gains - rival
    intervals = mean_intervals(np.stack([gains, ahead]), seed=int(results.attrs["seed"]))
    limit = results.attrs.get("limit")
    return {
        str(name): {
            "mean": float(gains[i].mean()),
            "std": float(gains[i].std()),
            "min": float(gains[i].min()),
            "max": float(gains[i].max()),
            "ci95": intervals[0][i],
            "fraction_of_limit": None if limit is None else float(gains[i].mean() / limit),
            "difference_to_greedy": {"mean": float(ahead[i].mean()), "ci95": intervals[1][i]},
            "wins": int(np.sum(ahead[i] > 0)),
        }
        for i, name in enumerate(results["policy"].values)
    }


def mean_intervals(samples: np.ndarray, *, seed: int = 0) -> Any:
    """95% percentile bootstrap intervals [low, high] of the means over the last axis, as nested lists (...).

    Every row is resampled with the same drawn indices. None in place of an interval where there is one number
    only.
    """
    if samples.shape[-1] < 2:
        return np.full(samples.shape[:-1], None, object).tolist()
    from scipy.stats import bootstrap

    interval = bootstrap(
        (samples,),
        np.mean,
        axis=-1,
        n_resamples=RESAMPLES,
        batch=1000,
        method="percentile",
        rng=streams.generator("test", "bootstrap", seed),
    ).confidence_interval
    return np.stack([interval.low, interval.high], axis=-1).tolist()


# --- files --------------------------------------------------------------------------------------------------


def settings(world: World) -> dict[str, Any]:
    """A world's parameters as JSON values; fields and flows by the name of their type and their numbers."""
    result = {}
    for item in dataclasses.fields(world):
        value = getattr(world, item.name)
        if item.name in ("field", "flow"):
            parts = dataclasses.fields(value) if dataclasses.is_dataclass(value) else ()
            numbers = {part.name: getattr(value, part.name) for part in parts}
            plain = {name: number for name, number in numbers.items() if isinstance(number, int | float)}
            value = {"type": type(value).__name__, **plain}
        result[item.name] = value
    return result


def world_of(results: xr.Dataset) -> World:
    """The world that results were made in; raises ResultsError where its field or flow is a user's own."""
    try:
        stored = json.loads(results.attrs["world"])
        for name in ("field", "flow"):
            part = dict(stored[name])
            kind = part.pop("type")
            if kind not in PARTS:
                raise ResultsError(
                    f"{name} must be one of {', '.join(sorted(PARTS))} to be made again, got {kind!r}"
                )
            stored[name] = PARTS[kind](**part)
        return World(**stored)
    except ResultsError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ResultsError(f"results must state the world they were made in, got {error}") from None


def save_population(results: xr.Dataset, path: str | os.PathLike) -> None:
    """Writes results as NetCDF, whole or not at all."""
    with files.replacing(path) as temporary:
        results.to_netcdf(temporary, engine="h5netcdf")


def load_population(path: str | os.PathLike) -> xr.Dataset:
    """Results that `save_population` wrote; raises ResultsError that names the file and the rule it breaks.

    The file is checked before anything is read: nothing outside it is followed, and it holds every number it
    announces.
    """
    file = Path(path)
    try:
        _check_file(file)
        return _read(file)
    except ResultsError as error:
        raise ResultsError(f"{file} holds no results of a population test: {error}") from None


def _check_file(file: Path) -> None:
    if not file.is_file():
        raise ResultsError("it must be an ordinary file" if file.exists() else "it is not there")
    size = file.stat().st_size
    if size > MAX_FILE:
        raise ResultsError(f"it must have at most {MAX_FILE} bytes, got {size}")
    import h5py

    known = {**_STARTS, **_LIVES, **_SERIES}
    try:
        with h5py.File(file, "r") as opened:
            announced = 0
            for name in opened:
                if not isinstance(opened.get(name, getlink=True), h5py.HardLink):
                    raise ResultsError(f"{name!r} must be stored in the file itself, got a link")
                stored = opened[name]
                if not isinstance(stored, h5py.Dataset) or name not in {*known, *_COORDINATES}:
                    raise ResultsError(f"it must hold {', '.join(known)}, got {name!r}")
                if stored.external or stored.is_virtual:
                    raise ResultsError(
                        f"{name!r} must be stored in the file itself, got a reference to another file"
                    )
                announced += math.prod(stored.shape or ()) * stored.dtype.itemsize
                if announced > size or stored.compression is not None:
                    raise ResultsError(
                        f"it must hold all of its numbers uncompressed, got {name!r} of shape {stored.shape}"
                    )
            missing = [name for name in ("gain", *_STARTS) if name not in opened]
            if missing:
                raise ResultsError(f"it must hold {', '.join(missing)}")
    except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
        if isinstance(error, ResultsError):
            raise
        raise ResultsError(f"it must be a NetCDF file, got {str(error)[:200]}") from None


_COORDINATES = ("policy", "cell", "axis", "record", "decision")


def _read(file: Path) -> xr.Dataset:
    import xarray as xr

    try:
        with xr.open_dataset(file, engine="h5netcdf", decode_times=False) as opened:
            results = opened.load()
    except Exception as error:
        raise ResultsError(f"it must be a NetCDF file, got {str(error)[:200]}") from None
    expected = {name: dimensions for name, (dimensions, *_) in _STARTS.items()}
    expected |= {name: ("policy", "cell", *extra) for name, (extra, *_) in _LIVES.items()}
    expected |= {name: ("policy", "cell", "decision", *extra) for name, (extra, *_) in _SERIES.items()}
    for name, values in results.data_vars.items():
        if values.dims != expected.get(str(name)):
            raise ResultsError(
                f"{name!r} must have the dimensions {expected.get(str(name))}, got {values.dims}"
            )
    for name in ("seed", "life", "world"):
        if name not in results.attrs:
            raise ResultsError(f"it must have the attribute {name!r}")
    if RIVAL not in results["policy"].values:
        raise ResultsError(f"one of its policies must be {RIVAL!r}")
    if not np.all(np.isfinite(results["gain"].values)):
        raise ResultsError("its gains must be finite")
    return results
