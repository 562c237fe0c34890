"""`swarm evaluate`, `compare`, `watch` and `export`: what policies do, and where they go."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trainers.cli import options
from trainers.cli.app import app
from trainers.cli.listing import Listing

if TYPE_CHECKING:
    from swarm.population.evaluation import Evaluation


@app.command(cls=Listing)
def evaluate(
    policy: Annotated[str, typer.Argument(help=f"{options.POLICY}.")],
    experiment: options.Experiment = None,
    cells: options.Cells = None,
    life: options.Life = None,
    seed: options.Seed = 0,
    noise: Annotated[
        list[str] | None,
        typer.Option(
            help="Strength of a perturbation; several draw gain against noise.", metavar="LEVEL,..."
        ),
    ] = None,
    noise_kind: Annotated[
        str | None,
        typer.Option(help="What --noise perturbs, one of {noises}; default: concentration."),
    ] = None,
    worlds: options.Worlds = None,
    against: options.Against = None,
    share: options.Share = None,
    record: Annotated[
        str | None,
        typer.Option(
            help="Live block by block, and keep of each cell in --out: its end (ends), thinned or all of its "
            "course. What is there is gone on with."
        ),
    ] = None,
    launcher: options.Launcher = None,
    jobs: options.Jobs = None,
    address: options.Address = None,
    out: options.NewFolder = None,
) -> None:
    """Test a policy on fresh cells, next to greedy, swinging and the physical limit."""
    from swarm._support.tables import Table
    from swarm._support.terminal import print_table
    from trainers.cli.trial import trial

    found = trial(
        policy,
        experiment,
        cells=cells,
        worlds=worlds,
        life=life,
        seed=seed,
        levels=noise or (),
        kind=noise_kind,
        against=against,
        share=share,
        record=record,
        out=out,
        where=(launcher, jobs, address),
    )
    if isinstance(found, Table):
        print_table(found.headings, found.texts)
    else:
        print_test(found)
    if out is not None:
        print(f"results and figures are in {out}" if record is None else f"results are in {out}")


def print_test(tested: Evaluation | None) -> None:
    """The table of a population test, and the limit."""
    from swarm._support.terminal import print_table

    if tested is not None:
        limit = tested.summary["limit"]
        print_table(tested.table.headings, tested.table.texts)
        print("limit:", "none is known" if limit is None else f"{limit:.2f}, which no policy can exceed")


@app.command()
def compare(
    folders: Annotated[list[Path], typer.Argument(help="Folders of finished runs.", metavar="RUN RUN ...")],
    cells: options.Cells = None,
    worlds: options.Worlds = None,
    life: options.Life = None,
    seed: options.Seed = 0,
    launcher: options.Launcher = None,
    jobs: options.Jobs = None,
    address: options.Address = None,
    out: options.NewFolder = None,
    form: Annotated[
        str | None,
        typer.Option(
            "--format",
            help="What --out holds besides the numbers, separated by commas: tables (md, tex) and figures "
            "(png, pdf, svg); default: png. Without --out, md or tex is printed.",
            metavar="FORMAT,...",
        ),
    ] = None,
) -> None:
    """Put runs side by side, with intervals over seeds."""
    from swarm._support.terminal import print_table
    from trainers.jobs import comparison

    formats = [each.strip() for each in (form or "png").split(",")]
    printed = form if out is None and form in comparison.TABLES else None
    if out is None and form is not None and printed is None:
        raise ValueError(f"--format must be md or tex without --out, got {form!r}")
    groups = comparison.compare(
        folders,
        cells=cells,
        worlds=worlds,
        life=life,
        seed=seed,
        out=out,
        formats=formats,
        where=(launcher, jobs, address),
    )
    table = comparison.table(groups)
    if printed is not None:
        print(comparison.written(groups, printed), end="")
    else:
        print_table(table.headings, table.texts)
    if out is not None:
        print(f"table and figure are in {out}")


@app.command(cls=Listing)
def watch(
    policy: Annotated[str, typer.Argument(help=f"{options.POLICY}; or a population.nc, for a page.")],
    experiment: options.Experiment = None,
    cells: options.Cells = None,
    life: Annotated[float | None, typer.Option(help="Length of a life, t_life; default: 80.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the starts; default: 0.")] = None,
    against: options.Against = None,
    share: options.Share = None,
    out: Annotated[
        Path | None, typer.Option(help="A film (.mp4, .gif) or a page (.html); without: a window.")
    ] = None,
    size: Annotated[
        int | None, typer.Option(help="Height of a film in pixels; default: 720, of a .gif 360.")
    ] = None,
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


@app.command()
def export(
    policy: Annotated[str, typer.Argument(help="A run folder, a policy file or zoo:NAME.")],
    format: Annotated[str, typer.Option(help="onnx, c (a C99 header) or json.")],
    out: Annotated[
        Path | None, typer.Option(help="New file; default: the policy's name, in this folder.")
    ] = None,
) -> None:
    """Write a trained policy for other programs, and say what a decision costs."""
    from swarm.policies.export import default_path, export_policy
    from swarm.policies.network import load_policy
    from swarm.population.evaluation import STRATEGIES

    path = default_path(policy, format) if out is None else out
    network: Any = policy if policy in STRATEGIES else load_policy(policy)  # a strategy is refused
    found = export_policy(network, path, format)
    print(f"{network!r} is written to {path}")
    print(f"{found.parameters} parameters, {found.bytes} bytes in float32")
    print(f"per decision: {found.multiplications} multiplications, {found.tanhs} tanh")
