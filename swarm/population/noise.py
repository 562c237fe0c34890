"""Gain against noise: the same cells tested at several strengths of one perturbation."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm._support.checks import check_name
from swarm._support.tables import Table, span
from swarm.physics.world import World
from swarm.physics.world.rules import in_units
from swarm.policies.policy import AnyPolicy
from swarm.policies.strategies import Greedy
from swarm.population.contest import population_test
from swarm.population.evaluation import TO_THE_EGG, contender, to_the_egg
from swarm.population.results import RIVAL
from swarm.population.statistics import arrivals, statistics

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
    "bending": Kind("curvature_diffusion", "diffusion by the curvature", "rad^2/time"),
    "rotation": Kind("rotational_diffusion", "rotational diffusion", "rad^2/time"),
}
COLUMNS: dict[str, str] = {  # of the table: what each of them says
    "gain": "mean gain over the cells of all worlds",
    "gain_low": "lower end of the 95% interval of the mean gain",
    "gain_high": "upper end of the 95% interval of the mean gain",
    "std": "standard deviation of the gain over the cells",
    "ahead": "mean difference to greedy, cell by cell",
    "ahead_low": "lower end of the 95% interval of the mean difference to greedy",
    "ahead_high": "upper end of the 95% interval of the mean difference to greedy",
    "wins": "cells that gain more than under greedy",
}
EGG: dict[str, str] = {  # further ones where there is an egg
    "arrived": "cells that arrived at the egg",
    "time_to_egg": "mean time of those that arrived",
    "median_time_to_egg": "median time of those that arrived",
}


class NoiseSweep(NamedTuple):
    """What `sweep_noise` found."""

    # What noise.nc holds: `COLUMNS`, and `EGG`, (noise, policy), cell_gain (noise, policy[, world], cell).
    results: xr.Dataset
    tests: list[xr.Dataset]  # the population test of each level, without time series
    table: Table  # a row per level and policy


def levels_of(words: Sequence[str]) -> list[float]:
    """Levels of noise, rising, from words with or without commas."""
    try:
        return sorted(float(part.strip()) for word in words for part in word.split(","))
    except ValueError:
        raise ValueError(f"--noise must be numbers, separated by commas, got {','.join(words)!r}") from None


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
    worlds: int = 1,
    life: float = 200.0,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> NoiseSweep:
    """Tests a policy and greedy at every level of one perturbation, all on the same starts, `cells` of them
    in each of `worlds` worlds.

    `levels` rise; their unit is that of the kind (see `KINDS`), and the same random numbers are scaled by
    each. Other perturbations of the world stay as they are. `progress` is called with the number of levels
    that are done. Raises, before anything is computed, ValueError for a wrong level, PolicyError for a policy
    that cannot be had.
    """
    noisy = check_levels(levels, kind, world.replace(life=life))
    contenders = [contender(policy, each) for each in noisy]
    sizes: dict[str, Any] = {"cells": cells, "worlds": worlds, "life": life, "seed": seed}
    tests = []
    for each, (_, label, player) in zip(noisy, contenders, strict=True):
        contest = {label: player, RIVAL: Greedy()}
        test = population_test(each, contest, **sizes, record=False, limit=False)
        tests.append(test)
        if progress is not None:
            progress(len(tests))
    columns = COLUMNS if world.egg is None else COLUMNS | EGG
    results = _dataset(levels, tests, KINDS[kind], contenders[0][0], columns)
    return NoiseSweep(results, tests, table(results))


def _dataset(
    levels: Sequence[float], tests: Sequence[xr.Dataset], kind: Kind, policy: str, columns: dict[str, str]
) -> xr.Dataset:
    """The `columns` by level and policy, with the gains and starts of all cells and where they come from."""
    import xarray as xr

    own = json.loads(tests[0].attrs["world"]).get("units")
    about = {"long_name": kind.label, "units": in_units(kind.units, own)}
    results = tests[0][["start_position", "start_heading", "past"]]
    results = results.assign_coords(noise=("noise", np.array(levels, np.float64), about))
    results["cell_gain"] = xr.concat([test["gain"] for test in tests], dim=results["noise"])
    rows = [list(_rows(test)) for test in tests]
    for place, (column, text) in enumerate(columns.items()):
        units = {"units": "time"} if "time" in column else {"units": "concentration"}
        units = {} if column in ("wins", "arrived") else units
        values = np.array([[row[place] for row in of_level] for of_level in rows])
        results[column] = (("noise", "policy"), values, {"long_name": text, **units})
    results.attrs |= {
        "title": "Population tests at several levels of noise: the same starts for every policy and level",
        "kind": kind.parameter,
        "tested": policy,
    }
    return results


def _rows(test: xr.Dataset) -> Iterator[tuple[float, ...]]:
    """The `COLUMNS` and `EGG` of each policy; NaN where there is no number."""
    came, nowhere = arrivals(test), (np.nan, np.nan)
    for name, numbers in statistics(test).items():
        mean, ahead = numbers["mean"], numbers["difference_to_greedy"]
        gain = mean, *(numbers["ci95"] or nowhere), numbers["std"]
        yield *gain, ahead["mean"], *(ahead["ci95"] or nowhere), numbers["wins"], *came[name].values()


def table(results: xr.Dataset) -> Table:
    """A row per level and policy."""
    headings = ["noise", "policy", "gain", "95% interval", "over greedy", "its 95% interval"]
    headings += ["wins", *(TO_THE_EGG if "arrived" in results else ())]
    rows, cells = [], results["start_heading"].size  # of all worlds
    for record in records(results):
        over: list[str | None] = [None] * 3
        if record["policy"] != RIVAL:
            interval = span((record["ahead_low"], record["ahead_high"]), "+.2f")
            over = [f"{record['ahead']:+.2f}", interval, f"{record['wins']}/{cells}"]
        mean = f"{record['gain']:.2f} ± {record['std']:.2f}"
        interval = span((record["gain_low"], record["gain_high"]))
        rows.append([f"{record['noise']:g}", record["policy"], mean, interval, *over])
        if "arrived" in record:
            rows[-1] += to_the_egg([record[column] for column in EGG], cells)
    return Table(headings, rows)


def records(results: xr.Dataset) -> list[dict[str, Any]]:
    """A record per level and policy, with all its numbers and where they come from."""
    sizes = {"cells": results.sizes["cell"], "worlds": results.sizes.get("world", 1)}
    origin = {name: results.attrs[name] for name in ("life", "seed", "commit")}
    table = results[[name for name in COLUMNS | EGG if name in results]]
    found = []
    for level, policy in itertools.product(
        results["noise"].values.tolist(), results["policy"].values.tolist()
    ):
        numbers = {str(name): each.item() for name, each in table.sel(noise=level, policy=policy).items()}
        of = {"kind": results.attrs["kind"], "noise": level, "policy": policy}
        found.append(of | numbers | sizes | origin)
    return found
