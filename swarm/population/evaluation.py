"""Evaluation: one policy beside greedy and swinging on a population: results, summary and figures."""

from __future__ import annotations

import difflib
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from swarm._support import files, provenance
from swarm.physics.world import World
from swarm.policies.network import ZOO, load_policy
from swarm.policies.policy import AnyPolicy
from swarm.policies.policy_file import POLICY_FILE, PolicyError
from swarm.policies.strategies import Greedy, Random, Swinging
from swarm.population.contest import population_test
from swarm.population.results import RIVAL, save_population
from swarm.population.statistics import statistics

if TYPE_CHECKING:
    import xarray as xr

STRATEGIES = ("greedy", "optimal", "random", "swinging")
LEARNT = "dqn"  # what a trained policy is called in results
NUMBERS = ("mean", "std", "min", "max", "ci95", "fraction_of_limit")


class Evaluation(NamedTuple):
    """What `evaluate` found."""

    summary: dict[str, Any]  # what summary.json holds
    results: xr.Dataset  # what population.nc holds
    table: list[list[str]]  # a row per policy, after the row of headings


def named_policy(name: str | os.PathLike, world: World) -> AnyPolicy:
    """A strategy by its name, or a trained policy: a run folder, a file, "zoo:NAME".

    Raises PolicyError where there is no such policy, suggesting the nearest name, or where it does not fit
    the world.
    """
    if name == "optimal":
        from swarm.optimal.physical_limit import Optimal

        return Optimal(world)
    devised: dict[Any, AnyPolicy] = {"greedy": Greedy(), "swinging": Swinging(), "random": Random()}
    if name in devised:
        return devised[name]
    if isinstance(name, str) and not name.startswith(ZOO) and not Path(name).exists():
        near = difflib.get_close_matches(name, STRATEGIES, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise PolicyError(
            f"policy must be one of {', '.join(STRATEGIES)}, {ZOO}NAME, a policy file or a folder with a "
            f"{POLICY_FILE}, got {name!r}{hint}"
        )
    network = load_policy(name)
    network.check_fits(world)
    return network


def called(policy: str | os.PathLike | AnyPolicy) -> str:
    """What a policy is called in summaries: as it was named, or by its type."""
    return os.fspath(policy) if isinstance(policy, str | os.PathLike) else type(policy).__name__.lower()


def evaluate(
    policy: str | os.PathLike | AnyPolicy,
    world: World,
    *,
    experiment: str,
    cells: int = 40,
    life: float = 200.0,
    seed: int = 0,
    out: str | os.PathLike | None = None,
    name: str | None = None,
) -> Evaluation:
    """Tests a policy, greedy and swinging on the same starts; writes the folder `out` whole or not at all.

    `policy` is a name, a path or a policy itself; `name` is what the summary calls it. `out` receives
    population.nc, summary.json, gains.png, centerlines.png, comparison.png and, where there is an egg,
    radial.png. Raises PolicyError for a policy that cannot be had, FileExistsError where `out` is something
    else than a new or an empty folder.
    """
    if out is not None:
        files.check_new_folder(out)
    world = world.replace(life=life)
    player = named_policy(policy, world) if isinstance(policy, str | os.PathLike) else policy
    known = name or called(policy)
    label = known if known in STRATEGIES else LEARNT
    policies = {label: player, RIVAL: Greedy(), "swinging": Swinging()}
    results = population_test(world, policies, cells=cells, life=life, seed=seed)
    numbers = statistics(results)
    summary = summarise(results, numbers, label, policy=known, experiment=experiment)
    if out is not None:
        with files.new_folder(out) as folder:
            save_population(results, folder / "population.nc")
            text = json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False)
            (folder / "summary.json").write_text(text + "\n", encoding="utf-8")
            _draw(results, world, label, folder)
    return Evaluation(summary, results, table(results, numbers))


def summarise(
    results: xr.Dataset, numbers: dict[str, dict[str, Any]], label: str, *, policy: str, experiment: str
) -> dict[str, Any]:
    """What summary.json holds of the policy called `label` in the results; None where there is no number."""
    summary = {
        "policy": policy,
        "experiment": experiment,
        "cells": results.sizes["cell"],
        "life": results.attrs["life"],
        "seed": int(results.attrs["seed"]),
        "limit": results.attrs.get("limit"),
        "gain": {key: numbers[label][key] for key in NUMBERS},
        "greedy": {key: numbers[RIVAL][key] for key in NUMBERS},
        "difference_to_greedy": numbers[label]["difference_to_greedy"],
        "wins": numbers[label]["wins"],
        "versions": provenance.versions(),
        "commit": provenance.commit(),
    }
    if results["arrived"].values.any():
        summary["arrived"] = int(results["arrived"].sel(policy=label).sum())
    return summary


def table(results: xr.Dataset, numbers: dict[str, dict[str, Any]]) -> list[list[str]]:
    """A row per policy, in the order of their mean gains, after the row of headings."""
    headings = [
        "policy",
        "gain",
        "95% interval of the mean",
        "min",
        "max",
        "over greedy",
        "wins",
        "of the limit",
    ]
    arrivals = bool(results["arrived"].values.any())
    rows = []
    for name in sorted(numbers, key=lambda each: -numbers[each]["mean"]):
        row = numbers[name]
        ahead = row["difference_to_greedy"]["mean"]
        fraction = row["fraction_of_limit"]
        interval = "–" if row["ci95"] is None else "{:.2f} … {:.2f}".format(*row["ci95"])
        rows.append(
            [
                name,
                f"{row['mean']:.2f} ± {row['std']:.2f}",
                interval,
                f"{row['min']:.2f}",
                f"{row['max']:.2f}",
                "–" if name == RIVAL else f"{ahead:+.2f}",
                "–" if name == RIVAL else f"{row['wins']}/{results.sizes['cell']}",
                "–" if fraction is None else f"{100 * fraction:.1f}%",
            ]
        )
        if arrivals:
            rows[-1].append(f"{int(results['arrived'].sel(policy=name).sum())}/{results.sizes['cell']}")
    return [headings + ["arrived"] * arrivals, *rows]


def _draw(results: xr.Dataset, world: World, label: str, folder: Path) -> None:
    from swarm import figures

    contenders = list(dict.fromkeys([label, RIVAL]))
    figures.save(figures.gains(results, policies=contenders), folder / "gains.png")
    figures.save(
        figures.centrelines(results, world, policies=contenders, cells=40), folder / "centerlines.png"
    )
    figures.save(figures.comparison(results, world), folder / "comparison.png")
    if world.egg is not None:
        figures.save(figures.radial(results, world, policy=label), folder / "radial.png")
