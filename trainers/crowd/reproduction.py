"""The experiments on crowds: training, measuring, judging and writing, in this order.

Trainings are run folders in OUT/runs, as the paper's are; what is measured at a point is kept in
OUT/measured. Both are used again by a run that goes on. Every other file is written again at the end, each
whole.
"""

import dataclasses
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from swarm._support import provenance
from swarm._support.tables import Table
from swarm.optimal.physical_limit import limit
from swarm.physics.starts import draw_starts
from trainers.crowd import illustrations, report
from trainers.crowd.measurements import MEASURES, CrowdEvidence, keep_at, kept, measure, with_best
from trainers.crowd.plan import CROWD, FILM, FINE, RACE, SHEAR, SHIPPED, UPTAKE, CrowdPlan, Point, points
from trainers.crowd.report import VERDICTS, CrowdFindings
from trainers.jobs.executors import Task
from trainers.paper import stacks, zoo
from trainers.paper.claims import Claim, all_claims, statements
from trainers.paper.delivery import RECORD, REPORT, ZOO, Delivery, check_shipping, do, staging, write_json
from trainers.paper.measurements import Stack
from trainers.paper.plan import Training, trainings
from trainers.training import run_folder as runs
from trainers.training.run_folder import RunFolder

VERDICTS_FILE, RESULTS, MEASURED = "verdicts.json", "results.csv", "measured"
DELIVERY = Delivery((VERDICTS_FILE, RESULTS), (illustrations.FOLDER,))
DIGITS = 6  # of numbers in tables


def reproduce(plan: CrowdPlan, out: Path, publish: Path | None = None, *, ship: bool = False) -> list[Claim]:
    """Train, measure, judge, draw and report into `out`, with a copy of all but runs and what was measured in
    `publish`; `ship` puts the policies that validation prefers in the place of those that are shipped.

    Raises ReproductionError, SettingsError, KeyboardInterrupt or OSError.
    """
    for folder in (out, publish or out):
        DELIVERY.check(folder)
    check_shipping(ship, plan.quick)
    planned = [] if plan.quick else trainings(plan, out)
    trained = stacks.shipped(plan) if plan.quick else {}
    stacks.train(plan, planned)
    trained = trained or stacks.trained(planned)
    named = {experiment: each for (_, experiment), each in trained.items()}
    found = find(plan, {name: each.stack for name, each in named.items()}, out / MEASURED)
    found = found._replace(
        curves={name: each.curve for name, each in named.items()}, minutes=minutes(planned)
    )
    with staging(out) as staged:
        write(staged, found, planned)
        if publish is not None:
            DELIVERY.put_in_place(staged, publish)
        for each in planned:
            if each.experiment in SHIPPED:
                keep(staged / ZOO, found, each, named[each.experiment].stack)
        DELIVERY.put_in_place(staged, out)
    if ship:
        print(f"shipped in {zoo.SHIPPED}: {', '.join(zoo.ship(out))}")
    return list(found.claims)


def find(plan: CrowdPlan, trained: dict[str, Stack], folder: Path) -> CrowdFindings:
    """Measure every point, and judge."""
    planned = points(plan, trained)
    by_name = {each.name: found for each in planned if (found := kept(each, folder)) is not None}
    left = [each for each in planned if each.name not in by_name]
    tasks = [
        Task(each.name, measure, (each,), work(each), keep=partial(keep_at, each, folder)) for each in left
    ]
    by_name |= zip([each.name for each in left], do(plan.executor(), tasks, "points"), strict=True)
    evidence = CrowdEvidence(with_best(by_name, plan.shear_rates))
    asked = statements("trainers.crowd", MEASURES)
    claims = [
        each._replace(verdict=VERDICTS[each.verdict]) for each in all_claims(evidence, plan.recipes, asked)
    ]
    alone = plan.world(CROWD).replace(medium=None)
    cells = max(cells for cells, _ in plan.crowds)
    return CrowdFindings(plan, evidence, claims, {}, limit(alone, draw_starts(alone, cells, plan.seed)), {})


def work(point: Point) -> float:
    """Roughly in their ratio points take their time."""
    policies = 1 + sum(len(stack.policies) for stack in point.stacks)
    decision = {  # [ms]
        UPTAKE: 0.5 + 0.005 * point.cells,
        FINE: 4.0,
        RACE: 0.01,
        SHEAR: 0.012 * point.cells,
        FILM: 300.0,
    }
    return policies * point.world.max_decisions * point.worlds * decision[point.experiment]


def minutes(planned: Sequence[Training]) -> dict[str, float]:
    """What every training took."""
    rows = {each.experiment: RunFolder(each.folder).rows(runs.TIMINGS) for each in planned}
    return {name: sum(float(row["seconds"]) for row in each) / 60 for name, each in rows.items()}


def write(folder: Path, found: CrowdFindings, planned: Sequence[Training]) -> None:
    """Write all files."""
    drawn = illustrations.draw(found.plan, found.evidence, folder)
    rows = [row for experiment in drawn for row in report.rows(found, experiment)]
    headings = list(dict.fromkeys(heading for row in rows for heading in row))
    full = [{heading: row.get(heading) for heading in headings} for row in rows]
    (folder / RESULTS).write_text(Table.of(full).as_csv(DIGITS), encoding="utf-8")
    claims = [each._asdict() for each in found.claims]
    for name, values in ((VERDICTS_FILE, claims), (RECORD, where_from(found.plan, planned))):
        write_json(folder / name, values)
    (folder / REPORT).write_text(report.text(found, drawn), encoding="utf-8")


def where_from(plan: CrowdPlan, planned: Sequence[Training]) -> dict[str, Any]:
    """What reproduction.json says: the plan, versions, commits, and the settings of every training."""
    trained = {
        each.experiment: {"seeds": each.settings.seeds, "settings": dataclasses.asdict(each.settings)}
        | {name: RunFolder(each.folder).record.get(name) for name in ("versions", "commit")}
        for each in planned
    }
    return {"plan": plan.recorded(), **provenance.origin(), "trainings": trained}


def keep(folder: Path, found: CrowdFindings, training: Training, stack: Stack) -> None:
    """Write the policy to be shipped, whose card tells of the test in the world it was trained for."""
    curve = found.curves[training.experiment]
    assert curve is not None, "what was trained has a curve"
    where = SHIPPED[training.experiment]
    sample = found.evidence.sample(where, training.recipe)
    numbers = {} if sample is None else sample.numbers
    tested = {name: float(values[stack.chosen].mean()) for name, values in numbers.items()}
    told = tested | {"test": where, "seed": found.plan.seed}
    zoo.put(folder, stack, dataclasses.asdict(training.settings), told, curve)
