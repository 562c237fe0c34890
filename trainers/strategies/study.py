"""The table of all strategies: training, searching, measuring, drawing and writing, in this order.

Trainings are run folders in OUT/runs, which a command that goes on uses again. Every other file is written
again at the end, each whole.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from swarm._support import provenance
from swarm._support.checks import check_installed
from swarm._support.tables import Table
from trainers.jobs.executors import Task
from trainers.paper import stacks
from trainers.paper.delivery import RECORD, REPORT, Delivery, do, write_json
from trainers.paper.plan import Training, trainings
from trainers.strategies import illustrations, report
from trainers.strategies.measurements import WorldFindings, measure, minimal
from trainers.strategies.plan import StrategiesPlan

RESULTS, DIGITS = "results.csv", 6
DELIVERY = Delivery((RESULTS,), (illustrations.FOLDER,))


def study(plan: StrategiesPlan, out: Path, publish: Path | None = None) -> dict[str, WorldFindings]:
    """Train what is trained, test every strategy in every world, and report into `out`, with a copy of all
    but the runs in `publish`.

    Raises ReproductionError, SettingsError, ImportError, KeyboardInterrupt or OSError.
    """
    check_installed("the search for the smallest brain needs", "cma", extra="evolution")
    for folder in (out, publish or out):
        DELIVERY.check(folder)
    planned = trainings(plan, out)
    stacks.train(plan, planned)
    searches = [Task(f"smallest brain in {name}", minimal, (name, plan)) for name in plan.worlds]
    brains = do(plan.executor(), searches, "searches")
    tests = []
    for name, smallest in zip(plan.worlds, brains, strict=True):
        of_world = {each.experiment: stacks.policies_of(each) for each in planned}
        trained = {
            experiment.rsplit("_", 1)[1]: policies
            for experiment, policies in of_world.items()
            if experiment.rsplit("_", 1)[0] == name
        }
        tests.append(Task(name, measure, (name, plan, trained, smallest)))
    found = dict(zip(plan.worlds, do(plan.executor(), tests, "tests"), strict=True))
    DELIVERY.deliver(out, publish, lambda staged: _write(staged, plan, found, planned))
    return found


def _write(
    folder: Path, plan: StrategiesPlan, found: Mapping[str, WorldFindings], planned: Sequence[Training]
) -> None:
    illustrations.draw(found, folder)
    rows = [row for name, each in found.items() for row in report.rows(name, each)]
    (folder / RESULTS).write_text(Table.of(rows).as_csv(DIGITS), encoding="utf-8")
    settings = {each.experiment: dataclasses.asdict(each.settings) for each in planned}
    write_json(folder / RECORD, {"plan": plan.recorded(), **provenance.origin(), "trainings": settings})
    (folder / REPORT).write_text(report.text(plan, found), encoding="utf-8")
