"""`swarm train`: begin, go on, sweep."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from trainers.cli.app import app
from trainers.cli.told import print_test

if TYPE_CHECKING:
    from trainers.settings.schema import Settings
    from trainers.training.loop import Training
    from trainers.training.run_folder import RunFolder

SEVERAL, SHOW, RESUME, FOLDER = ("-m", "--multirun"), "--show", "resume=", "hydra.run.dir="


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    help="""Train a policy: `swarm train experiment=linear_n4 recipe=swarm seed=0 key=value …`

    `algorithm=ppo` learns by PPO instead of DQN, `hydra.run.dir=DIR` chooses the folder, `resume=DIR` goes on
    with a run, `-m` sweeps over values with commas (`seed=0,1,2`), `--show` prints the settings and ends.""",
)
def train(context: typer.Context) -> None:
    """Train a policy."""
    from swarm._support.terminal import Told
    from trainers.settings.composition import settings_from

    words, others = context.args, (*SEVERAL, RESUME)
    if SHOW in words and not any(word.startswith(others) for word in words):
        shown = settings_from([word for word in words if word != SHOW and not word.startswith(FOLDER)])
        print(shown.as_yaml().rstrip())
    else:
        with redirect_stdout(Told(sys.stdout)):
            _train(words)


def _train(given: Sequence[str]) -> None:
    from trainers.jobs.sweep import sweep
    from trainers.settings.composition import settings_from

    words = [word for word in given if word not in SEVERAL]
    if len(words) < len(given):
        return sweep(words)
    resumed = [word.removeprefix(RESUME) for word in words if word.startswith(RESUME)]
    folders = [word.removeprefix(FOLDER) for word in words if word.startswith(FOLDER)]
    plain = [word for word in words if not word.startswith((RESUME, FOLDER))]
    if resumed:
        if plain or folders or len(resumed) > 1:
            rule = "resume goes on with the settings stored in the run, nothing else may be given, got"
            raise ValueError(f"{rule} {' '.join(words)}")
        return resume(Path(resumed[0]))
    return begin(settings_from(plain), Path(folders[-1]) if folders else None)


def begin(settings: Settings, folder: Path | None = None) -> None:
    """Train in a new folder."""
    from trainers.training import run as running

    training, run = running.begin(folder, settings)
    print(settings.as_yaml().rstrip(), flush=True)
    _complete(training, run)


def resume(folder: Path) -> None:
    """Go on with a run."""
    from trainers.settings.composition import settings_from_stored
    from trainers.training import run as running
    from trainers.training.run_folder import RunFolder

    run, stored = RunFolder.open(folder)
    settings = settings_from_stored(stored, run.path)
    if run.finished:
        print(f"{folder} is finished after {settings.learning.epochs} epochs; nothing is left to learn")
        print_test(running.test(settings, run))
    else:
        _complete(*running.resume(folder))


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
    print_test(tested)
