"""`swarm train` and `study`: begin, go on, sweep, do all that a file asks for."""

from __future__ import annotations

import sys
import textwrap
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trainers.cli import options
from trainers.cli.app import app
from trainers.cli.listing import Listing
from trainers.cli.populations import print_found

if TYPE_CHECKING:
    from trainers.jobs.cluster import Where
    from trainers.settings.schema import Settings
    from trainers.training.loop import Training
    from trainers.training.run_folder import RunFolder

HERE = (None, None, None)
LAUNCHER = "launcher"
SEVERAL, SHOW, RESUME, FOLDER = ("-m", "--multirun"), "--show", "resume=", "hydra.run.dir="


@app.command(
    cls=Listing,
    options_metavar="[KEY=VALUE ...] [-m] [--show]",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    help="""Train a policy: `swarm train experiment=linear_n4 recipe=swarm seed=0 key=value …`

    `experiment=` says what to learn (default linear_n4): {experiments}.

    `recipe=` says how (default swarm): {recipes}.

    `algorithm=` says by what (default dqn): {algorithms}.

    `--show` prints all settings and their values, or those of every run of a sweep, and ends.

    `-m` sweeps over values with commas (`seed=0,1,2`), `hydra.run.dir=DIR`
    chooses the folder, `resume=DIR` goes on with a run.

    `launcher=processes` or `ray` (`launcher.jobs=N`, `launcher.address=HOST:PORT`)
    collects decisions there, by blocks of `learning.block=N` cells.""",
)
def train(context: typer.Context) -> None:
    """Train a policy."""
    from swarm._support.terminal import Told
    from trainers.settings.composition import settings_from

    given = context.args
    words = [word for word in given if word not in (SHOW, *SEVERAL)]
    several = not set(SEVERAL).isdisjoint(given)
    if SHOW in given and several:
        _show_sweep(words)
    elif SHOW in given:
        shown = settings_from([word for word in words if not word.startswith((FOLDER, LAUNCHER))])
        print(shown.as_yaml().rstrip())
    else:
        with redirect_stdout(Told(sys.stdout)):
            _train(words, several)


def _show_sweep(words: Sequence[str]) -> None:
    """What differs between the runs of a sweep, and what does not."""
    from trainers.jobs.sweep import wanted
    from trainers.settings.composition import differing

    runs = {name: settings.dotted() for name, settings in wanted(words).items()}
    other, first = differing(list(runs.values())), next(iter(runs.values()))
    print(f"{len(runs)} runs")
    for name, each in runs.items():
        print(name, _indented({key: each[key] for key in each if key in other}), sep="\n")
    same = {key: value for key, value in first.items() if key not in other}
    print("in all of them", _indented(same), sep="\n")


def _indented(settings: dict[str, Any]) -> str:
    import yaml

    return textwrap.indent(yaml.safe_dump(settings, sort_keys=False, default_flow_style=None).rstrip(), "  ")


def _train(words: Sequence[str], several: bool) -> None:
    from trainers.jobs.cluster import launcher_of
    from trainers.settings.composition import settings_from

    if several:
        from trainers.jobs.sweep import sweep

        return sweep(words)
    own = dict(word.partition("=")[::2] for word in words if word.startswith(LAUNCHER))
    words, where = [word for word in words if not word.startswith(LAUNCHER)], launcher_of(own)
    resumed = [word.removeprefix(RESUME) for word in words if word.startswith(RESUME)]
    folders = [word.removeprefix(FOLDER) for word in words if word.startswith(FOLDER)]
    plain = [word for word in words if not word.startswith((RESUME, FOLDER))]
    if resumed:
        if plain or folders or len(resumed) > 1:
            rule = "resume goes on with the settings stored in the run, nothing else may be given, got"
            raise ValueError(f"{rule} {' '.join(words)}")
        return resume(Path(resumed[0]), where)
    return begin(settings_from(plain), Path(folders[-1]) if folders else None, where)


def begin(settings: Settings, folder: Path | None = None, where: Where = HERE) -> None:
    """Train in a new folder; decisions are collected by a launcher, so many jobs, at an address."""
    from trainers.jobs.remote import collectors
    from trainers.training import run as running

    with collectors(settings, *where) as submit:
        training, run = running.begin(folder, settings, submit)
        first, *others = settings.seeds
        seeds = f"seeds {first} to {others[-1]}" if others else f"seed {first}"
        told = f"{settings.experiment} by {settings.algorithm}, recipe {settings.recipe}, {seeds}"
        print(f"training {told}: settings and all else in {run.path}", flush=True)
        _complete(training, run)


def resume(folder: Path, where: Where = HERE) -> None:
    """Go on with a run; decisions are collected as in `begin`, wherever they were before."""
    from trainers.jobs.remote import collectors
    from trainers.settings.composition import settings_from_stored
    from trainers.training import run as running
    from trainers.training.run_folder import RunFolder

    run, stored = RunFolder.open(folder)
    settings = settings_from_stored(stored, run.path)
    if run.finished:
        print(f"{folder} is finished after {settings.learning.epochs} epochs; nothing is left to learn")
        tested = running.test(settings, run)
        if tested is not None:
            print_found(tested)
    else:
        with collectors(settings, *where) as submit:
            _complete(*running.resume(folder, submit))


def _complete(training: Training, run: RunFolder) -> None:
    """Train to the end, and test the kept policy where that is wanted."""
    from swarm._support.terminal import Progress
    from trainers.training import run as running

    epochs, started = training.settings.learning.epochs, time.perf_counter()
    with Progress("training", epochs) as bar:

        def report(training: Training, seconds: float) -> None:
            text = f"epoch {training.epoch}/{epochs}  {running.standing(training)}{seconds:.2f} s/epoch"
            bar.show(training.epoch, text=text)
            if training.epoch == epochs:
                bar.say(text)

        tested = running.complete(training, run, report=report)
    print(f"trained in {time.perf_counter() - started:.1f} s; policy, metrics and figure are in {run.path}")
    if tested is not None:
        print_found(tested)


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
    launcher: options.Launchers = None,
    jobs: options.Jobs = None,
    address: options.Address = None,
) -> None:
    """Train and test a grid of settings, seeds and tests; what is there is not done again."""
    from swarm._support import files
    from swarm._support.terminal import Told
    from trainers.jobs import study as studies

    if figure and files.expanded(source).is_dir():
        if (out, launcher, jobs, address) != (None, None, None, None):
            raise ValueError(f"--figure of a folder must come without --out and --launcher, got {source}")
        for path in studies.draw(source, figure):
            print(f"written to {path}")
        return
    with redirect_stdout(Told(sys.stdout)):  # what is told on the way
        where = launcher or "processes", jobs, address
        found = studies.study(source, out, figures=figure or (), where=where)
    print_found(found.table)
    print(f"dataset, table and figures are in {found.folder}")
