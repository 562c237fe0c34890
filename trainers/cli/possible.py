"""`swarm minimal` and `strategies`: how much of what is possible is attained, and by what."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Annotated, Any

import typer

from trainers.cli.app import app
from trainers.cli.listing import Listing

CASES = "experiment="
WORDS: dict[str, Any] = {
    "cls": Listing,
    "options_metavar": "[experiment=NAME,...] [KEY=VALUE ...] [OPTIONS]",
    "context_settings": {"allow_extra_args": True, "ignore_unknown_options": False},
}
Out = typer.Option(help="Folder for the report; what is finished there is not redone.")
Seeds = typer.Option(help="Training seeds; default: 5.")
Jobs = typer.Option(help="Processes at once; default: 2, or 1 on one core.")
Publish = typer.Option(help="Folder for a copy without the runs.")


@app.command(**WORDS)
def minimal(
    context: typer.Context,
    out: Annotated[Path, Out] = Path("runs/minimal"),
    seeds: Annotated[int | None, Seeds] = None,
    jobs: Annotated[int | None, Jobs] = None,
    publish: Annotated[Path | None, Publish] = None,
) -> None:
    """Find out how few parameters buy how much of the limit: `swarm minimal experiment=linear_n4,linear_n8`.

    Networks of 0 to 24 nodes are trained by DQN, pruned, searched by CMA-ES and NEAT
    (chemoswarm\\[evolution]), beside the two-state machine. Other KEY=VALUE words are settings of every
    training.
    """
    from trainers.minimal.plan import MinimalPlan
    from trainers.minimal.report import smallest
    from trainers.minimal.study import study

    plan = MinimalPlan(**_changes("cases", context.args, seeds, jobs))
    _report(study, plan, smallest, out, publish)


@app.command(**WORDS)
def strategies(
    context: typer.Context,
    out: Annotated[Path, Out] = Path("runs/strategies"),
    seeds: Annotated[int | None, Seeds] = None,
    jobs: Annotated[int | None, Jobs] = None,
    publish: Annotated[Path | None, Publish] = None,
) -> None:
    """Hold all strategies against the limit of each world: devised, searched, trained and optimal ones.

    Worlds are those of the paper and space, or of `experiment=NAME,...`; DQN and PPO are trained for each,
    and the smallest brain is searched for (chemoswarm\\[evolution]). Other KEY=VALUE words are settings of
    every training.
    """
    from trainers.strategies.plan import StrategiesPlan
    from trainers.strategies.report import fractions
    from trainers.strategies.study import study

    plan = StrategiesPlan(**_changes("worlds", context.args, seeds, jobs))
    _report(study, plan, fractions, out, publish)


def _changes(cases: str, words: list[str], seeds: int | None, jobs: int | None) -> dict[str, Any]:
    """What options and words change of a plan, whose experiments are called `cases`."""
    from swarm._support.checks import check_count

    named = [each for word in words if word.startswith(CASES) for each in word[len(CASES) :].split(",")]
    changes: dict[str, Any] = {cases: tuple(dict.fromkeys(named))} if named else {}
    changes["words"] = tuple(word for word in words if not word.startswith(CASES))
    changes |= {} if seeds is None else {"n_seeds": check_count("--seeds", seeds)}
    return changes | ({} if jobs is None else {"workers": check_count("--jobs", jobs)})


def _report(
    study: Callable[..., Any], plan: Any, table_of: Callable[[Any], Any], out: Path, publish: Path | None
) -> None:
    """Carry a plan out, and print what it found and where it is told at length."""
    from swarm._support import files
    from swarm._support.terminal import Told, print_table

    with redirect_stdout(Told(sys.stdout)):  # what is told on the way
        found = study(plan, files.expanded(out), publish and files.expanded(publish))
    table = table_of(found)
    print_table(table.headings, table.texts)
    print(f"the report is {out / 'report.md'}")
