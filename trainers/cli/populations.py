"""`swarm evaluate`, `compare` and `watch`: what policies do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from trainers.cli.app import app
from trainers.cli.listing import Listing
from trainers.cli.options import (
    POLICY,
    Address,
    Against,
    Cells,
    Experiment,
    Formats,
    Jobs,
    Launcher,
    Life,
    NewFolder,
    Noise,
    NoiseKind,
    Picture,
    Record,
    Seed,
    Share,
    ShortLife,
    Size,
    Worlds,
)
from trainers.cli.told import print_test


@app.command(cls=Listing)
def evaluate(
    policy: Annotated[str, typer.Argument(help=f"{POLICY}.")],
    experiment: Experiment = None,
    cells: Cells = None,
    life: Life = None,
    seed: Seed = 0,
    noise: Annotated[list[str] | None, Noise] = None,
    noise_kind: Annotated[str | None, NoiseKind] = None,
    worlds: Annotated[int | None, Worlds] = None,
    against: Annotated[str | None, Against] = None,
    share: Annotated[float | None, Share] = None,
    record: Annotated[str | None, Record] = None,
    launcher: Annotated[str | None, Launcher] = None,
    jobs: Annotated[int | None, Jobs] = None,
    address: Annotated[str | None, Address] = None,
    out: NewFolder = None,
) -> None:
    """Test a policy on fresh cells, next to greedy, swinging and the physical limit."""
    from swarm._support import files
    from swarm._support.terminal import print_table
    from trainers.jobs.trial import trial

    if out is not None and record is None:
        files.check_new_folder(out)
    sizes: dict[str, Any] = {"cells": cells, "worlds": worlds, "life": life, "seed": seed}
    perturbed: dict[str, Any] = {"levels": noise or (), "kind": noise_kind}
    run: dict[str, Any] = {"record": record, "out": out, "where": (launcher, jobs, address)}
    found = trial(policy, experiment, **sizes, **perturbed, **run, against=against, share=share)
    if out is not None:
        found.save(out)
    if found.tested is not None:
        print_test(found.tested)
    else:
        print_table(found.table.headings, found.table.texts)
    if out is not None:
        print(f"results and figures are in {out}" if record is None else f"results are in {out}")


@app.command()
def compare(
    folders: Annotated[list[Path], typer.Argument(help="Folders of finished runs.", metavar="RUN RUN ...")],
    cells: Cells = None,
    worlds: Annotated[int | None, Worlds] = None,
    life: Life = None,
    seed: Seed = 0,
    launcher: Annotated[str | None, Launcher] = None,
    jobs: Annotated[int | None, Jobs] = None,
    address: Annotated[str | None, Address] = None,
    out: NewFolder = None,
    form: Annotated[str | None, Formats] = None,
) -> None:
    """Put runs side by side, with intervals over seeds."""
    from swarm._support.terminal import print_table
    from trainers.jobs import comparison

    formats = [each.strip() for each in (form or "png").split(",")]
    printed = form if out is None and form in comparison.TABLES else None
    if out is None and form is not None and printed is None:
        raise ValueError(f"--format must be md or tex without --out, got {form!r}")
    sizes: dict[str, Any] = {"cells": cells, "worlds": worlds, "life": life, "seed": seed}
    where = launcher, jobs, address
    groups = comparison.compare(folders, **sizes, out=out, formats=formats, where=where)
    table = comparison.table(groups)
    if printed is not None:
        print(comparison.written(groups, printed), end="")
    else:
        print_table(table.headings, table.texts)
    if out is not None:
        print(f"table and figure are in {out}")


@app.command(cls=Listing)
def watch(
    policy: Annotated[str, typer.Argument(help=f"{POLICY}; or a population.nc, for a page.")],
    experiment: Experiment = None,
    cells: Cells = None,
    life: ShortLife = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the starts; default: 0.")] = None,
    against: Annotated[str | None, Against] = None,
    share: Annotated[float | None, Share] = None,
    out: Annotated[Path | None, Picture] = None,
    size: Annotated[int | None, Size] = None,
) -> None:
    """Watch a policy steer a swarm."""
    from swarm._support.checks import check_count
    from swarm._support.terminal import Progress
    from swarm.figures import watch as watching
    from trainers.settings.composition import settings_of

    if Path(policy).suffix.lower() == watching.POPULATION:
        given = {"--experiment": experiment, "--life": life, "--seed": seed, "--size": size}
        given |= {"--against": against, "--share": share}
        for option, value in given.items():
            if value is not None:
                raise ValueError(f"{option} must be left out, {policy} holds lives as they were: got {value}")
        chosen = None if cells is None else check_count("cells", cells)
        watching.save_page_of(Path(policy), out, cells=chosen)
    else:
        watching.check_target(out, size)
        world = settings_of(policy, experiment).test_world().replace(life=80.0 if life is None else life)
        shown: dict[str, Any] = {"cells": 40 if cells is None else cells, "seed": seed or 0}
        shown |= {"against": against, "share": share}
        with Progress("drawing") as bar:
            watching.watch(policy, world, out=out, size=size, progress=bar.show, **shown)
    if out is not None:
        print(f"written to {out}")
