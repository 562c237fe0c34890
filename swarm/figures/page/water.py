"""What is behind the cells on a page: concentration, the flow's speed and direction, on grids over time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import Colormap, LinearSegmentedColormap, to_hex

from swarm.figures.page.lives import quantised
from swarm.figures.scene import PLUM, SEA, concentration_at, speed_at, velocity_at
from swarm.physics.crowd.medium import MediumState
from swarm.physics.world import World
from swarm.population.frames import coarse

if TYPE_CHECKING:
    import xarray as xr

PIXELS = 144  # of what stands still, along its longer side
CHANGING = 80  # of a medium
FRAMES = 32  # of it, at most
UNSTEADY, MOMENTS, EACH = 48, 160, 0.5  # of what changes by itself: pixels, most times, and how far apart
MOST_IN_SPACE = 0.99  # of all values to which colours run, of which the highest lie within the egg
IN_SPACE, UNSTEADY_IN_SPACE, MOMENTS_IN_SPACE, ARROWS_IN_SPACE = 40, 20, 40, 7  # the same in space
ARROWS = 24  # places along the longer side at which the flow's direction is kept
MARGIN, NEAREST = 0.4, 1.6  # around all paths, of their longer side and besides [length]; the last 0.6 fade
SHORE = LinearSegmentedColormap.from_list("shore", ["#f7fafc", "#dcebf3", "#b9d8e6", "#8fc1d2", "#66a6b8"])
HEATH = LinearSegmentedColormap.from_list("heath", ["#fbf9fc", "#ebe4f3", "#d6c9e6", "#c0add6", "#a98fc4"])

Film = tuple[np.ndarray, np.ndarray]  # times (frames,), values (frames, rows, columns)


def background(results: xr.Dataset, world: World, shown: int) -> dict[str, Any]:
    """Layers of water around all paths, the first to be shown first, and the flow where there is one."""
    low, high = _room(results, shown)
    end, in_space = float(np.nanmax(results["time"].values)), world.dimensions == 3
    moments = min(MOMENTS_IN_SPACE if in_space else MOMENTS, 1 + math.ceil(end / EACH))
    times = np.zeros(1) if world.is_steady else np.linspace(0, end, moments)
    pixels = (IN_SPACE if in_space else PIXELS, UNSTEADY_IN_SPACE if in_space else UNSTEADY)
    places = _grid(low, high, CHANGING if "medium" in results else pixels[not world.is_steady])
    if "medium" in results:
        films = [_medium(results.sel(policy=name), world, places) for name in results["policy"].values]
    else:
        films = [(times, np.stack([concentration_at(world, float(time), places) for time in times]))]
    layers = [_layer("concentration", films, SEA, SHORE)]
    flow = None
    if world.in_flow:
        speeds = times, np.stack([speed_at(world, float(time), places) for time in times])
        fast = _layer("flow speed", [speeds], PLUM, HEATH)
        layers = [*layers, fast] if "medium" in results else [fast, *layers]
        sparse = _grid(low, high, ARROWS_IN_SPACE if in_space else ARROWS)
        found = np.stack([velocity_at(world, float(time), sparse) for time in times])
        flow = {"times": times.tolist(), "size": sparse.shape[-2::-1]}
        flow |= {axis: quantised(found[..., i]) for i, axis in enumerate("xyz"[: len(low)])}
    return {"low": low.tolist(), "high": high.tolist(), "layers": layers, "flow": flow}


def _room(results: xr.Dataset, shown: int) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corner (axes,) of what is around all paths."""
    position = results["position"].isel(cell=slice(shown)).values
    low, high = np.nanmin(position, axis=(0, 1, 2)), np.nanmax(position, axis=(0, 1, 2))
    longest = float((high - low).max())
    square, margin, nearest = (1.0, MARGIN, NEAREST) if len(low) == 2 else (0.25, 0.1, 1.0)
    wide = np.maximum(high - low, square * longest) + 2 * (margin * longest + nearest)
    return (low + high - wide) / 2, (low + high + wide) / 2


def _grid(low: np.ndarray, high: np.ndarray, longer: int) -> np.ndarray:
    """Places (rows, columns, 2), or in space (layers, rows, columns, 3), from corner to corner."""
    size = np.maximum(2, np.round(longer * (high - low) / (high - low).max()).astype(int))
    sides = [np.linspace(*ends) for ends in zip(low, high, size, strict=True)]
    return np.stack(np.meshgrid(*sides[::-1], indexing="ij")[::-1], axis=-1)


def _layer(what: str, films: list[Film], dark: Colormap, light: Colormap) -> dict[str, Any]:
    every = np.concatenate([values.ravel() for _, values in films])
    return {
        "what": what,
        "least": 0.0 if what == "flow speed" else float(np.nanmin(every)),
        "most": float(np.nanquantile(every, MOST_IN_SPACE) if films[0][1].ndim > 3 else np.nanmax(every)),
        "ramps": [[to_hex(ramp(i / 4)) for i in range(5)] for ramp in (light, dark)],
        "films": [
            {"times": np.round(times, 4).tolist(), "size": values.shape[:0:-1], "values": quantised(values)}
            for times, values in films
        ],
    }


def _medium(one: xr.Dataset, world: World, places: np.ndarray) -> Film:
    """One policy's medium, NaN where it holds none."""
    times = one["medium_time"].values
    chosen = np.flatnonzero(np.isfinite(times))
    chosen = chosen[np.unique(np.linspace(0, len(chosen) - 1, FRAMES).astype(int))]
    assert world.medium is not None
    medium, frames = coarse(world.medium), []
    for i in chosen:
        grid, origin = (one[name].values[i].astype(float) for name in ("medium", "medium_origin"))
        held = MediumState(grid, origin, *(None,) * 4)
        frames.append(concentration_at(world, float(times[i]), places, held, medium))
    return times[chosen], np.stack(frames)
