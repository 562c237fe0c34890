"""Gain against noise: the same cells tested at several strengths of one perturbation."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm._support import files, streams
from swarm._support.checks import check_count, check_name
from swarm.physics.world import World
from swarm.policies.policy import AnyPolicy
from swarm.policies.strategies import Greedy
from swarm.population.contest import population_test
from swarm.population.evaluation import LEARNT, STRATEGIES, called, named_policy
from swarm.population.results import RIVAL
from swarm.population.statistics import statistics

if TYPE_CHECKING:
    import xarray as xr


class Kind(NamedTuple):
    """A perturbation of the world."""

    parameter: str  # of `World`
    label: str  # what its strength is, for an axis
    units: str


KINDS = {
    "concentration": Kind("concentration_noise", "noise of the sensed concentration", "concentration"),
    "curvature": Kind("curvature_noise", "noise of the curvature", "1/length"),
    "rotation": Kind("rotational_diffusion", "rotational diffusion", "rad^2/time"),
}
COLUMNS: dict[str, str] = {  # of the table: what each of them says
    "gain": "mean gain over the cells",
    "gain_low": "lower end of the 95% bootstrap interval of the mean gain",
    "gain_high": "upper end of the 95% bootstrap interval of the mean gain",
    "std": "standard deviation of the gain over the cells",
    "ahead": "mean difference to greedy, cell by cell",
    "ahead_low": "lower end of the 95% bootstrap interval of the mean difference to greedy",
    "ahead_high": "upper end of the 95% bootstrap interval of the mean difference to greedy",
    "wins": "cells that gain more than under greedy",
}


class NoiseSweep(NamedTuple):
    """What `sweep_noise` found."""

    results: xr.Dataset  # what noise.nc holds: `COLUMNS` (noise, policy), cell_gain (noise, policy, cell)
    tests: list[xr.Dataset]  # the population test of each level, without time series
    table: list[list[str]]  # a row per level and policy, after the row of headings


def check_levels(levels: Sequence[float], kind: str, world: World) -> list[World]:
    """The world at each level of noise; raises ValueError unless the levels are there, valid and rising."""
    parameter = KINDS[check_name("kind", kind, KINDS)].parameter
    worlds = [world.replace(**{parameter: level}) for level in levels]
    if not worlds or any(after <= before for before, after in itertools.pairwise(levels)):
        raise ValueError(f"levels of noise must be at least one, and rise, got {tuple(levels)}")
    return worlds


def sweep_noise(
    policy: str | os.PathLike | AnyPolicy,
    world: World,
    levels: Sequence[float],
    *,
    kind: str = "concentration",
    cells: int = 40,
    life: float = 200.0,
    seed: int = 0,
    out: str | os.PathLike | None = None,
    progress: Callable[[int], None] | None = None,
) -> NoiseSweep:
    """Tests a policy and greedy at every level of one perturbation, all on the same starts.

    `levels` rise; their unit is that of the kind (see `KINDS`), and the same random numbers are scaled by
    each. Other perturbations of the world stay as they are. `out` receives noise.nc, noise.csv and
    noise.png, whole or not at all; `progress` is called with the number of levels that are done. Raises,
    before anything is computed, ValueError for a wrong level, PolicyError for a policy that cannot be had,
    FileExistsError where `out` is something else than a new or an empty folder.
    """
    if out is not None:
        files.check_new_folder(out)
    check_count("cells", cells)
    streams.check_seed(seed)
    worlds = check_levels(levels, kind, world.replace(life=life))
    players: list[AnyPolicy] = [
        named_policy(policy, each) if isinstance(policy, str | os.PathLike) else policy for each in worlds
    ]
    name = called(policy)
    label = name if name in STRATEGIES else LEARNT
    tests = []
    for each, player in zip(worlds, players, strict=True):
        contest = {label: player, RIVAL: Greedy()}
        test = population_test(each, contest, cells=cells, life=life, seed=seed, record=False, limit=False)
        tests.append(test)
        if progress is not None:
            progress(len(tests))
    results = as_dataset(levels, tests, kind, name)
    if out is not None:
        with files.new_folder(out) as folder:
            _write(results, levels, tests, KINDS[kind], folder)
    return NoiseSweep(results, tests, table(results))


def as_dataset(levels: Sequence[float], tests: Sequence[xr.Dataset], kind: str, policy: str) -> xr.Dataset:
    """Statistics by level and policy, with the gains and starts of all cells and where they come from."""
    import xarray as xr

    numbers = [statistics(test) for test in tests]
    policies = [str(name) for name in tests[0]["policy"].values]
    rows = [[_row(of_level[name]) for name in policies] for of_level in numbers]
    variables: dict[str, Any] = {}
    for column, text in COLUMNS.items():
        units = {} if column == "wins" else {"units": "concentration"}
        values = np.array([[row[column] for row in of_level] for of_level in rows])
        variables[column] = (("noise", "policy"), values, {"long_name": text, **units})
    gains = np.stack([test["gain"].values for test in tests])
    variables["cell_gain"] = (("noise", "policy", "cell"), gains, dict(tests[0]["gain"].attrs))
    perturbation = KINDS[kind]
    about = {"long_name": perturbation.label, "units": perturbation.units}
    coordinates: dict[str, Any] = {
        "noise": ("noise", np.array(levels, np.float64), about),
        "policy": policies,
        "cell": tests[0]["cell"].values,
    }
    kept = ("seed", "life", "population", "world", "versions", "commit")
    attributes = {
        "title": "Population tests at several levels of noise: the same starts for every policy and level",
        "kind": perturbation.parameter,
        "tested": policy,
        **{name: tests[0].attrs[name] for name in kept},
    }
    starts = tests[0][["start_position", "start_heading", "past"]]
    return xr.Dataset(variables, coordinates, attributes).merge(starts, combine_attrs="override")


def _row(numbers: dict[str, Any]) -> dict[str, float]:
    """The `COLUMNS` of one policy's statistics; NaN where there is no interval."""
    ahead = numbers["difference_to_greedy"]
    low, high = numbers["ci95"] or (np.nan, np.nan)
    ahead_low, ahead_high = ahead["ci95"] or (np.nan, np.nan)
    values = (
        numbers["mean"],
        low,
        high,
        numbers["std"],
        ahead["mean"],
        ahead_low,
        ahead_high,
        numbers["wins"],
    )
    return dict(zip(COLUMNS, values, strict=True))


def table(results: xr.Dataset) -> list[list[str]]:
    """A row per level and policy, after the row of headings."""
    rows = [
        ["noise", "policy", "gain", "95% interval of the mean", "over greedy", "its 95% interval", "wins"]
    ]
    for level in results["noise"].values:
        for name in results["policy"].values:
            row = {column: results[column].sel(noise=level, policy=name).item() for column in COLUMNS}
            over = ["–", "–", "–"]
            if name != RIVAL:
                interval = _interval(row["ahead_low"], row["ahead_high"], "+.2f")
                over = [f"{row['ahead']:+.2f}", interval, f"{row['wins']}/{results.sizes['cell']}"]
            mean = f"{row['gain']:.2f} ± {row['std']:.2f}"
            rows.append([f"{level:g}", str(name), mean, _interval(row["gain_low"], row["gain_high"]), *over])
    return rows


def _interval(low: float, high: float, form: str = ".2f") -> str:
    return "–" if np.isnan(low) else f"{low:{form}} … {high:{form}}"


def _write(
    results: xr.Dataset, levels: Sequence[float], tests: Sequence[xr.Dataset], kind: Kind, folder: Path
) -> None:
    from swarm import figures

    results.to_netcdf(folder / "noise.nc", engine="h5netcdf")
    rows = results[list(COLUMNS)].to_dataframe().reset_index()
    rows.insert(0, "kind", kind.parameter)
    origin = {name: results.attrs[name] for name in ("life", "seed", "commit")}
    rows.assign(cells=results.sizes["cell"], **origin).to_csv(folder / "noise.csv", index=False)
    units = kind.units.replace("^2", "²").replace("/", " / ")
    figures.save(figures.noise_sweep(levels, tests, label=f"{kind.label} [{units}]"), folder / "noise.png")
