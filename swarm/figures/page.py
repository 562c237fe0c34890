"""A population on a page: results -> one self-contained HTML file to play, scrub, colour and ask."""

from __future__ import annotations

import base64
import json
import os
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm._support import files
from swarm.figures.scene import Teams, concentration_at, speed_at
from swarm.figures.style import team_colours
from swarm.physics.crowd.medium import MediumState
from swarm.physics.world import World
from swarm.population.frames import coarse
from swarm.population.results import world_of

if TYPE_CHECKING:
    import xarray as xr

CELLS = 200  # at most on one page
PIXELS = 96  # of the background along its longer side
FRAMES = 48  # of a background that changes, at most
TEMPLATE = "page.html"


def page(
    results: xr.Dataset,
    *,
    title: str = "Swarm",
    cells: int | None = None,
    teams: Teams | None = None,
    world: World | None = None,
) -> str:
    """HTML of a population test that was recorded; nothing is loaded from elsewhere.

    Shows the first `cells` cells (at most 200) of every policy, of the first world where there are several;
    `world` is by default the one that the results tell. Cells of `teams` have their colours. Raises
    ValueError for results without time series.
    """
    if "position" not in results:
        raise ValueError(
            "results must hold the time series (record=True) to be shown on a page, got gains only"
        )
    shown = min(CELLS, results.sizes["cell"], cells or CELLS)
    world = world_of(results) if world is None else world
    results = results.isel(world=0) if "world" in results.dims else results
    data = {
        "title": title,
        "policies": [_policy(results, str(name), shown) for name in results["policy"].values],
        "teams": teams and _teams(teams, shown),
        "needed": world.first_arrivals,
        "delay": world.block_delay,
        "limit": results.attrs.get("limit"),
        "egg": world.egg and {"x": world.egg[0][0], "y": world.egg[0][1], "radius": world.egg[1]},
        "background": _background(results, world, shown),
    }
    # "<" is written out so that no text can end the script it stands in
    text = json.dumps(data, allow_nan=False, ensure_ascii=True).replace("<", "\\u003c")
    template = resources.files("swarm.figures").joinpath(TEMPLATE).read_text(encoding="utf-8")
    return template.replace("/*DATA*/null", text, 1)


def save_page(results: xr.Dataset, path: str | os.PathLike, **options: Any) -> None:
    """Writes `page`, with its options, to a file, whole or not at all."""
    files.write_text(path, page(results, **options))


def _teams(teams: Teams, shown: int) -> dict[str, Any]:
    names = [str(name) for name in teams.names]
    return {"names": names, "colours": team_colours(names), "cells": teams.steered_by[:shown].tolist()}


def _policy(results: xr.Dataset, name: str, shown: int) -> dict[str, Any]:
    """One policy's series, float32 in base64, cell after cell; NaN after the end of a life."""
    one = results.sel(policy=name).isel(cell=slice(shown))
    names = ("time", "heading", "curvature", "concentration", "eaten")
    series = {key: one[key] for key in names if key in one}
    series |= {axis: one["position"].sel(axis=axis) for axis in ("x", "y")}
    return {
        "name": name,
        "gain": [round(float(gain), 6) for gain in one["gain"].values],
        "shape": [shown, one.sizes["decision"]],
        **(
            {"arrival": _or_none(one["arrival_time"]), "won": one["won"].values.tolist()}
            if "won" in one
            else {}
        ),
        "series": {key: _packed(values.values, "<f4") for key, values in series.items()},
    }


def _or_none(times: xr.DataArray) -> list[float | None]:
    return [round(time, 4) if np.isfinite(time) else None for time in times.values.tolist()]


def _background(results: xr.Dataset, world: World, shown: int) -> dict[str, Any]:
    """Concentration, or in a flow its speed, on a grid around all paths, as bytes from low to high.

    A number of frames: of each policy's medium, or of what changes with time, else one.
    """
    position = results["position"].isel(cell=slice(shown)).values
    low, high = np.nanmin(position, axis=(0, 1, 2)) - 1.0, np.nanmax(position, axis=(0, 1, 2)) + 1.0
    size = np.maximum(2, np.round(PIXELS * (high - low) / (high - low).max()).astype(int))
    x, y = (np.linspace(low[i], high[i], size[i]) for i in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).astype(np.float64)
    flowing = world.in_flow and "medium" not in results
    if "medium" in results:
        films = [_film(results.sel(policy=name), world, places) for name in results["policy"].values]
    else:
        end = float(np.nanmax(results["time"].values))
        times = np.zeros(1) if world.is_steady else np.linspace(0, end, FRAMES)
        quantity = (lambda *at: np.abs(speed_at(*at))) if flowing else concentration_at
        films = [(times, np.stack([quantity(world, float(time), places) for time in times]))]
    every = np.concatenate([values for _, values in films])
    least, most = float(np.nanmin(every)), float(np.nanmax(every))
    scale = 255 / ((most - least) or 1.0)
    return {
        "what": "flow speed" if flowing else "concentration",
        "least": least,
        "most": most,
        "low": low.tolist(),
        "high": high.tolist(),
        "size": size.tolist(),
        "films": [
            {
                "times": np.round(times, 4).tolist(),
                "pixels": _packed(np.round(scale * (np.nan_to_num(values, nan=least) - least)), "u1"),
            }
            for times, values in films
        ],
    }


def _film(one: xr.Dataset, world: World, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times (frames,) of one policy's medium, and the concentration (frames, ...) at the places."""
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


def _packed(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode()
