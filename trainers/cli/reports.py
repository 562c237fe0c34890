"""`swarm reproduce` and `check`: what is claimed, held against what is found."""

from __future__ import annotations

import sys
from collections import Counter
from contextlib import redirect_stdout
from pathlib import Path
from typing import Annotated, Any

import typer

from trainers.cli.app import app
from trainers.cli.options import Address, Launchers


@app.command()
def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the report; what is finished there is not redone.")],
    quick: Annotated[
        bool, typer.Option("--quick", help="Test the shipped policies instead of training.")
    ] = False,
    crowd: Annotated[bool, typer.Option("--crowd", help="The experiments on crowds instead.")] = False,
    seeds: Annotated[int | None, typer.Option(help="Training seeds; default: 20, of crowds 5.")] = None,
    jobs: Annotated[int | None, typer.Option(help="Processes at once; default: 2, or 1 on one core.")] = None,
    launcher: Launchers = None,
    address: Address = None,
    publish: Annotated[Path | None, typer.Option(help="Folder for a copy without the runs.")] = None,
    ship: Annotated[bool, typer.Option("--ship", help="Replace the shipped policies by the best.")] = False,
) -> None:
    """Reproduce every figure and table of the paper, with a verdict on each of its claims."""
    from swarm._support import files
    from swarm._support.checks import check_count
    from swarm._support.terminal import Told
    from trainers.crowd import reproduction as crowds
    from trainers.crowd.plan import CrowdPlan
    from trainers.paper import reproduction as paper
    from trainers.paper.plan import Plan

    changes: dict[str, Any] = {"quick": quick}
    changes |= {} if seeds is None else {"n_seeds": check_count("--seeds", seeds)}
    changes |= {"launcher": launcher, "address": address}
    if jobs is not None or launcher is not None:
        changes["workers"] = None if jobs is None else check_count("--jobs", jobs)
    places = files.expanded(out), publish and files.expanded(publish)
    plan = CrowdPlan(**changes) if crowd else Plan(**changes)
    with plan.executor(), redirect_stdout(Told(sys.stdout)):  # a cluster stays, and what is told on the way
        if isinstance(plan, CrowdPlan):
            judged = crowds.reproduce(plan, *places, ship=ship)
        else:
            judged = paper.reproduce(plan, *places, ship=ship)
    verdicts = Counter(claim.verdict for claim in judged)
    print(f"{len(judged)} claims: " + ", ".join(f"{count} {name}" for name, count in verdicts.most_common()))
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
