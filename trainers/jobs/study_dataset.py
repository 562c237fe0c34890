"""The dataset of a study: what every cell gained, by the axes of the grid, seed, test and cell."""

import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from swarm._support import provenance
from swarm.physics.world import World
from swarm.physics.world.rules import in_units
from swarm.population.noise import KINDS
from swarm.population.results import load_population
from swarm.population.statistics import times_to_egg
from trainers.jobs.statistics import STATISTICS, Lives, estimate, sample
from trainers.jobs.study_figure import VARIABLES, axes_of, lives_at
from trainers.jobs.study_plan import Plan

UNITS = {f"world.{kind.parameter}": kind.units for kind in KINDS.values()}
UNITS |= dict.fromkeys(("world.life", "world.time_step"), "time")


class Tested(NamedTuple):
    """Where the lives of one seed's policy are."""

    file: Path  # of a population test
    policy: str  # what it is called there
    run: str  # folder that trained it


Tests = dict[tuple[int, int, str], Tested]  # by number of the place of the grid, seed and test


def as_dataset(plan: Plan, tests: Tests) -> xr.Dataset:
    """All that was found: of every cell gain and time to the egg, of the policies of all seeds (axes of the
    grid, test, seed, [world,] cell) and of the references (…, policy, …), the statistics of every seed
    (…, statistic), and of all seeds their intervals. NaN beyond the cells and worlds of smaller tests.
    """
    loaded = {file: load_population(file) for file in {each.file for each in tests.values()}}
    several = any("world" in each.dims for each in loaded.values())
    egg = any(world.egg is not None for point in plan.points for world, _ in point.tests.values())
    parts = []
    for place, point in enumerate(plan.points):
        found = []
        for test, (world, _) in point.tests.items():
            ran = [tests[place, seed, test] for seed in plan.seeds]
            found.append(_of_test(plan, world, ran, loaded, several, egg))
        parts.append(_joined(found, "test", plan.tests))
    results = _with_statistics(_nested(parts, list(plan.axes.items())))
    own = json.loads(next(iter(loaded.values())).attrs["world"]).get("units")
    for name in results.variables:
        units, text = VARIABLES.get(
            str(name).removeprefix("reference_"), (UNITS.get(str(name), ""), str(name))
        )
        results[name].attrs = {"long_name": text} | ({"units": in_units(units, own)} if units else {})
    results["statistic_units"] = "statistic", [in_units(each.units, own) for each in STATISTICS.values()]
    return results.assign_attrs(
        title="Study: every policy on the same cells",
        study=plan.text,
        versions=json.dumps(provenance.versions()),
        commit=provenance.commit() or "",
    )


def _of_test(
    plan: Plan,
    world: World,
    ran: Sequence[Tested],
    loaded: Mapping[Path, xr.Dataset],
    several: bool,
    egg: bool,
) -> xr.Dataset:
    """What cells gained in one test of the runs at a place of the grid, and when they came to an egg."""
    first = loaded[ran[0].file]
    variables: dict[str, Any] = {"run": ("seed", [each.run for each in ran])}
    variables |= {"limit": first.attrs.get("limit", np.nan), "coupled": int(first.attrs.get("coupled", 0))}
    variables["tested_world"] = first.attrs["world"]
    inner = ("world", "cell") if several else ("cell",)
    for prefix, axis, which in (
        ("", "seed", [(loaded[each.file], each.policy) for each in ran]),
        ("reference_", "policy", [(first, name) for name in plan.references]),
    ):
        gain = [results["gain"].sel(policy=name).values for results, name in which]
        times = [np.full_like(each, np.nan) for each in gain]
        if world.egg is not None:
            times = [times_to_egg(results).sel(policy=name).values for results, name in which]
        for name, values in {"gain": gain, **({"time_to_egg": times} if egg else {})}.items():
            found = np.stack(values)
            variables[prefix + name] = (
                (axis, *inner),
                found[:, None] if found.ndim < 1 + len(inner) else found,
            )
    results = xr.Dataset(variables, {"seed": plan.seeds, "policy": plan.references})
    return results.assign_coords({name: np.arange(results.sizes[name], dtype=np.int32) for name in inner})


def _with_statistics(found: xr.Dataset) -> xr.Dataset:
    """And the statistics of every seed and reference, and the intervals of those over all seeds."""
    axes = {name: values for name, values in axes_of(found).items() if name != "seed"}

    def everywhere(of: Callable[[dict[str, Any]], Any]) -> np.ndarray:
        places = (dict(zip(axes, each, strict=True)) for each in itertools.product(*axes.values()))
        values = np.array([of(place) for place in places])
        return values.reshape(*map(len, axes.values()), *values.shape[1:])

    def of_seeds(lives: Lives) -> np.ndarray:
        return np.stack([sample(lives, name).mean(axis=1) for name in STATISTICS], axis=-1)

    own = everywhere(lambda place: of_seeds(lives_at(found, place)))
    names = found["policy"].values
    rivals = everywhere(lambda place: [of_seeds(lives_at(found, place, name))[0] for name in names])
    ends = everywhere(lambda at: [estimate(lives_at(found, at), name)[1:] for name in STATISTICS])
    return found.assign(
        statistics=((*axes, "seed", "statistic"), own),
        reference_statistics=((*axes, "policy", "statistic"), rivals),
        low=((*axes, "statistic"), ends[..., 0]),
        high=((*axes, "statistic"), ends[..., 1]),
    ).assign_coords(statistic=list(STATISTICS))


def _joined(parts: Sequence[xr.Dataset], axis: str, values: Sequence[Any]) -> xr.Dataset:
    how: dict[str, Any] = {"data_vars": "all", "coords": "minimal", "compat": "override", "join": "outer"}
    named = xr.DataArray(list(values), dims=[axis], name=axis)
    return xr.concat(parts, named, combine_attrs="override", **how)


def _nested(parts: Sequence[xr.Dataset], axes: Sequence[tuple[str, Sequence[Any]]]) -> xr.Dataset:
    """One dataset of those at every place of the axes, the last of which varies fastest."""
    if not axes:
        return parts[0]
    (name, values), *inner = axes
    size = len(parts) // len(values)
    outer = [_nested(parts[start : start + size], inner) for start in range(0, len(parts), size)]
    return _joined(outer, name, values)
