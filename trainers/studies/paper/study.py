"""Reproducing the paper: what is trained, tested, judged and written, and in which order."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from swarm.population.results import RIVAL
from swarm.population.statistics import fraction_of_limit
from trainers.jobs.executors import Task
from trainers.studies import stacks, zoo
from trainers.studies.claims import DEVISED, all_claims, statements
from trainers.studies.paper import report
from trainers.studies.paper.illustrations import draw_all
from trainers.studies.paper.measurements import (
    MEASURES,
    Case,
    Evidence,
    Measured,
    measure,
    swinging_circle,
)
from trainers.studies.paper.plan import EGG, RECORDS, TESTS, Plan
from trainers.studies.paper.report import Findings
from trainers.studies.plan import Training
from trainers.studies.stacks import Stack
from trainers.studies.study import FIGURES, Contents, Study, do
from trainers.training.run_folder import RunFolder

CLAIMS, RESULTS, SEEDS = "claims.json", "results.csv", "seeds.csv"
LIVES = "lives"  # of every cell, a file per test
KEPT = {"drift": ("axis",)} | dict.fromkeys(("gain", "arrived", "lifetime", "wave", "winding", "broken"), ())
SHIPPED = "swarm"  # the recipe whose policies are shipped


def find(plan: Plan, planned: Sequence[Training], out: Path) -> Findings:
    """Test every policy in every world, and judge."""
    trained = stacks.stacks_of(plan, planned)
    tests = cases(plan, trained)
    gains = {key: each.gains for key, each in trained.items() if each.gains is not None}
    tasks = [Task(case.name, measure, (case,), work(case)) for case in tests]
    measured = do(plan.executor(), tasks, "tests")
    circles = {
        case.name: swinging_circle(case.world, cells=plan.swinging_cells, seed=plan.seed)
        for case in tests
        if case.name in RECORDS
    }
    evidence = Evidence(measured, circles, gains)
    recipes = list(dict.fromkeys(recipe for case in tests for recipe in case.recipes))
    claims = all_claims(statements("trainers.studies.paper", MEASURES), evidence.sample, recipes)
    return Findings(plan, planned, trained, tests, evidence, claims)


def cases(plan: Plan, trained: Mapping[stacks.Key, stacks.Trained]) -> list[Case]:
    """Every test for which there are policies."""
    found = []
    ordered = sorted((each.stack for each in trained.values()), key=lambda stack: stack.recipe != SHIPPED)
    for name, kinds in TESTS.items():
        tested = tuple(
            stack._replace(kind=kind)
            for stack in ordered
            for kind, experiment in kinds.items()
            if stack.experiment == experiment
        )
        if tested and next(iter(kinds.values())) in plan.experiments:
            cells = plan.radial_cells if name == EGG else plan.cells
            found.append(Case(name, plan.test_world(name), tested, cells, plan.seed))
    return found


def work(case: Case) -> float:
    """Roughly in their ratio tests take their time."""
    policies = 3 + sum(len(stack.policies) for stack in case.stacks)
    return policies * case.world.max_decisions * (5.0 if case.world.in_flow else 1.0)


def write(plan: Plan, planned: Sequence[Training], found: Findings, folder: Path) -> Contents:
    """Every figure of the paper under every recipe, lives, policies to be shipped, and tables."""
    few, fewer = plan.figure_cells, plan.radial_figure_cells
    shown = [case._replace(cells=fewer if case.name == EGG else few) for case in found.tests]
    curves = {key: each.curve for key, each in found.trained.items() if each.curve is not None}
    recipes = dict.fromkeys(recipe for case in found.tests for recipe in case.recipes)
    tasks = [Task(recipe, draw_all, (recipe, curves, shown, folder)) for recipe in recipes]
    drawn = [each for some in do(plan.executor(on_disk=True), tasks, "figures").values() for each in some]
    (folder / LIVES).mkdir()
    for case in found.tests:
        data = as_dataset(case, found.evidence.cases[case.name])
        compressed = {name: {"zlib": True} for name in data.data_vars}
        data.to_netcdf(folder / LIVES / f"{case.name}.nc", engine="h5netcdf", encoding=compressed)
        for stack in case.stacks if planned else ():
            if stack.recipe == SHIPPED and stack.kind != "still":
                trained = found.trained[stack.recipe, stack.experiment]
                zoo.put(folder / zoo.FOLDER, trained, tested(stack, case, found))
    return Contents(
        {RESULTS: report.result_rows(found), SEEDS: list(report.seed_rows(found))},
        {"trainings": where_from(found)},
        report.text(found, drawn),
        {CLAIMS: found.claims},
    )


STUDY = Study("radial_cells", (CLAIMS, RESULTS, SEEDS), find, write, (FIGURES, LIVES))


def where_from(found: Findings) -> dict[str, list[dict[str, Any]]]:
    """Versions, commits and settings of every training's runs."""
    trained: dict[str, list[dict[str, Any]]] = {}
    for each in found.planned:
        about: dict[str, Any] = {
            "run": each.run,
            "seeds": each.settings.seeds,
            "settings": dataclasses.asdict(each.settings),
        }
        about |= {name: RunFolder(each.folder).record.get(name) for name in ("versions", "commit")}
        trained.setdefault(f"{each.recipe}/{each.experiment}", []).append(about)
    for stack in [stack for case in found.tests for stack in case.stacks if not found.planned]:
        about = {name: stack.choice.card.get(name) for name in ("settings", "versions", "commit")}
        about |= {"shipped": True, "seeds": list(stack.seeds)}
        trained[f"{stack.recipe}/{stack.experiment}"] = [about]
    return trained


def tested(stack: Stack, case: Case, found: Findings) -> dict[str, Any]:
    outcome = found.evidence.cases[case.name]
    lives = outcome.lives[stack.recipe, stack.kind]
    gain = lives.gain[stack.chosen]
    return {
        "cells": case.cells,
        "life": case.world.life,
        "seed": case.seed,
        "gain": {name: float(getattr(gain, name)()) for name in ("mean", "std", "min", "max")},
        "limit": outcome.limit,
        "fraction_of_limit": fraction_of_limit(float(gain.mean()), outcome.limit),
        "arrived": None if case.world.egg is None else float(lives.arrived[stack.chosen].mean()),
        "greedy": float(outcome.lives[DEVISED, RIVAL].gain.mean()),
    }


def as_dataset(case: Case, outcome: Measured) -> xr.Dataset:
    """What is kept of every cell's life under every policy, (policy, cell, ...)."""
    names = [
        "/".join([*filter(None, key), *([f"seed {seed}"] if each.seeds else [])])
        for key, each in outcome.lives.items()
        for seed in each.seeds or (0,)
    ]

    def column(name: str) -> np.ndarray:
        values = np.concatenate([getattr(each, name) for each in outcome.lives.values()])
        return values if values.dtype == bool else values.astype(np.float32)

    variables = {name: (("policy", "cell", *extra), column(name)) for name, extra in KEPT.items()}
    attributes = {"test": case.name, "seed": case.seed, "life": case.world.life}
    attributes |= {} if outcome.limit is None else {"limit": outcome.limit}
    return xr.Dataset(variables, {"policy": names, "axis": ["x", "y"]}, attributes)
