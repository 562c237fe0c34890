"""What `swarm train` does: check everything, then run; bad input ends in one line, not in a traceback."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trainers.cli import fail, file_trouble
from trainers.settings.composition import SettingsError, settings_from, settings_from_stored
from trainers.settings.schema import Settings
from trainers.training.machine import prepare

RUN_FOLDER = "hydra.run.dir="


def train_from(words: Sequence[str]) -> None:
    """`swarm train`."""
    words = list(words)
    if "-m" in words or "--multirun" in words:
        from trainers.jobs.sweep import sweep

        return sweep([word for word in words if word not in ("-m", "--multirun")])
    show = "--show" in words
    words = [word for word in words if word != "--show"]
    resumed = [word.removeprefix("resume=") for word in words if word.startswith("resume=")]
    folders = [word.removeprefix(RUN_FOLDER) for word in words if word.startswith(RUN_FOLDER)]
    plain = [word for word in words if not word.startswith(("resume=", RUN_FOLDER))]
    if resumed:
        if plain or folders or len(resumed) > 1:
            fail(
                "resume goes on with the settings stored in the run, nothing else may be given, got "
                + " ".join(words)
            )
        return resume(Path(resumed[0]))
    try:
        settings = settings_from(plain)
    except SettingsError as error:
        fail(error)
    if show:
        print(described(settings))
        return None
    return begin(settings, Path(folders[-1]) if folders else None)


def begin(settings: Settings, folder: Path | None) -> None:
    """Train in a new folder."""
    from swarm._support import files
    from trainers.training import run_folder as runs

    folder = folder or runs.default_folder(settings)
    try:
        files.check_new_folder(folder)
        print(described(settings))
        prepared = prepare(settings)
        run = runs.RunFolder.create(folder, settings)
    except SettingsError as error:
        fail(error)
    except OSError as error:
        fail(file_trouble(error))
    carry_on(prepared, run)


def resume(path: Path) -> None:
    """Go on with a run."""
    from swarm._support import provenance
    from trainers.training import run_folder as runs

    try:
        run, stored = runs.RunFolder.open(path)
        settings = settings_from_stored(stored)
        if run.finished:
            print(f"{path} is finished after {settings.learning.epochs} epochs; nothing is left to learn")
            return test_after(settings, run)
        prepared = prepare(settings)
    except (runs.RunError, SettingsError) as error:
        fail(error)
    except OSError as error:
        fail(file_trouble(error))
    then, now = run.record.get("versions"), provenance.versions()
    if isinstance(then, dict) and (changed := [name for name in now if then.get(name) != now[name]]):
        print(
            f"{', '.join(changed)} changed since the run began: it goes on, but not bit for bit",
            file=sys.stderr,
        )
    carry_on(prepared, run)


def carry_on(prepared: Any, run: Any) -> None:
    """Train to the end, draw the training figure, and test the kept policy where that is wanted."""
    from trainers.training import run as running
    from trainers.training import run_folder as runs

    settings = prepared.settings
    how = f"to go on: swarm train resume={run.path}"
    started = time.perf_counter()
    try:
        running.complete(prepared, run, report=progress_line(settings))
    except runs.RunError as error:
        fail(error)
    except OSError as error:
        fail(f"{file_trouble(error)}; what was saved before is kept; {how}")
    except MemoryError:
        fail(f"there was not enough memory; what was saved before is kept; {how}")
    except KeyboardInterrupt:
        fail(f"stopped at once; what was saved before is kept; {how}")
    print(f"trained in {time.perf_counter() - started:.1f} s; policy, metrics and figure are in {run.path}")
    test_after(settings, run)


def test_after(settings: Settings, run: Any) -> None:
    """Test the kept policy where that is wanted and was not done."""
    from trainers.commands import evaluate_from

    folder, test = run.path / "evaluation", settings.evaluation
    if settings.evaluate and not folder.exists():
        evaluate_from(str(run.path), cells=test.cells, life=test.life, seed=test.seed, out=folder)


def described(settings: Settings) -> str:
    """The resolved settings as YAML."""
    import yaml

    return yaml.safe_dump(dataclasses.asdict(settings), sort_keys=False).rstrip()


def progress_line(settings: Settings) -> Any:
    """A reporter of each epoch: one line that is overwritten on a terminal, else a line per validation."""
    live = sys.stderr.isatty()

    def report(training: Any, seconds: float) -> None:
        import numpy as np

        gain, fraction = (training.measure(name)[-1].mean() for name in ("gain", "fraction_of_limit"))
        text = f"epoch {training.epoch}/{settings.learning.epochs}"
        if not np.isnan(gain):
            text += f"  gain {gain:.2f}"
            if not np.isnan(fraction):
                text += f" = {100 * fraction:.1f}% of the limit"
        if np.isfinite(training.best_gain).all():  # before the first validation there is none
            text += f"  best {training.best_gain.mean():.2f}"
        text += f"  {seconds:.2f} s/epoch"
        last = training.epoch == settings.learning.epochs
        if live:
            print(f"\r\033[K{text}", end="\n" if last else "", file=sys.stderr, flush=True)
        elif last or training.epoch % (10 * settings.validation.every) == 0:
            print(text, file=sys.stderr, flush=True)

    return report
