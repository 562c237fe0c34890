"""Folders of results: numbers, tables and figures of an evaluation, written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm import figures
from swarm._support import files
from swarm._support.tables import Table
from swarm._support.terminal import dispensable
from swarm.population import contests
from swarm.population.evaluation import Evaluation
from swarm.population.noise import KINDS, NoiseSweep, records
from swarm.population.results import pooled, save_population

if TYPE_CHECKING:
    import xarray as xr

POPULATION, SUMMARY = "population.nc", "summary.json"


def save_summary(found: Evaluation, out: Path) -> None:
    """Writes gains.png and summary.json beside a population that was written block by block."""
    with dispensable("gains.png"):
        figures.save(figures.distribution(found.results), out / "gains.png")
    files.write_text(out / SUMMARY, _summary(found))


def _summary(found: Evaluation) -> str:
    return json.dumps(found.summary, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def save_evaluation(found: Evaluation, out: str | os.PathLike) -> None:
    """Writes population.nc, summary.json, gains.png, centerlines.png, comparison.png and, where there is an
    egg, radial.png.

    Raises FileExistsError where `out` is something else than a new or an empty folder.
    """
    results, world = pooled(found.results), found.world
    drawn: dict[str, Callable[[], Any]] = {
        "gains": lambda: figures.gains(results),
        "centerlines": lambda: figures.centrelines(results, world, cells=40),
        "comparison": lambda: figures.comparison(results, world),
    }
    if world.egg is not None:
        drawn["radial"] = lambda: figures.radial(results, world, policy=found.label)
    with files.new_folder(out) as folder:
        save_population(found.results, folder / POPULATION)
        (folder / SUMMARY).write_text(_summary(found), encoding="utf-8")
        for name, draw in drawn.items():
            with dispensable(f"{name}.png"):
                figures.save(draw(), folder / f"{name}.png")


def save_noise_sweep(found: NoiseSweep, out: str | os.PathLike) -> None:
    """Writes noise.nc, noise.csv and noise.png; raises FileExistsError as `save_evaluation` does."""
    levels = found.results["noise"].values.tolist()
    (kind,) = (kind for kind in KINDS.values() if kind.parameter == found.results.attrs["kind"])
    units = kind.units.replace("^2", "²").replace("/", " / ")
    with files.new_folder(out) as folder:
        found.results.to_netcdf(folder / "noise.nc", engine="h5netcdf")
        (folder / "noise.csv").write_text(Table.of(records(found.results)).as_csv(), encoding="utf-8")
        with dispensable("noise.png"):
            figure = figures.noise_sweep(levels, found.tests, label=f"{kind.label} [{units}]")
            figures.save(figure, folder / "noise.png")


def save_contest(results: xr.Dataset, out: str | os.PathLike) -> None:
    """Writes contest.nc and contest.csv; raises FileExistsError as `save_evaluation` does."""
    with files.new_folder(out) as folder:
        results.to_netcdf(folder / "contest.nc", engine="h5netcdf")
        (folder / "contest.csv").write_text(contests.table(results).as_csv(), encoding="utf-8")
