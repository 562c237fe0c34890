"""The table of all strategies: what is trained, searched, tested and written, and in which order."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from trainers.jobs.executors import Task
from trainers.studies import stacks
from trainers.studies.plan import Training
from trainers.studies.strategies import report
from trainers.studies.strategies.measurements import WorldFindings, measure, minimal
from trainers.studies.strategies.plan import DQN, PPO, StrategiesPlan
from trainers.studies.study import Contents, Study, do

RESULTS = "results.csv"


def find(plan: StrategiesPlan, planned: Sequence[Training], out: Path) -> dict[str, WorldFindings]:
    """Search for the smallest brains, and test every strategy in every world."""
    searches = [Task(f"smallest brain in {name}", minimal, (name, plan)) for name in plan.worlds]
    brains = do(plan.executor(), searches, "searches").values()
    policies, tests = stacks.all_policies(planned), []
    for name, smallest in zip(plan.worlds, brains, strict=True):
        trained = {each: policies[f"{name}_{each}"] for each in (DQN, PPO) if f"{name}_{each}" in policies}
        tests.append(Task(name, measure, (name, plan, trained, smallest)))
    return do(plan.executor(), tests, "tests")


def write(
    plan: StrategiesPlan, planned: Sequence[Training], found: Mapping[str, WorldFindings], folder: Path
) -> Contents:
    report.draw(found, folder)
    return Contents(
        {RESULTS: [row for name, each in found.items() for row in report.rows(name, each)]},
        {"trainings": {each.name: dataclasses.asdict(each.settings) for each in planned}},
        report.text(plan, found),
    )


STUDY = Study("worlds", (RESULTS,), find, write, needs=("the search for the smallest brain needs", "cma"))
