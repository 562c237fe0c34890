"""The study of the smallest brain: training, searching, measuring, drawing and writing, in this order.

Trainings are run folders in OUT/runs; what was searched is kept in OUT/searched. Both are used again by a
study that goes on. Every other file is written again at the end, each whole.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarm._support import provenance
from swarm._support.checks import check_installed
from swarm._support.tables import Table
from swarm.physics.starts import draw_starts
from trainers.jobs.executors import Task
from trainers.minimal import drawing, illustrations, report
from trainers.minimal.brain import gains
from trainers.minimal.illustrations import LEVELS
from trainers.minimal.measurements import METHODS, CaseFindings, Rung, kept, measure, validation_gains
from trainers.minimal.plan import MinimalPlan, rung
from trainers.minimal.report import Drawn
from trainers.minimal.tables import Tabulated, tabulate
from trainers.paper import stacks
from trainers.paper.delivery import RECORD, REPORT, Delivery, do, write_json
from trainers.paper.plan import Training, trainings

RESULTS, SEARCHED, DIGITS = "results.csv", "searched", 6
DELIVERY = Delivery((RESULTS,), (illustrations.FOLDER,))
ROUNDING = 1e-3  # part of the gain that rounding may cost


def study(plan: MinimalPlan, out: Path, publish: Path | None = None) -> dict[str, CaseFindings]:
    """Find the smallest brains, and report into `out`, with a copy of all but runs and searches in `publish`.

    Raises ReproductionError, SettingsError, ImportError, KeyboardInterrupt or OSError.
    """
    check_installed("the searches need", "cma", "neat", extra="evolution")
    for folder in (out, publish or out):
        DELIVERY.check(folder)
    planned = trainings(plan, out)
    stacks.train(plan, planned)
    trained = {each.experiment: stacks.policies_of(each) for each in planned}
    tasks = [
        Task(f"{case} by {METHODS[method]}", kept, (method, case, plan, networks, out / SEARCHED))
        for case in plan.cases
        for networks in [_networks(plan, case, trained)]
        for method in METHODS
    ]
    of_case: dict[str, list[Rung]] = {case: [] for case in plan.cases}
    for task, rungs in zip(tasks, do(plan.executor(on_disk=True), tasks, "searches"), strict=True):
        of_case[task.arguments[1]] += rungs
    measuring = [Task(case, measure, (case, plan, found)) for case, found in of_case.items()]
    found = dict(zip(plan.cases, do(plan.executor(), measuring, "tests"), strict=True))
    tables = _tabulated(plan)
    DELIVERY.deliver(out, publish, lambda staged: _write(staged, plan, found, planned, tables))
    return found


def _networks(
    plan: MinimalPlan, case: str, trained: Mapping[str, Sequence[Any]]
) -> dict[tuple[str, int], Sequence[Any]]:
    """Of an experiment the trained networks by algorithm and nodes."""
    return {
        (algorithm, nodes): trained[rung(case, algorithm, nodes)]
        for algorithm in plan.algorithms
        for nodes in plan.nodes
    }


def _tabulated(plan: MinimalPlan) -> list[Tabulated]:
    """Lookup tables of all sizes, which are filled again by a study that goes on."""
    world, life = plan.training_world(plan.cases[0]), plan.test_world(plan.cases[0]).life
    tasks = [
        Task(f"N_T = {n}, {bins} bins", tabulate, (world.replace(n_records=n), life, bins, plan), n)
        for n in plan.records
        for bins in plan.bins
    ]
    return do(plan.executor(), tasks, "tables")


def chosen(case: str, plan: MinimalPlan, found: CaseFindings) -> Drawn:
    """The smallest brain of all methods that reaches the highest level of those that can be drawn, of the
    seed that validation prefers, its numbers rounded as far as that costs next to nothing.
    """
    for level in (*LEVELS[::-1], -np.inf):
        smallest = filter(None, (found.smallest(method, level) for method in METHODS))
        fit = [each for each in smallest if each.rung.parameters <= drawing.MOST]
        if fit:
            break
    source = min(fit, key=lambda each: (each.rung.parameters, -float(each.validation.mean())))
    seed = int(np.argmax(source.validation))
    exact = source.rung.brains[seed : seed + 1]
    for digits in range(1, 7):
        brain = drawing.rounded(exact, digits)
        if validation_gains(case, plan, brain)[0] >= (1 - ROUNDING) * source.validation[seed]:
            break
    world = plan.test_world(case)
    starts = draw_starts(world, plan.cells, plan.seed)
    gain = float(gains(world, brain, starts, plan.seed, population="test").mean())
    return Drawn(source, seed, digits, brain, gain)


def _write(
    folder: Path,
    plan: MinimalPlan,
    found: Mapping[str, CaseFindings],
    planned: Sequence[Training],
    tables: Sequence[Tabulated],
) -> None:
    illustrations.draw(found, folder)
    drawn = {case: chosen(case, plan, each) for case, each in found.items()}
    for case, each in drawn.items():
        path = folder / illustrations.FOLDER / f"brain_{case}.svg"
        drawing.draw(each.brain, each.digits, f"{case}: {int(each.brain.parameters[0])} parameters", path)
    rows = [row for case, each in found.items() for row in report.rows(case, each)]
    (folder / RESULTS).write_text(Table.of(rows).as_csv(DIGITS), encoding="utf-8")
    settings = {each.experiment: dataclasses.asdict(each.settings) for each in planned}
    gained = {case: {"gain": each.gain, "inputs": each.brain.inputs} for case, each in drawn.items()}
    write_json(
        folder / RECORD,
        {"plan": plan.recorded(), **provenance.origin(), "drawn": gained, "trainings": settings},
    )
    (folder / REPORT).write_text(report.text(plan, found, drawn, tables), encoding="utf-8")
