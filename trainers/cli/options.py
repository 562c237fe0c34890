"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

POLICY = (
    "A run folder, a policy file, greedy, adaptive, adaptive_on_off, swinging, random, optimal, "
    "or one of {zoo}"
)
Experiment = Annotated[
    str | None,
    typer.Option(help="Whose world; default: the policy's own, or linear_n4. One of {experiments}."),
]
Cells = Annotated[int | None, typer.Option(help="How many cells; default: as the experiment's test, or 40.")]
Worlds = Annotated[
    int | None,
    typer.Option(
        help="How many worlds of so many cells; default: as the experiment's test, or 1; a contest 40."
    ),
]
Life = Annotated[
    float | None, typer.Option(help="Length of a life, t_life; default: as the experiment's test, often 200.")
]
Seed = Annotated[int, typer.Option(help="Seed of the starts.")]
Against = Annotated[
    str | None, typer.Option(help="A policy to race against in the same worlds.", metavar="POLICY")
]
Share = Annotated[
    float | None,
    typer.Option(help="Of the cells, which the first policy steers against the other; default: 0.5."),
]
NewFolder = Annotated[Path | None, typer.Option(help="New folder for tables, results and figures.")]
Launcher = Annotated[
    str | None,
    typer.Option(help="Where work runs: here, in processes, or on a cluster by ray; default: here."),
]
Launchers = Annotated[
    str | None,
    typer.Option(help="Where work runs: here, in processes, or on a cluster by ray; default: processes."),
]
Jobs = Annotated[
    int | None,
    typer.Option(help="How many processes at once; default: 2, of ray as many as there are cores."),
]
Address = Annotated[
    str | None,
    typer.Option(help="A Ray cluster, HOST:PORT, ray://HOST:PORT or auto; default: one on this machine."),
]
