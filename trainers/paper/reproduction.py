"""Reproducing the paper: what is trained, tested, judged and written, and in which order.

Training runs are ordinary run folders in OUT/runs/RECIPE/EXPERIMENT; a reproduction that was stopped goes on
with them. Every other file of OUT is written again at the end, each whole, the report last.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from swarm._support import files, provenance
from swarm._support.tables import Table
from trainers.jobs.executors import Task, executor_for, run_tasks
from trainers.paper import report, stacks, tables, zoo
from trainers.paper.claims import Claim, all_claims
from trainers.paper.illustrations import FOLDER as FIGURES
from trainers.paper.illustrations import Drawing, draw_tests, draw_training
from trainers.paper.measurements import (
    Case,
    Circle,
    Evidence,
    Measured,
    Stack,
    measure,
    swinging_circle,
)
from trainers.paper.plan import EGG, RECORDS, TESTS, Plan, Training, trainings
from trainers.training.run_folder import RunError, RunFolder

RECORD = "reproduction.json"  # settings, versions, commits; it says that a folder is a reproduction's
CLAIMS, REPORT, RESULTS, SEEDS = "claims.json", "report.md", "results.csv", "seeds.csv"
LIVES = "lives"  # of every cell, a file per test
FILES = (REPORT, CLAIMS, RESULTS, SEEDS, RECORD, FIGURES, LIVES)
DIGITS = 6  # of numbers in tables
KEPT = {"drift": ("axis",)} | dict.fromkeys(("gain", "arrived", "lifetime", "wave", "winding", "broken"), ())


class ReproductionError(RunError):
    """A reproduction that cannot go on as asked; the message says why and what can be done."""


def reproduce(plan: Plan, out: Path, publish: Path | None = None) -> list[Claim]:
    """Train, test, judge, draw and report into `out`, with a copy of all but the runs in `publish`.

    Raises ReproductionError, SettingsError, KeyboardInterrupt or OSError.
    """
    folders = [out] if publish is None else [out, publish]
    for folder in folders:
        check_folder(folder)
    planned = [] if plan.quick else trainings(plan, out)
    shipped = stacks.shipped_stacks(plan) if plan.quick else {}
    if plan.quick and not shipped:
        raise ReproductionError("no policies are shipped with this copy: leave out --quick to train them")
    do(plan, stacks.tasks(planned), "trainings")
    trained = shipped or stacks.trained_stacks(planned)
    curves = stacks.shipped_curves(shipped) or stacks.trained_curves(planned)
    tests = cases(plan, trained)
    evidence = Evidence(measured(plan, tests), circles(plan, tests), stacks.training_gains(planned))
    recipes = list(dict.fromkeys(recipe for case in tests for recipe in case.recipes))
    claims = all_claims(evidence, recipes)
    with staging(out) as staged:
        drawn = draw(plan, tests, recipes, curves, staged)
        write(staged, plan, tests, evidence, planned, claims, drawn)
        for folder in folders[1:]:
            put_in_place(staged, folder)
        zoo.keep(staged / zoo.FOLDER, planned, tests, evidence, curves)
        put_in_place(staged, out)
    return claims


def check_folder(folder: Path) -> None:
    """Raises ReproductionError where `folder` cannot be written to, or holds files that this would overwrite
    and did not write.
    """
    there = next(path for path in (folder, *folder.parents) if path.exists() or path.is_symlink())
    if not there.is_dir():
        raise ReproductionError(f"{folder} must be a folder, but {there} is a file")
    if not os.access(there, os.W_OK):
        raise ReproductionError(f"{folder} must be a folder to write to, but {there} is read-only")
    mine = [name for name in (*FILES, zoo.FOLDER) if (folder / name).exists()]
    if mine and RECORD not in mine:
        raise ReproductionError(
            f"{folder} must be a new folder or that of an earlier reproduction: {folder / mine[0]} is "
            f"there, but no {RECORD}"
        )


def do(plan: Plan, tasks: Sequence[Task], what: str) -> list[Any]:
    """Results of all tasks; raises ReproductionError that names those that failed."""
    results = run_tasks(tasks, executor_for(plan.workers), title=what)
    failed = [
        f"{task.label}: {result}"
        for task, result in zip(tasks, results, strict=True)
        if isinstance(result, Exception)
    ]
    if failed:
        raise ReproductionError(
            f"{len(failed)} of {len(tasks)} {what} failed: {'; '.join(failed)}; the same command goes on "
            "with them"
        )
    return results


# --- tests and figures --------------------------------------------------------------------------------------


def cases(plan: Plan, trained: Mapping[stacks.Key, Stack]) -> list[Case]:
    """Every test for which there are policies."""
    found = []
    for name, kinds in TESTS.items():
        tested = tuple(
            stack._replace(kind=kind)
            for (_, experiment), stack in sorted(trained.items(), key=lambda item: item[0][0] != "swarm")
            for kind, wanted in kinds.items()
            if experiment == wanted
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
    return dict(zip([case.name for case in tests], do(plan, tasks, "tests"), strict=True))


def circles(plan: Plan, tests: Sequence[Case]) -> dict[str, Circle]:
    """What swinging does for each N_T."""
    return {
        case.name: swinging_circle(case.world, cells=plan.swinging_cells, seed=plan.seed)
        for case in tests
        if case.name in RECORDS
    }


def draw(
    plan: Plan, tests: Sequence[Case], recipes: Sequence[str], curves: stacks.Curves, folder: Path
) -> list[Drawing]:
    """Every figure of the paper under every recipe."""
    drawn = [each for recipe in recipes for each in draw_training(recipe, curves, folder)]
    tasks = []
    for recipe in recipes:
        mine = [
            (case, plan.radial_figure_cells if case.name == EGG else plan.figure_cells)
            for case in tests
            if recipe in case.recipes
        ]
        tasks.append(Task(recipe, draw_tests, (mine, recipe, folder), 1.0))
    drawn += [each for result in do(plan, tasks, "figures") for each in result]
    return sorted(drawn, key=lambda each: (recipes.index(each.recipe), each.number))


# --- files --------------------------------------------------------------------------------------------------


@contextmanager
def staging(out: Path) -> Iterator[Path]:
    """A folder to write to, removed at the end."""
    folder = out / f".writing.{uuid.uuid4().hex[:12]}"
    for left in out.glob(".writing.*"):  # by a reproduction that was killed
        shutil.rmtree(left, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def write(
    folder: Path,
    plan: Plan,
    tests: Sequence[Case],
    evidence: Evidence,
    planned: Sequence[Training],
    claims: Sequence[Claim],
    drawn: Sequence[Drawing],
) -> None:
    """Write everything but the figures, which are there."""
    results = tables.result_rows(tests, evidence)
    for name, rows in ((RESULTS, results), (SEEDS, tables.seed_rows(tests, evidence))):
        (folder / name).write_text(Table.of(rows).as_csv(DIGITS), encoding="utf-8")
    for name, values in (
        (CLAIMS, [each._asdict() for each in claims]),
        (RECORD, where_from(plan, planned, tests)),
    ):
        stored = json.dumps(values, indent=2, allow_nan=False, ensure_ascii=False)
        (folder / name).write_text(stored + "\n", encoding="utf-8")
    (folder / LIVES).mkdir()
    for case in tests:
        data = as_dataset(case, evidence.cases[case.name])
        compressed = {name: {"zlib": True} for name in data.data_vars}
        data.to_netcdf(folder / LIVES / f"{case.name}.nc", engine="h5netcdf", encoding=compressed)
    text = report.text(plan, tests, evidence, claims, results, tables.training_rows(planned), drawn)
    (folder / REPORT).write_text(text, encoding="utf-8")


def where_from(plan: Plan, planned: Sequence[Training], tests: Sequence[Case]) -> dict[str, Any]:
    """What reproduction.json says: the plan, versions, commits, and the settings of every training's runs."""
    trained: dict[str, Any] = {}
    for each in planned:
        about: dict[str, Any] = {
            "run": each.run,
            "seeds": each.settings.seeds,
            "settings": dataclasses.asdict(each.settings),
        }
        about |= {name: RunFolder(each.folder).record.get(name) for name in ("versions", "commit")}
        trained.setdefault(f"{each.recipe}/{each.experiment}", []).append(about)
    for stack in [stack for case in tests for stack in case.stacks if not planned]:
        about = {name: stack.choice.card.get(name) for name in ("settings", "versions", "commit")}
        about |= {"shipped": True, "seeds": list(stack.seeds)}
        trained[f"{stack.recipe}/{stack.experiment}"] = [about]
    plain = dataclasses.asdict(plan)
    plain.pop("workers")  # no number depends on it
    origin = {"versions": provenance.versions(), "commit": provenance.commit()}
    return {"plan": plain, **origin, "trainings": trained}


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


def put_in_place(staged: Path, out: Path) -> None:
    """Copy what was written, file by file and each whole: first the record, which says whose folder it is,
    last the report. What is left of an earlier reproduction goes.
    """
    written = {path.relative_to(staged) for path in staged.rglob("*") if path.is_file()}
    for old in [
        path for name in (FIGURES, LIVES, zoo.FOLDER) for path in (out / name).rglob("*") if path.is_file()
    ]:
        if old.relative_to(out) not in written:
            old.unlink()
    for path in sorted(written, key=lambda path: (path.name == REPORT, path.name != RECORD)):
        (out / path).parent.mkdir(parents=True, exist_ok=True)
        files.write_bytes(out / path, (staged / path).read_bytes())
