"""`swarm minimal`: the smallest brain that does it."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Annotated, Any

import typer

from trainers.cli.app import app
from trainers.cli.listing import Listing

CASES = "experiment="


@app.command(
    cls=Listing,
    options_metavar="[experiment=NAME,...] [KEY=VALUE ...] [OPTIONS]",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": False},
)
def minimal(
    context: typer.Context,
    out: Annotated[
        Path, typer.Option(help="Folder for the report; what is finished there is not redone.")
    ] = Path("runs/minimal"),
    seeds: Annotated[int | None, typer.Option(help="Training seeds; default: 5.")] = None,
    jobs: Annotated[int | None, typer.Option(help="Processes at once; default: 2, or 1 on one core.")] = None,
    publish: Annotated[Path | None, typer.Option(help="Folder for a copy without the runs.")] = None,
) -> None:
    """Find out how few parameters buy how much of the limit: `swarm minimal experiment=linear_n4,linear_n8`.

    Networks of 0 to 24 nodes are trained by DQN, pruned, searched by CMA-ES and NEAT (chemoswarm[evolution]),
    beside the two-state machine. Other KEY=VALUE words are settings of every training.
    """
    from swarm._support import files
    from swarm._support.checks import check_count
    from swarm._support.terminal import Told, print_table
    from trainers.minimal.plan import MinimalPlan
    from trainers.minimal.study import study

    cases = [
        each for word in context.args if word.startswith(CASES) for each in word[len(CASES) :].split(",")
    ]
    changes: dict[str, Any] = {"cases": tuple(dict.fromkeys(cases))} if cases else {}
    changes["words"] = tuple(word for word in context.args if not word.startswith(CASES))
    changes |= {} if seeds is None else {"n_seeds": check_count("--seeds", seeds)}
    changes |= {} if jobs is None else {"workers": check_count("--jobs", jobs)}
    with redirect_stdout(Told(sys.stdout)):  # what is told on the way
        found = study(MinimalPlan(**changes), files.expanded(out), publish and files.expanded(publish))
    from trainers.minimal.report import smallest

    table = smallest(found)
    print_table(table.headings, table.texts)
    print(f"the report is {out / 'report.md'}")
