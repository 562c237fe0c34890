"""Sweeps: `swarm train -m seed=0,1,2 …` runs every combination, by Hydra's joblib launcher on this machine.

A sweep is a folder of ordinary runs. Called again with the same `hydra.sweep.dir`, it skips what is finished
and goes on with what is not.
"""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import hydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from trainers.cli import fail, file_trouble
from trainers.settings.composition import (
    SettingsError,
    as_settings,
    config_folder,
    readable,
    register,
    settings_from,
    settings_from_stored,
)
from trainers.settings.schema import Settings
from trainers.training.machine import check_machine

SWEEP_FOLDER = "hydra.sweep.dir="
LAUNCHER = "hydra/launcher="
JOBS = "hydra.launcher.n_jobs="
MAX_NAME = 240  # of a run's folder, whose temporary sibling has a name of at most 255 bytes


def sweep(words: Sequence[str]) -> None:
    """Check every combination, then run them all; ends with exit code 1 where one of them failed."""
    words = list(words)
    if resumed := [word for word in words if word.startswith("resume=")]:
        fail(
            "resume goes on with one run, a sweep goes on with the same command and the same "
            f"{SWEEP_FOLDER}DIR, got {resumed[0]}"
        )
    plain = [word for word in words if not word.startswith(("hydra.", "hydra/"))]
    try:
        combinations = expanded(plain)
        wanted = [settings_from(combination) for combination in combinations]
        for settings in wanted:
            check_machine(settings)
    except SettingsError as error:
        fail(error)
    folder = next((word.removeprefix(SWEEP_FOLDER) for word in words if word.startswith(SWEEP_FOLDER)), None)
    if folder is None:
        folder = f"runs/sweep-{datetime.now():%Y%m%d-%H%M%S}"
        words.append(SWEEP_FOLDER + folder)
    if not any(word.startswith(LAUNCHER) for word in words):
        words.append(LAUNCHER + "joblib")
        if not any(word.startswith(JOBS) for word in words):
            words.append(JOBS + "2")
    # the folder of a run holds only what the run writes; its name says what is swept
    words += ["hydra.output_subdir=null", "hydra.sweep.subdir=${hydra.job.override_dirname}"]
    fixed, names = named(combinations)
    parent = Path(folder)
    _make_folder(parent, names, wanted)
    words.append(f"hydra.job.config.override_dirname.exclude_keys=[{','.join(fixed)}]")
    words += ["hydra/job_logging=disabled", "hydra/hydra_logging=disabled"]
    print(f"{len(combinations)} runs in {folder}")
    trouble = _launch(words)
    done = sum(finished(parent / name) for name in names)
    if done < len(combinations):
        fail(
            f"{len(combinations) - done} of {len(combinations)} runs did not finish{trouble}; "
            f"the same command with {SWEEP_FOLDER}{folder} goes on with them"
        )
    print(f"all {len(combinations)} runs are in {folder}; swarm compare {folder}/* shows them side by side")


def _make_folder(parent: Path, names: Sequence[str], wanted: Sequence[Settings]) -> None:
    """Make the sweep's folder; ends where runs cannot be made there, each in a folder of its own."""
    for name in names:
        if names.count(name) > 1:
            fail(f"combinations must differ, got the same one {names.count(name)} times")
        if len(os.fsencode(name)) > MAX_NAME:
            fail(
                f"a run's folder is named by what is swept in at most {MAX_NAME} bytes, got {name}: "
                "sweep over fewer keys at once"
            )
    try:
        for name, settings in zip(names, wanted, strict=True):
            if other := differing(parent / name, settings):
                fail(f"{parent / name} holds a run with another {other}: choose another {SWEEP_FOLDER}DIR")
        parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(file_trouble(error))


def named(combinations: Sequence[Sequence[str]]) -> tuple[list[str], list[str]]:
    """Keys that are the same in all combinations, and the folder's name of each, by what is not."""
    values = [dict(word.split("=", 1) for word in combination) for combination in combinations]
    fixed = [key for key in values[0] if len({each[key] for each in values}) == 1 < len(values)]
    # as Hydra writes them
    names = [
        ",".join(sorted(word for word in combination if word.split("=", 1)[0] not in fixed))
        for combination in combinations
    ]
    return fixed, names


def differing(path: Path, settings: Settings) -> str | None:
    """The settings in which a run that is there differs from these; None where it does not."""
    from trainers.training import run_folder as runs

    if not runs.is_run_folder(path):
        return None
    try:
        stored = settings_from_stored(runs.RunFolder.open(path)[1])
    except (runs.RunError, SettingsError, OSError) as error:
        return f"version's settings ({error})"
    keys = [item.name for item in dataclasses.fields(settings)]
    return ", ".join(key for key in keys if getattr(stored, key) != getattr(settings, key)) or None


def finished(path: Path) -> bool:
    """Whether `path` is the folder of a finished run."""
    from trainers.training import run_folder as runs

    return runs.is_run_folder(path) and runs.RunFolder(path).finished


def expanded(words: Sequence[str]) -> list[list[str]]:
    """Every combination of the values with commas."""
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper

    for word in words:
        if "=" not in word:
            raise SettingsError(f"a setting must be written key=value, got {word!r}")
    try:
        parsed = OverridesParser.create().parse_overrides(list(words))
        batches = BasicSweeper.split_arguments(parsed, max_batch_size=None)
    except HydraException as error:
        raise SettingsError(readable(error)) from None
    return [list(combination) for batch in batches for combination in batch]


def _launch(words: list[str]) -> str:
    """Hand the sweep to Hydra; returns what became of the launcher itself, where that is worth saying."""
    register()
    command = hydra.main(version_base="1.3", config_path=str(config_folder()), config_name="config")(run_one)
    before = sys.argv
    sys.argv = ["swarm", "--multirun", *words]
    try:
        command()
    except (
        Exception,
        SystemExit,
        KeyboardInterrupt,
    ) as error:  # a worker that is killed takes the whole launcher with it
        return f" ({type(error).__name__})"
    finally:
        sys.argv = before
    return ""


def run_one(config: Any) -> None:
    """One run of a sweep, in the folder Hydra has chosen; what goes wrong is said and does not stop the
    others.
    """
    from hydra.core.hydra_config import HydraConfig

    from trainers.training import run as running
    from trainers.training import run_folder as runs

    folder = Path(HydraConfig.get().runtime.output_dir)
    try:
        running.train_in(folder, as_settings(config))
    except running.Interrupted:  # of the sweep, not only of this run
        raise KeyboardInterrupt from None
    except (SettingsError, runs.RunError, OSError) as error:
        print(f"swarm: {folder.name}: {error}", file=sys.stderr)
