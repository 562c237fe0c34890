"""The document: results -> one HTML file that holds its data, its program and three.js, and loads nothing."""

from __future__ import annotations

import json
import os
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm._support import files
from swarm.figures.page.lives import fitting, policies_of
from swarm.figures.page.water import background
from swarm.figures.scene import Teams, contact_of
from swarm.figures.style import ON_DARK, team_colours
from swarm.optimal import physical_limit
from swarm.physics.starts import Starts
from swarm.physics.world import World
from swarm.population.results import world_of

if TYPE_CHECKING:
    import xarray as xr

ASSETS = "assets"
SCRIPTS: tuple[str, ...] = ("three.min.js", "lives.js", "shaders.js", "stage.js", "overlay.js", "plane.js")
SCRIPTS += ("space.js", "volume.js", "app.js")
LIVES = 24  # shorter ones for which "the limit so far" is computed


def page(
    results: xr.Dataset,
    *,
    title: str = "Swarm",
    cells: int | None = None,
    teams: Teams | None = None,
    world: World | None = None,
) -> str:
    """HTML of a population test that was recorded; nothing is loaded from elsewhere.

    Shows the first `cells` cells of every policy, of the first world where there are several: at most as many
    as make 20 MB of data, and the page says how many of how many. `world` is by default the one that the
    results tell. Cells of `teams` have their colours. Raises ValueError for results without time series.

    In a browser, `#t=12` opens the page at a time, `theme=light`, `view=whole`, `cell=3`, `beside=1` and
    `play=1` choose what else it opens with: `page.html#t=12&view=whole`; in space `turn=30` from which side
    it is seen [degrees].
    """
    if "position" not in results:
        raise ValueError(
            "results must hold the time series (record=True) to be shown on a page, got gains only"
        )
    world = world_of(results) if world is None else world
    results = results.isel(world=0) if "world" in results.dims else results
    shown = min(fitting(results), cells or results.sizes["cell"])
    units = {getattr(part, "length_unit", None) for part in (world.field, world.flow)} - {None}
    data = {
        "title": title,
        "cells": [shown, results.sizes["cell"]],
        "unit": next(iter(units), ""),
        "curvatures": world.curvatures,
        "torsions": world.torsions,
        "speeds": world.action_speeds,
        "policies": policies_of(results, shown),
        "teams": teams and _teams(teams, shown),
        "contact": contact_of(world),
        "needed": world.first_arrivals,
        "delay": world.block_delay,
        "limit": _limit(results, world),
        "egg": world.egg and {**dict(zip("xyz", world.egg[0], strict=False)), "radius": world.egg[1]},
        "background": background(results, world, shown),
    }
    # "<" is written out so that no text can end the script it stands in
    text = json.dumps(data, allow_nan=False, ensure_ascii=True).replace("<", "\\u003c")
    html = _asset("page.html").replace("/*STYLE*/", _asset("page.css"), 1)
    program = "\n".join(_asset(name) for name in SCRIPTS)
    return html.replace("/*SCRIPT*/", program, 1).replace("/*DATA*/null", text, 1)


def save_page(results: xr.Dataset, path: str | os.PathLike, **options: Any) -> None:
    """Writes `page`, with its options, to a file, whole or not at all."""
    files.write_text(path, page(results, **options))


def _asset(name: str) -> str:
    return resources.files("swarm.figures.page").joinpath(ASSETS, name).read_text(encoding="utf-8")


def _teams(teams: Teams, shown: int) -> dict[str, Any]:
    names = [str(name) for name in teams.names]
    colours = [[each, ON_DARK[each]] for each in team_colours(names)]
    return {"names": names, "colours": colours, "cells": teams.steered_by[:shown].tolist()}


def _limit(results: xr.Dataset, world: World) -> dict[str, Any] | None:
    """The limit of lives that end earlier, up to that of the results; in a flow and in space, where each
    takes long, of theirs alone.
    """
    end = results.attrs.get("limit")
    if end is None:
        return None
    life = float(results.attrs["life"])
    if world.in_flow or world.dimensions == 3:
        return {"times": [life], "values": [round(float(end), 4)]}
    starts = Starts(*(results[name].values for name in ("start_position", "start_heading", "past")))
    times = np.linspace(0, life, LIVES + 1).tolist()
    values = [physical_limit.limit(world.replace(life=each), starts) or 0.0 for each in times[1:]]
    return {"times": times, "values": [0.0, *(round(value, 4) for value in values)]}
