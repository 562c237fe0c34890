"""The experiments on crowds: what is trained, measured, judged and written, and in which order."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from swarm.optimal.physical_limit import limit
from swarm.physics.starts import draw_starts
from trainers.jobs.executors import Task
from trainers.studies import stacks, zoo
from trainers.studies.claims import all_claims, statements
from trainers.studies.crowd import report
from trainers.studies.crowd.measurements import (
    MEASURES,
    Sample,
    file_of,
    measure,
    packed,
    unpacked,
    with_best,
)
from trainers.studies.crowd.plan import (
    CROWD,
    FILM,
    FINE,
    RACE,
    SHEAR,
    SHIPPED,
    UPTAKE,
    CrowdPlan,
    Point,
    points,
)
from trainers.studies.crowd.report import VERDICTS, CrowdFindings
from trainers.studies.plan import Training
from trainers.studies.study import Contents, Study, do_once
from trainers.training import run_folder as runs
from trainers.training.run_folder import RunFolder

VERDICTS_FILE, RESULTS, MEASURED = "verdicts.json", "results.csv", "measured"


def find(plan: CrowdPlan, planned: Sequence[Training], out: Path) -> CrowdFindings:
    """Measure every point, and judge."""
    trained = {experiment: each for (_, experiment), each in stacks.stacks_of(plan, planned).items()}
    wanted = points(plan, {name: each.stack for name, each in trained.items()})
    tasks = {file_of(each, out / MEASURED): Task(each.name, measure, (each,), work(each)) for each in wanted}
    by_name = do_once(plan.executor(), tasks, "points", packed, unpacked)
    samples = with_best(by_name, plan.shear_rates)

    def sample(where: str, recipe: str) -> Sample | None:
        point, kind = where.split("/")
        return samples.get(point, {}).get(kind)

    claims = all_claims(statements("trainers.studies.crowd", MEASURES), sample, plan.recipes)
    claims = [each._replace(verdict=VERDICTS[each.verdict]) for each in claims]
    alone = plan.world(CROWD).replace(medium=None)
    cells = max(cells for cells, _ in plan.crowds)
    bound = limit(alone, draw_starts(alone, cells, plan.seed))
    return CrowdFindings(plan, samples, claims, trained, bound, minutes(planned))


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
    rows = {each.name: RunFolder(each.folder).rows(runs.TIMINGS) for each in planned}
    return {name: sum(float(row["seconds"]) for row in each) / 60 for name, each in rows.items()}


def write(plan: CrowdPlan, planned: Sequence[Training], found: CrowdFindings, folder: Path) -> Contents:
    """Figures, policies to be shipped, whose cards tell of the test in the world they were trained for, and
    tables.
    """
    drawn = report.draw(found.samples, folder)
    for name, where in SHIPPED.items() if planned else ():
        trained, (point, _, kind) = found.trained[name], where.partition("/")
        sample = found.samples.get(point, {}).get(kind, Sample((), {}))
        chosen = trained.stack.chosen
        tested = {name: float(values[chosen].mean()) for name, values in sample.numbers.items()}
        told = tested | {"test": where, "seed": plan.seed}
        zoo.put(folder / zoo.FOLDER, trained, told)
    about = {
        each.name: {"seeds": each.settings.seeds, "settings": dataclasses.asdict(each.settings)}
        | {name: RunFolder(each.folder).record.get(name) for name in ("versions", "commit")}
        for each in planned
    }
    return Contents(
        {RESULTS: [row for experiment in drawn for row in report.rows(found, experiment)]},
        {"trainings": about},
        report.text(found, drawn),
        {VERDICTS_FILE: found.claims},
    )


STUDY = Study("crowds", (VERDICTS_FILE, RESULTS), find, write)
