"""`swarm evaluate`, `compare`, `watch` and `export`: what policies do, and where they go."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trainers.cli import options
from trainers.cli.app import app
from trainers.cli.listing import Listing

if TYPE_CHECKING:
    from swarm._support.tables import Table
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
    from swarm._support import files
    from swarm._support.terminal import Progress
    from swarm.figures.evaluation import save_contest, save_evaluation, save_noise_sweep
    from swarm.population import contests, evaluation
    from swarm.population import noise as noises
    from trainers.cli.recorded import recorded
    from trainers.settings.composition import settings_of

    levels, where = noises.levels_of(noise or ()), (launcher, jobs, address)
    _check_together(levels, noise_kind, against, share, record, where)
    if record is None and out is not None:
        files.check_new_folder(out)
    settings = settings_of(policy, experiment)
    world, test = settings.test_world(), settings.evaluation
    usual = {"cells": 40, "worlds": 40} if against else {"cells": test.cells, "worlds": test.worlds}
    given = {"cells": cells, "worlds": worlds, "life": life, "share": share}
    sizes: dict[str, Any] = {**usual, "life": test.life, "seed": seed}
    sizes |= {name: value for name, value in given.items() if value is not None}
    kind = noise_kind or "concentration"
    if len(levels) > 1:
        with Progress("levels of noise", len(levels)) as bar:
            swept = noises.sweep_noise(policy, world, levels, kind=kind, progress=bar.show, **sizes)
        return _tell(swept.table, out, partial(save_noise_sweep, swept))
    if levels:
        (world,) = noises.check_levels(levels, kind, world)
    if against is not None:
        with Progress("contest", 1.0) as bar:
            raced = evaluation.compete(policy, against, world, progress=bar.show, **sizes)
        return _tell(contests.table(raced), out, partial(save_contest, raced))
    sizes["experiment"] = settings.experiment
    if record is not None:
        tested = recorded(policy, world, record, out, where, **sizes)
        return _tell(tested, out)
    with Progress("population test", 1.0) as bar:
        tested = evaluation.evaluate(policy, world, progress=bar.show, **sizes)
    return _tell(tested, out, partial(save_evaluation, tested))


def _check_together(
    levels: Sequence[float],
    kind: str | None,
    against: str | None,
    share: float | None,
    record: str | None,
    where: tuple[Any, ...],
) -> None:
    """Raises ValueError for options of `evaluate` that do not go together."""
    if kind is not None and not levels:
        raise ValueError(f"--noise-kind must come with --noise, got {kind!r} alone")
    if share is not None and against is None:
        raise ValueError(f"--share must come with --against, got {share:g} alone")
    if len(levels) > 1 and against is not None:
        raise ValueError(f"--noise must be one level with --against, got {len(levels)}")
    if record is not None and (against is not None or len(levels) > 1):
        raise ValueError(f"--record must come without --against and several levels of --noise, got {record}")
    if record is None and where != (None, None, None):
        raise ValueError("--launcher, --jobs and --address must come with --record, got them alone")


def _tell(found: Evaluation | Table, out: Path | None, save: Callable[[Path], None] | None = None) -> None:
    """Write what was found to a new folder, and print it."""
    if out is not None and save is not None:
        save(out)
    print_found(found)
    if out is not None:
        print(f"results and figures are in {out}")


def print_found(found: Evaluation | Table) -> None:
    """A table, and of a population test the limit."""
    from swarm._support.terminal import print_table
    from swarm.population.evaluation import Evaluation

    table = found.table if isinstance(found, Evaluation) else found
    print_table(table.headings, table.texts)
    if isinstance(found, Evaluation):
        limit = found.summary["limit"]
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
    from trainers.jobs import comparison

    formats = [each.strip() for each in (form or "png").split(",")]
    printed = form if out is None and form in comparison.TABLES else None
    if out is None and form is not None and printed is None:
        raise ValueError(f"--format must be md or tex without --out, got {form!r}")
    sizes: dict[str, Any] = {"cells": cells, "worlds": worlds, "life": life, "seed": seed}
    where = launcher, jobs, address
    groups = comparison.compare(folders, **sizes, out=out, formats=formats, where=where)
    if printed is not None:
        print(comparison.TABLES[printed](comparison.table(groups)), end="")
    else:
        print_found(comparison.table(groups))
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
