"""`swarm study`: a grid of settings, seeds and tests in one file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trainers.cli.app import app
from trainers.cli.options import Address, Jobs, Launchers


@app.command()
def study(
    source: Annotated[Path, typer.Argument(help="A study's file (.yaml), or its folder.", metavar="STUDY")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the study, new or its own; default: runs/NAME of the file.")
    ] = None,
    figure: Annotated[
        list[str] | None,
        typer.Option(
            help="Draw a statistic against an axis, too; of a folder draw it and do nothing else.",
            metavar="STATISTIC:AXIS[:AXIS=VALUE,...]",
        ),
    ] = None,
    launcher: Annotated[str | None, Launchers] = None,
    jobs: Annotated[int | None, Jobs] = None,
    address: Annotated[str | None, Address] = None,
) -> None:
    """Train and test a grid of settings, seeds and tests; what is there is not done again."""
    import sys
    from contextlib import redirect_stdout

    from swarm._support import files
    from swarm._support.terminal import Told, print_table
    from trainers.jobs import study as studies

    where = launcher, jobs, address
    if figure and files.expanded(source).is_dir():
        if out is not None or where != (None, None, None):
            raise ValueError(f"--figure of a folder must come without --out and --launcher, got {source}")
        for path in studies.draw(source, figure):
            print(f"written to {path}")
        return
    with redirect_stdout(Told(sys.stdout)):  # what is told on the way
        where = launcher or "processes", jobs, address
        found = studies.study(source, out, figures=figure or (), where=where)
    print_table(found.table.headings, found.table.texts)
    print(f"dataset, table and figures are in {found.folder}")
