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
Life = Annotated[
    float | None, typer.Option(help="Length of a life, t_life; default: as the experiment's test, often 200.")
]
ShortLife = Annotated[float | None, typer.Option(help="Length of a life, t_life; default: 80.")]
Seed = Annotated[int, typer.Option(help="Seed of the starts.")]
NewFolder = Annotated[Path | None, typer.Option(help="New folder for tables, results and figures.")]
Formats = typer.Option(
    "--format",
    help="What --out holds besides the numbers, separated by commas: tables (md, tex) and figures (png, pdf, "
    "svg); default: png. Without --out, md or tex is printed.",
    metavar="FORMAT,...",
)
Worlds = typer.Option(
    help="How many worlds of so many cells; default: as the experiment's test, or 1; a contest 40."
)
Against = typer.Option(help="A policy to race against in the same worlds.", metavar="POLICY")
Share = typer.Option(help="Of the cells, which the first policy steers against the other; default: 0.5.")
Noise = typer.Option(help="Strength of a perturbation; several draw gain against noise.", metavar="LEVEL,...")
NoiseKind = typer.Option(help="What --noise perturbs, one of {noises}; default: concentration.")
Picture = typer.Option(help="A film (.mp4, .gif) or a page (.html); without: a window.")
Size = typer.Option(help="Height of a film in pixels; default: 720, of a .gif 360.")
Record = typer.Option(
    help="Live block by block, and keep of each cell in --out: its end (ends), thinned or all of its course."
)
Launcher = typer.Option(help="Where work runs: here, in processes, or on a cluster by ray; default: here.")
Launchers = typer.Option(
    help="Where work runs: here, in processes, or on a cluster by ray; default: processes."
)
Jobs = typer.Option(help="How many processes at once; default: 2, of ray as many as there are cores.")
Address = typer.Option(
    help="A Ray cluster, HOST:PORT, ray://HOST:PORT or auto; default: one on this machine."
)
