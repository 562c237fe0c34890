"""The study of the smallest brain: what is trained, searched, measured and written, and in which order."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarm.physics.starts import draw_starts
from trainers.jobs.executors import Task
from trainers.studies import stacks
from trainers.studies.minimal import drawing, report
from trainers.studies.minimal.brain import gains
from trainers.studies.minimal.measurements import (
    LEVELS,
    METHODS,
    CaseFindings,
    Rung,
    file_of,
    measure,
    packed,
    rungs,
    unpacked,
    validation_gains,
)
from trainers.studies.minimal.plan import MinimalPlan, rung
from trainers.studies.minimal.report import Drawn
from trainers.studies.minimal.tables import Tabulated, tabulate
from trainers.studies.plan import Training
from trainers.studies.study import FIGURES, Contents, Study, do, do_once

RESULTS, SEARCHED = "results.csv", "searched"
ROUNDING = 1e-3  # part of the gain that rounding may cost


class Findings(NamedTuple):
    cases: dict[str, CaseFindings]
    tables: list[Tabulated]


def find(plan: MinimalPlan, planned: Sequence[Training], out: Path) -> Findings:
    """Find the smallest brains of every case, and fill lookup tables of all sizes."""
    trained, tasks = stacks.all_policies(planned), {}
    for case in plan.cases:
        networks = {
            (algorithm, nodes): trained[rung(case, algorithm, nodes)]
            for algorithm in plan.algorithms
            for nodes in plan.nodes
        }
        for method, label in METHODS.items():
            path = file_of(method, case, plan, networks, out / SEARCHED)
            tasks[path] = Task(f"{case} by {label}", rungs, (method, case, plan, networks))
    searched = do_once(plan.executor(), tasks, "searches", packed, unpacked)
    of_case: dict[str, list[Rung]] = {case: [] for case in plan.cases}
    for task in tasks.values():
        of_case[task.arguments[1]] += searched[task.label]
    tests = [Task(case, measure, (case, plan, found)) for case, found in of_case.items()]
    cases = do(plan.executor(), tests, "tests")
    world, life = plan.training_world(plan.cases[0]), plan.test_world(plan.cases[0]).life
    filled = [
        Task(f"N_T = {n}, {bins} bins", tabulate, (world.replace(n_records=n), life, bins, plan), n)
        for n in plan.records
        for bins in plan.bins
    ]
    return Findings(cases, list(do(plan.executor(), filled, "tables").values()))


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


def write(plan: MinimalPlan, planned: Sequence[Training], found: Findings, folder: Path) -> Contents:
    """The figure, a drawing of each case's smallest brain, and tables."""
    report.draw(found.cases, folder)
    drawn = {case: chosen(case, plan, each) for case, each in found.cases.items()}
    for case, each in drawn.items():
        path = folder / FIGURES / f"brain_{case}.svg"
        drawing.draw(each.brain, each.digits, f"{case}: {int(each.brain.parameters[0])} parameters", path)
    return Contents(
        {RESULTS: [row for case, each in found.cases.items() for row in report.rows(case, each)]},
        {
            "drawn": {case: {"gain": each.gain, "inputs": each.brain.inputs} for case, each in drawn.items()},
            "trainings": {each.name: dataclasses.asdict(each.settings) for each in planned},
        },
        report.text(plan, found.cases, drawn, found.tables),
    )


STUDY = Study("nodes", (RESULTS,), find, write, needs=("the searches need", "cma", "neat"))
