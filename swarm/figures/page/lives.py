"""Lives on a page: every policy's series, rounded to 16 bits, and its mean gain over time."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm.figures.style import ON_DARK, look, team_colours

if TYPE_CHECKING:
    import xarray as xr

MOST = 18e6  # characters of all series together, of the 20 MB of data that a page may hold
SERIES = ("time", "heading", "curvature", "concentration", "eaten")
QUATERNION = ("q_w", "q_x", "q_y", "q_z")  # of the heading in space
CURVE = 240  # times of a curve of mean gains
LEVELS = 65534  # to which numbers are rounded; 0 is written for what is missing


def fitting(results: xr.Dataset) -> int:
    """How many cells fit on a page, at least one."""
    held = [results[name] for name in ("position", *SERIES) if name in results]
    numbers = sum(each.isel(policy=0, cell=0).size for each in held)
    return max(1, min(results.sizes["cell"], int(MOST / (numbers * results.sizes["policy"] * 2 * 4 / 3))))


def policies_of(results: xr.Dataset, shown: int) -> list[dict[str, Any]]:
    """Name, colours on light and on dark, mean gain of all cells over time, and the first `shown` cells'
    series of every policy."""
    names = [str(name) for name in results["policy"].values]
    return [
        _policy(results.sel(policy=name), shown)
        | {"name": name, "label": look(name).label.replace(r"\$", "$"), "colours": [colour, ON_DARK[colour]]}
        for name, colour in zip(names, team_colours(names), strict=True)
    ]


def _policy(one: xr.Dataset, shown: int) -> dict[str, Any]:
    first = one.isel(cell=slice(shown))
    series = {key: first[key].values for key in SERIES if key in first}
    series |= {str(axis): first["position"].sel(axis=axis).values for axis in first["axis"].values}
    if "z" in series:
        series |= dict(zip(QUATERNION, np.moveaxis(series.pop("heading"), -1, 0), strict=True))
    if np.all(series["time"] == series["time"][:1]):  # all decide at the same moments, to the end
        series["time"] = series["time"][:1]
    race = {}
    if "won" in one:
        times = first["arrival_time"].values.tolist()
        race["arrival"] = [round(time, 4) if np.isfinite(time) else None for time in times]
        race["won"] = first["won"].values.tolist()
    return {
        "gain": [round(float(gain), 5) for gain in first["gain"].values],
        "shape": [shown, one.sizes["decision"]],
        "curve": _curve(one),
        **race,
        "series": {key: quantised(values) for key, values in series.items()},
    }


def _curve(one: xr.Dataset) -> dict[str, Any]:
    """Mean gain of all cells at equal distances in time; cells whose lives are over keep theirs."""
    time, concentration = one["time"].values, one["concentration"].values
    end = float(np.nanmax(time))
    times = np.linspace(0, end, CURVE)
    total = np.zeros(CURVE)
    for lived, sensed in zip(time, concentration, strict=True):
        alive = np.isfinite(lived)
        total += np.interp(times, lived[alive], sensed[alive] - sensed[0])
    mean = total / len(time)
    mean[-1] = float(one["gain"].values.mean())
    return {"end": end, "mean": np.round(mean, 4).tolist()}


def quantised(values: np.ndarray) -> dict[str, Any]:
    """Numbers as 16 bits in base64: 0 for NaN, else `low + (code − 1) · step`."""
    values = np.asarray(values, np.float64)
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 0.0)
    step = (high - low) / LEVELS or 1.0
    codes = np.where(known, 1 + np.rint((np.where(known, values, low) - low) / step), 0)
    return {"low": low, "step": step, "data": base64.b64encode(codes.astype("<u2").tobytes()).decode()}
