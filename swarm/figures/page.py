"""A population on a page: results -> one self-contained HTML file to play, scrub, colour and ask."""

from __future__ import annotations

import base64
import json
import os
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm._support import files
from swarm.figures.style import in_domain
from swarm.physics.world import World
from swarm.population.results import world_of

if TYPE_CHECKING:
    import xarray as xr

CELLS = 200  # at most on one page
PIXELS = 96  # of the background along its longer side
TEMPLATE = "page.html"


def page(results: xr.Dataset, *, title: str = "Swarm", cells: int | None = None) -> str:
    """HTML of a population test that was recorded; nothing is loaded from elsewhere.

    Shows the first `cells` cells (at most 200) of every policy. Raises ValueError for results without time
    series.
    """
    if "position" not in results:
        raise ValueError(
            "results must hold the time series (record=True) to be shown on a page, got gains only"
        )
    shown = min(CELLS, results.sizes["cell"], cells or CELLS)
    world = world_of(results)
    data = {
        "title": title,
        "policies": [_policy(results, str(name), shown) for name in results["policy"].values],
        "limit": results.attrs.get("limit"),
        "egg": world.egg and {"x": world.egg[0][0], "y": world.egg[0][1], "radius": world.egg[1]},
        "background": _background(results, world, shown),
    }
    # "<" is written out so that no text can end the script it stands in
    text = json.dumps(data, allow_nan=False, ensure_ascii=True).replace("<", "\\u003c")
    template = resources.files("swarm.figures").joinpath(TEMPLATE).read_text(encoding="utf-8")
    return template.replace("/*DATA*/null", text, 1)


def save_page(
    results: xr.Dataset, path: str | os.PathLike, *, title: str = "Swarm", cells: int | None = None
) -> None:
    """Writes `page` to a file, whole or not at all."""
    files.write_text(path, page(results, title=title, cells=cells))


def _policy(results: xr.Dataset, name: str, shown: int) -> dict[str, Any]:
    """One policy's series, float32 in base64, cell after cell; NaN after the end of a life."""
    one = results.sel(policy=name).isel(cell=slice(shown))
    series = {key: one[key] for key in ("time", "heading", "curvature", "concentration")}
    series |= {axis: one["position"].sel(axis=axis) for axis in ("x", "y")}
    return {
        "name": name,
        "gain": [round(float(gain), 6) for gain in one["gain"].values],
        "shape": [shown, one.sizes["decision"]],
        "series": {key: _packed(values.values, "<f4") for key, values in series.items()},
    }


def _background(results: xr.Dataset, world: World, shown: int) -> dict[str, Any]:
    """Concentration, or in a flow its speed, on a grid around all paths, as bytes from low to high."""
    position = results["position"].isel(cell=slice(shown)).values
    low, high = np.nanmin(position, axis=(0, 1, 2)) - 1.0, np.nanmax(position, axis=(0, 1, 2)) + 1.0
    size = np.maximum(2, np.round(PIXELS * (high - low) / (high - low).max()).astype(int))
    x, y = (np.linspace(low[i], high[i], size[i]) for i in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).astype(np.float64)
    if world.in_flow:
        values = in_domain(world, lambda at: np.linalg.norm(world.flow.velocity(at), axis=-1), places)
    else:
        values = in_domain(world, world.field.concentration, places)
    values = np.nan_to_num(values, nan=float(np.nanmin(values)))
    span = float(np.ptp(values)) or 1.0
    pixels = np.round(255 * (values - values.min()) / span)
    return {
        "what": "flow speed" if world.in_flow else "concentration",
        "low": low.tolist(),
        "high": high.tolist(),
        "size": size.tolist(),
        "pixels": _packed(pixels, "u1"),
    }


def _packed(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode()
