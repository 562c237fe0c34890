"""Reproducing the paper: what is trained, tested, judged and written, and in which order.

Training runs are ordinary run folders in OUT/runs/RECIPE/EXPERIMENT; a reproduction that was stopped goes on
with them. Every other file of OUT is written again at the end, each whole, the report last.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from swarm._support import provenance
from swarm._support.tables import Table
from trainers.jobs.executors import Task
from trainers.paper import report, stacks, tables, zoo
from trainers.paper.claims import Claim, all_claims
from trainers.paper.delivery import (
    RECORD,
    REPORT,
    ZOO,
    Delivery,
    ReproductionError,
    check_shipping,
    do,
    staging,
    write_json,
)
from trainers.paper.illustrations import FOLDER as FIGURES
from trainers.paper.illustrations import Drawing, draw_all
from trainers.paper.measurements import Case, Circle, Evidence, Measured, measure, swinging_circle
from trainers.paper.plan import EGG, RECORDS, TESTS, Plan, trainings
from trainers.paper.tables import Findings
from trainers.training.run_folder import RunFolder

CLAIMS, RESULTS, SEEDS = "claims.json", "results.csv", "seeds.csv"
LIVES = "lives"  # of every cell, a file per test
DELIVERY = Delivery((CLAIMS, RESULTS, SEEDS), (FIGURES, LIVES))
FILES = (REPORT, *DELIVERY.files, RECORD, *DELIVERY.folders)
DIGITS = 6  # of numbers in tables
KEPT = {"drift": ("axis",)} | dict.fromkeys(("gain", "arrived", "lifetime", "wave", "winding", "broken"), ())


def reproduce(plan: Plan, out: Path, publish: Path | None = None, *, ship: bool = False) -> list[Claim]:
    """Train, test, judge, draw and report into `out`, with a copy of all but the runs in `publish`; `ship`
    puts the policies that validation prefers in the place of those that are shipped.

    Raises ReproductionError, SettingsError, KeyboardInterrupt or OSError.
    """
    folders = [out] if publish is None else [out, publish]
    for folder in folders:
        DELIVERY.check(folder)
    check_shipping(ship, plan.quick)
    planned = [] if plan.quick else trainings(plan, out)
    shipped = stacks.shipped(plan) if plan.quick else {}
    if plan.quick and not shipped:
        raise ReproductionError("no policies are shipped with this copy: leave out --quick to train them")
    stacks.train(plan, planned)
    trained = shipped or stacks.trained(planned)
    tests = cases(plan, trained)
    gains = {key: each.gains for key, each in trained.items() if each.gains is not None}
    evidence = Evidence(measured(plan, tests), circles(plan, tests), gains)
    recipes = list(dict.fromkeys(recipe for case in tests for recipe in case.recipes))
    found = Findings(plan, planned, trained, tests, evidence, all_claims(evidence, recipes))
    with staging(out) as staged:
        write(staged, found, draw(found, recipes, staged))
        for folder in folders[1:]:
            DELIVERY.put_in_place(staged, folder)
        zoo.keep(staged / ZOO, found)
        DELIVERY.put_in_place(staged, out)
    if ship:
        print(f"shipped in {zoo.SHIPPED}: {', '.join(zoo.ship(out))}")
    return list(found.claims)


# --- tests and figures --------------------------------------------------------------------------------------


def cases(plan: Plan, trained: Mapping[stacks.Key, stacks.Trained]) -> list[Case]:
    """Every test for which there are policies."""
    found = []
    ordered = sorted((each.stack for each in trained.values()), key=lambda stack: stack.recipe != "swarm")
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


def measured(plan: Plan, tests: Sequence[Case]) -> dict[str, Measured]:
    """Outcome of every test."""

    def work(case: Case) -> float:
        policies = 3 + sum(len(stack.policies) for stack in case.stacks)
        return policies * case.world.max_decisions * (5.0 if case.world.in_flow else 1.0)

    tasks = [Task(case.name, measure, (case,), work(case)) for case in tests]
    return dict(zip([case.name for case in tests], do(plan.executor(), tasks, "tests"), strict=True))


def circles(plan: Plan, tests: Sequence[Case]) -> dict[str, Circle]:
    """What swinging does for each N_T."""
    return {
        case.name: swinging_circle(case.world, cells=plan.swinging_cells, seed=plan.seed)
        for case in tests
        if case.name in RECORDS
    }


def draw(found: Findings, recipes: Sequence[str], folder: Path) -> list[Drawing]:
    """Every figure of the paper under every recipe."""
    few, fewer = found.plan.figure_cells, found.plan.radial_figure_cells
    shown = [case._replace(cells=fewer if case.name == EGG else few) for case in found.tests]
    curves = {key: each.curve for key, each in found.trained.items() if each.curve is not None}
    tasks = [Task(recipe, draw_all, (recipe, curves, shown, folder)) for recipe in recipes]
    return [each for drawn in do(found.plan.executor(on_disk=True), tasks, "figures") for each in drawn]


# --- files --------------------------------------------------------------------------------------------------


def write(folder: Path, found: Findings, drawn: Sequence[Drawing]) -> None:
    """Write everything but the figures, which are there."""
    for name, rows in ((RESULTS, tables.result_rows(found)), (SEEDS, tables.seed_rows(found))):
        (folder / name).write_text(Table.of(rows).as_csv(DIGITS), encoding="utf-8")
    claims = [each._asdict() for each in found.claims]
    for name, values in ((CLAIMS, claims), (RECORD, where_from(found))):
        write_json(folder / name, values)
    (folder / LIVES).mkdir()
    for case in found.tests:
        data = as_dataset(case, found.evidence.cases[case.name])
        compressed = {name: {"zlib": True} for name in data.data_vars}
        data.to_netcdf(folder / LIVES / f"{case.name}.nc", engine="h5netcdf", encoding=compressed)
    (folder / REPORT).write_text(report.text(found, drawn), encoding="utf-8")


def where_from(found: Findings) -> dict[str, Any]:
    """What reproduction.json says: the plan, versions, commits, and the settings of every training's runs."""
    trained: dict[str, Any] = {}
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
    return {"plan": found.plan.recorded(), **provenance.origin(), "trainings": trained}


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
