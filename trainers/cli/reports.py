"""`swarm reproduce`, `minimal`, `strategies` and `check`: what is claimed or possible, and what is found."""

from __future__ import annotations

import sys
from collections import Counter
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trainers.cli.app import app
from trainers.cli.listing import Listing
from trainers.cli.options import Address, Launchers

if TYPE_CHECKING:
    from swarm._support.tables import Table
    from trainers.studies.plan import TrainingPlan
    from trainers.studies.study import Study

CASES = "experiment="
WORDS: dict[str, Any] = {
    "cls": Listing,
    "options_metavar": "[experiment=NAME,...] [KEY=VALUE ...] [OPTIONS]",
    "context_settings": {"allow_extra_args": True, "ignore_unknown_options": False},
}
Out = Annotated[Path, typer.Option(help="Folder for the report; what is finished there is not redone.")]
Seeds = Annotated[int | None, typer.Option(help="Training seeds; default: 5.")]
Jobs = Annotated[int | None, typer.Option(help="Processes at once; default: 2, or 1 on one core.")]
Publish = Annotated[Path | None, typer.Option(help="Folder for a copy without the runs.")]


@app.command()
def reproduce(
    out: Out,
    quick: Annotated[
        bool, typer.Option("--quick", help="Test the shipped policies instead of training.")
    ] = False,
    crowd: Annotated[bool, typer.Option("--crowd", help="The experiments on crowds instead.")] = False,
    seeds: Annotated[int | None, typer.Option(help="Training seeds; default: 20, of crowds 5.")] = None,
    jobs: Jobs = None,
    launcher: Launchers = None,
    address: Address = None,
    publish: Publish = None,
    ship: Annotated[bool, typer.Option("--ship", help="Replace the shipped policies by the best.")] = False,
) -> None:
    """Reproduce every figure and table of the paper, with a verdict on each of its claims."""
    from trainers.studies.crowd.plan import CrowdPlan
    from trainers.studies.crowd.report import STUDY as CROWDS
    from trainers.studies.paper.plan import Plan
    from trainers.studies.paper.report import STUDY as PAPER

    changes: dict[str, Any] = {"quick": quick, "launcher": launcher, "address": address}
    changes |= {"workers": None} if launcher is not None else {}
    kind, study = (CrowdPlan, CROWDS) if crowd else (Plan, PAPER)
    plan = kind(**changes | _changes(seeds, jobs))
    with plan.executor():  # a cluster stays
        judged = _carried_out(study, plan, out, publish, ship=ship).claims
    verdicts = Counter(claim.verdict for claim in judged)
    print(f"{len(judged)} claims: " + ", ".join(f"{count} {name}" for name, count in verdicts.most_common()))
    print(f"the report is {out / 'report.md'}")


@app.command(**WORDS)
def minimal(
    context: typer.Context,
    out: Out = Path("runs/minimal"),
    seeds: Seeds = None,
    jobs: Jobs = None,
    publish: Publish = None,
) -> None:
    """Find out how few parameters buy how much of the limit: `swarm minimal experiment=linear_n4,linear_n8`.

    Networks of 0 to 24 nodes are trained by DQN, pruned, searched by CMA-ES and
    NEAT (chemoswarm\\[evolution]), beside the two-state machine. Other KEY=VALUE
    words are settings of every training.
    """
    from trainers.studies.minimal.plan import MinimalPlan
    from trainers.studies.minimal.report import STUDY, smallest

    plan = MinimalPlan(**_chosen("cases", context.args), **_changes(seeds, jobs))
    _print(smallest(_carried_out(STUDY, plan, out, publish).cases), out)


@app.command(**WORDS)
def strategies(
    context: typer.Context,
    out: Out = Path("runs/strategies"),
    seeds: Seeds = None,
    jobs: Jobs = None,
    publish: Publish = None,
) -> None:
    """Hold all strategies against the limit of each world: devised, searched, trained and optimal ones.

    Worlds are those of the paper and space, or of `experiment=NAME,...`; DQN and
    PPO are trained for each, and the smallest brain is searched for
    (chemoswarm\\[evolution]). Other KEY=VALUE words are settings of every training.
    """
    from trainers.studies.strategies.plan import StrategiesPlan
    from trainers.studies.strategies.report import STUDY, overview

    plan = StrategiesPlan(**_chosen("worlds", context.args), **_changes(seeds, jobs))
    _print(overview(_carried_out(STUDY, plan, out, publish)), out)


def _chosen(cases: str, words: list[str]) -> dict[str, Any]:
    """What words change of a plan, whose experiments are called `cases`."""
    named = [each for word in words if word.startswith(CASES) for each in word[len(CASES) :].split(",")]
    changes: dict[str, Any] = {cases: tuple(dict.fromkeys(named))} if named else {}
    return changes | {"words": tuple(word for word in words if not word.startswith(CASES))}


def _changes(seeds: int | None, jobs: int | None) -> dict[str, Any]:
    """What options change of a plan."""
    from swarm._support.checks import check_count

    changes = {} if seeds is None else {"n_seeds": check_count("--seeds", seeds)}
    return changes | ({} if jobs is None else {"workers": check_count("--jobs", jobs)})


def _carried_out(
    study: Study, plan: TrainingPlan, out: Path, publish: Path | None, *, ship: bool = False
) -> Any:
    """What a study found."""
    from swarm._support import files
    from swarm._support.terminal import Told

    with redirect_stdout(Told(sys.stdout)):  # what is told on the way
        return study.carry_out(plan, files.expanded(out), publish and files.expanded(publish), ship=ship)


def _print(table: Table, out: Path) -> None:
    from swarm._support.terminal import print_table

    print_table(table.headings, table.texts)
    print(f"the report is {out / 'report.md'}")


@app.command()
def check() -> None:
    """Run every check of the environments' interfaces there is, warnings as errors."""
    from swarm._support.terminal import Progress, print_table
    from swarm.envs.conformance import checks, run_checks

    found = []
    with Progress("checks", len(checks())) as bar:
        for each in run_checks():
            found.append(each)
            bar.show(len(found))
    results = {True: "passed", False: "FAILED", None: "skipped"}
    rows = [[results[each.passed], each.name, each.detail] for each in found]
    print_table(["result", "check", "detail"], rows)
    if any(each.passed is False for each in found):
        raise typer.Exit(1)
