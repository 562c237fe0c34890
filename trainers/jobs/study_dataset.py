"""The dataset of a study: what every cell gained, by the axes of the grid, seed, test and cell."""

import itertools
import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from swarm._support import provenance
from swarm._support.tables import Table, percent, span
from swarm.physics.world.rules import in_units
from swarm.population.noise import KINDS
from swarm.population.results import RIVAL
from swarm.population.statistics import times_to_egg
from trainers.jobs.study_figure import STATISTICS, Lives, axes_of, estimate, lives_at, sample
from trainers.jobs.study_plan import Plan

UNITS = {f"world.{kind.parameter}": kind.units for kind in KINDS.values()}
UNITS |= dict.fromkeys(("world.life", "world.time_step"), "time")
ABOUT = {
    "gain": ("concentration", "c(end of life) − c(0)"),
    "time_to_egg": ("time", "arrival at the egg, infinite for who never came"),
    "limit": ("concentration", "physical limit of the mean gain"),
    "coupled": ("1", "whether what one cell does can matter to another"),
    "tested_world": ("", "settings of the world of the test, JSON"),
    "run": ("", "folder of the run"),
    "statistics": ("", "statistics of each seed, in the units of statistic_units"),
}


class Tested(NamedTuple):
    """Where the lives of one seed's policy are."""

    results: xr.Dataset  # of a population test
    policy: str  # what it is called there
    run: str  # folder that trained it


Found = Mapping[tuple[int, int, str], Tested]  # by number of the place of the grid, seed and test


def as_dataset(plan: Plan, found: Found) -> xr.Dataset:
    """All that was found: of every cell gain and time to the egg, of the policies of all seeds (axes of the
    grid, test, seed, [world,] cell) and of the references (…, policy, …), and the statistics of every seed
    (…, statistic). NaN beyond the cells and worlds of smaller tests.
    """
    several = any("world" in each.results.dims for each in found.values())
    egg = any(world.egg is not None for point in plan.points for world, _ in point.tests.values())
    parts = []
    for place in range(len(plan.points)):
        tests = [_of_test(plan, found, place, name, several, egg) for name in plan.tests]
        parts.append(_joined(tests, "test", plan.tests))
    results = _nested(parts, list(plan.axes.items()))
    own = json.loads(next(iter(found.values())).results.attrs["world"]).get("units")
    for name in results.variables:
        units, text = ABOUT.get(str(name).removeprefix("reference_"), (UNITS.get(str(name), ""), str(name)))
        results[name].attrs = {"long_name": text} | ({"units": in_units(units, own)} if units else {})
    results["statistic_units"] = "statistic", [in_units(each.units, own) for each in STATISTICS.values()]
    return results.assign_attrs(
        title="Study: every policy on the same cells",
        study=plan.text,
        versions=json.dumps(provenance.versions()),
        commit=provenance.commit() or "",
    )


def _of_test(plan: Plan, found: Found, place: int, test: str, several: bool, egg: bool) -> xr.Dataset:
    """What one test found of the runs at a place of the grid."""
    tested = [found[place, seed, test] for seed in plan.seeds]
    about = tested[0].results.attrs
    first = [(tested[0].results, name) for name in plan.references]
    world, _ = plan.points[place].tests[test]
    inner = ("world", "cell") if several else ("cell",)
    rivals = _lives([first[0]], world.egg is not None).gain[0]
    variables: dict[str, Any] = {"run": ("seed", [each.run for each in tested])}
    variables |= {"limit": about.get("limit", np.nan), "coupled": int(about.get("coupled", 0))}
    variables["tested_world"] = about["world"]
    for prefix, axis, which in (
        ("", "seed", [(each.results, each.policy) for each in tested]),
        ("reference_", "policy", first),
    ):
        lives = _lives(which, world.egg is not None)
        lives = lives._replace(greedy=rivals, limit=variables["limit"], coupled=bool(variables["coupled"]))
        numbers = np.stack([sample(lives, name).mean(axis=1) for name in STATISTICS], axis=-1)
        variables[f"{prefix}statistics"] = (axis, "statistic"), numbers
        times = np.full(lives.gain.shape, np.nan) if lives.times is None else lives.times
        for name, values in {"gain": lives.gain, **({"time_to_egg": times} if egg else {})}.items():
            variables[prefix + name] = (axis, *inner), values if several else values[:, 0]
    sizes = dict(zip(("world", "cell"), rivals.shape, strict=True))
    coordinates = {name: np.arange(sizes[name], dtype=np.int32) for name in inner}
    own = {"seed": plan.seeds, "policy": plan.references, "statistic": list(STATISTICS)}
    return xr.Dataset(variables, coordinates | own)


def _lives(which: Sequence[tuple[xr.Dataset, str]], egg: bool) -> Lives:
    """Gains and times (policies, worlds, cells)."""

    def stacked(values: Any) -> np.ndarray:
        return np.stack([each if each.ndim == 2 else each[None] for each in values])

    gain = stacked([results["gain"].sel(policy=name).values for results, name in which])
    times = (
        stacked([times_to_egg(results).sel(policy=name).values for results, name in which]) if egg else None
    )
    return Lives(gain, gain[0], times, np.nan, False)


def _joined(parts: Sequence[xr.Dataset], axis: str, values: Sequence[Any]) -> xr.Dataset:
    how: dict[str, Any] = {"data_vars": "all", "coords": "minimal", "compat": "override", "join": "outer"}
    return xr.concat(
        parts, xr.DataArray(list(values), dims=[axis], name=axis), combine_attrs="override", **how
    )


def _nested(parts: Sequence[xr.Dataset], axes: Sequence[tuple[str, Sequence[Any]]]) -> xr.Dataset:
    """One dataset of those at every place of the axes, the last of which varies fastest."""
    if not axes:
        return parts[0]
    (name, values), *inner = axes
    size = len(parts) // len(values)
    outer = [_nested(parts[start : start + size], inner) for start in range(0, len(parts), size)]
    return _joined(outer, name, values)


def table(results: xr.Dataset) -> Table:
    """A row per place of the grid and test."""
    axes = {name: values for name, values in axes_of(results).items() if name != "seed"}
    egg = "time_to_egg" in results
    rows = []
    for values in itertools.product(*axes.values()):
        place = dict(zip(axes, values, strict=True))
        lives = lives_at(results, place)
        mean, low, high = estimate(lives, "gain")
        part = estimate(lives, "fraction_of_limit")[0]
        row: dict[str, Any] = {**place, "seeds": len(lives.gain), "gain": f"{mean:.2f}"}
        row |= {"95% interval": span((low, high)), RIVAL: f"{lives.greedy.mean():.2f}"}
        row["of the limit"] = None if np.isnan(part) else percent(part)
        if egg:
            row["arrived"] = None if lives.times is None else percent(estimate(lives, "arrived")[0])
        rows.append(row)
    return Table.of(rows)
