"""The command `swarm`: train, evaluate, and what else is done from a shell. Heavy imports wait until they are
needed.
"""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path
from typing import Annotated, NoReturn

import typer

app = typer.Typer(
    name="swarm",
    help="Learning to steer chemotactic microswimmers in crowds.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def fail(error: BaseException | str) -> NoReturn:
    """End with a message and exit code 2 where the user can do something about it."""
    print(f"swarm: {error}", file=sys.stderr)
    raise typer.Exit(2)


def file_trouble(error: OSError) -> str:
    """What went wrong with which file."""
    return f"{error.strerror}: {error.filename}" if error.strerror and error.filename else str(error)


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    help="""Train a policy: `swarm train experiment=linear_n4 recipe=swarm seed=0 key=value …`

    `hydra.run.dir=DIR` chooses the folder, `resume=DIR` goes on with a run, `-m` sweeps over values with
    commas (`seed=0,1,2`), `--show` prints the settings and ends.""",
)
def train(context: typer.Context) -> None:
    """Train a policy."""
    from trainers.jobs import launch as launching

    launching.train_from(context.args)


@app.command()
def evaluate(
    policy: Annotated[
        str,
        typer.Argument(help="A run folder, a policy file, zoo:NAME, greedy, swinging, random or optimal."),
    ],
    experiment: Annotated[
        str | None, typer.Option(help="World of the test; default: the policy's own.")
    ] = None,
    cells: Annotated[int | None, typer.Option(help="Test cells.")] = None,
    life: Annotated[float | None, typer.Option(help="Length of a life, t_life.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the test population.")] = 0,
    noise: Annotated[
        list[str] | None,
        typer.Option(
            help="Strength of a perturbation; several (0,0.1,0.2) draw gain against noise.",
            metavar="LEVEL,...",
        ),
    ] = None,
    noise_kind: Annotated[
        str | None,
        typer.Option(help="What --noise perturbs: concentration (default), curvature or rotation."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="New folder for results and figures.")] = None,
) -> None:
    """Test a policy on fresh cells, next to greedy, swinging and the physical limit."""
    from trainers import commands

    commands.evaluate_from(
        policy,
        experiment=experiment,
        cells=cells,
        life=life,
        seed=seed,
        noise=noise or (),
        kind=noise_kind,
        out=out,
    )


@app.command()
def compare(
    folders: Annotated[list[Path], typer.Argument(help="Folders of finished runs.", metavar="RUN RUN ...")],
    cells: Annotated[int, typer.Option(help="Test cells.")] = 40,
    seed: Annotated[int, typer.Option(help="Seed of the test population.")] = 0,
    out: Annotated[Path | None, typer.Option(help="New folder for the table and the figure.")] = None,
) -> None:
    """Put runs side by side, with intervals over seeds."""
    from trainers import commands

    commands.compare_from(folders, cells, seed, out)


@app.command()
def watch(
    policy: Annotated[
        str,
        typer.Argument(
            help="A run folder, a policy file, zoo:NAME, greedy, swinging, random or optimal; "
            "or a population.nc, for a page."
        ),
    ],
    experiment: Annotated[
        str | None, typer.Option(help="World to watch it in; default: the policy's own.")
    ] = None,
    cells: Annotated[int | None, typer.Option(help="How many cells; default: 40.")] = None,
    life: Annotated[float | None, typer.Option(help="Length of a life, t_life; default: 80.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the starts; default: 0.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="A film (.mp4, .gif) or a page (.html); without: a window."),
    ] = None,
    size: Annotated[
        int | None, typer.Option(help="Height of a film in pixels; default: 720, of a .gif 360.")
    ] = None,
) -> None:
    """Watch a policy steer a swarm."""
    from trainers import commands

    commands.watch_from(policy, experiment=experiment, cells=cells, life=life, seed=seed, out=out, size=size)


@app.command()
def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the report; what is finished there is not redone.")],
    quick: Annotated[bool, typer.Option(help="Test the shipped policies instead of training.")] = False,
    seeds: Annotated[int, typer.Option(help="Training seeds of every experiment.")] = 5,
    jobs: Annotated[int | None, typer.Option(help="Processes at once; default: 2, or 1 on one core.")] = None,
    publish: Annotated[
        Path | None, typer.Option(help="Folder for a copy of the report, without the training runs.")
    ] = None,
) -> None:
    """Reproduce every figure and table of the paper, with a verdict on each of its claims."""
    from trainers import commands

    commands.reproduce_from(out, quick, seeds, jobs, publish)


@app.command()
def check() -> None:
    """Run every check of the environments' interfaces there is, warnings as errors."""
    from trainers import commands

    commands.check_from()


def main() -> None:
    """Run the command line."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # a name that the terminal's encoding lacks is no bug
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        os.getcwd()
    except FileNotFoundError:
        print("swarm: the current folder must be there, but was removed: change to another", file=sys.stderr)
        raise SystemExit(2) from None
    app()
