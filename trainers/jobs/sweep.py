"""Sweeps: `swarm train -m seed=0,1,2 …` runs every combination, several at a time on this machine.

A sweep is a folder of ordinary runs. Called again with the same `hydra.sweep.dir`, it skips what is finished
and goes on with what is not.
"""

import itertools
import json
import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from datetime import datetime
from functools import partial
from pathlib import Path

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from swarm._support import files
from swarm._support.checks import check_name
from trainers.jobs.cluster import JOBS, KEYS, LAUNCHER, Ray, launched, launcher_of
from trainers.jobs.executors import Task, run_tasks
from trainers.jobs.remote import needs_of, train_through
from trainers.settings.composition import (
    SettingsError,
    by_value,
    differing,
    key_of,
    readable,
    settings_from,
    settings_from_stored,
)
from trainers.settings.schema import Settings
from trainers.training.run import check_machine, train_in
from trainers.training.run_folder import RunError, RunFolder, is_run_folder, part_done

FOLDER, HYDRAS, HYDRAS_JOBS = "hydra.sweep.dir", "hydra/launcher", "hydra.launcher.n_jobs"  # Hydra's words
OWN = ("hydra", LAUNCHER)
MAX_NAME = 240  # [bytes] of a run's folder, whose temporary sibling has a name of at most 255


def sweep(words: Sequence[str]) -> None:
    """Check every combination of the words, then run them all.

    Raises SettingsError, RunError or OSError before anything is run, and RunError where a run fails.
    """
    for word in words:
        if word.startswith("resume="):
            rule = "resume goes on with one run, a sweep goes on with the same command"
            raise SettingsError(f"{rule} and the same {FOLDER}=DIR, got {word}")
    own = dict(word.partition("=")[::2] for word in words if word.startswith(OWN))
    launcher, workers, address = _launcher(own)
    runs = wanted(words)
    for settings in runs.values():
        check_machine(settings)
    folder = _sweep_folder(own.get(FOLDER), runs)
    quoted = shlex.quote(str(folder))
    again = f"the same command with {FOLDER}={quoted} goes on with them"
    with files.owned(folder) if launcher == "ray" else nullcontext():
        executor = launched(launcher, workers, address)
        print(f"{len(runs)} runs in {folder}")
        tasks, trainers = trainings({folder / name: each for name, each in runs.items()}, executor)
        try:
            outcomes = run_tasks(tasks, trainers, title="sweep")
        except KeyboardInterrupt as stopped:
            stopped.add_note(again)
            raise
    if left := sum(isinstance(outcome, BaseException) for outcome in outcomes):
        raise RunError(f"{left} of {len(runs)} runs did not finish; {again}")
    print(f"all {len(runs)} runs are in {folder}; swarm compare {quoted}/* shows them side by side")


def trainings(runs: Mapping[Path, Settings], executor: Executor) -> tuple[list[Task], Executor]:
    """Tasks that train these runs in their folders, and what does them: on a cluster only epochs are
    computed, this process keeps the folders.
    """
    trainers: list[Callable[..., None]] = [train_in] * len(runs)
    if isinstance(executor, Ray):
        trainers = [partial(train_through, executor.needing(needs_of(each))) for each in runs.values()]
        executor = ThreadPoolExecutor(max(len(runs), 1))  # each waits for its run's pieces
    tasks = [
        Task(path.name, train, (path, each), part_done=partial(part_done, path, each.learning.epochs))
        for train, (path, each) in zip(trainers, runs.items(), strict=True)
    ]
    return tasks, executor


def _launcher(own: dict[str, str]) -> tuple[str, int | None, str | None]:
    """Where a sweep runs, by its own words and by Hydra's: launcher, jobs, address."""
    for key in own:
        check_name("own key of a sweep", key, (FOLDER, HYDRAS, HYDRAS_JOBS, *KEYS))
    words = {"basic": "here", "joblib": "processes"}
    hydras = words[check_name(HYDRAS, own.get(HYDRAS, "joblib"), words)]
    given = {LAUNCHER: hydras} | ({JOBS: own[HYDRAS_JOBS]} if HYDRAS_JOBS in own else {}) | own
    launcher, jobs, address = launcher_of({key: given[key] for key in KEYS if key in given})
    return launcher, None if launcher == "here" else jobs, address


def wanted(words: Sequence[str]) -> dict[str, Settings]:
    """The settings of every combination of the words, by its name; raises SettingsError or RunError."""
    combinations = expanded([word for word in words if not word.startswith(OWN)])
    runs = [settings_from(combination) for combination in combinations]
    names = named(combinations)
    check_different(names, runs)
    return dict(zip(names, runs, strict=True))


def expanded(words: Sequence[str]) -> list[list[str]]:
    """Every combination of the values with commas."""
    for word in words:
        key_of(word)
    try:
        parsed = OverridesParser.create().parse_overrides(list(words))
        values = [
            [f"{each.get_key_element()}={value}" for value in each.sweep_string_iterator()]
            if each.is_sweep_override()
            else [word]
            for each, word in zip(parsed, words, strict=True)
        ]
    except HydraException as error:
        raise SettingsError(readable(error, words)) from None
    return [list(combination) for combination in itertools.product(*values)]


def named(combinations: Sequence[Sequence[str]]) -> list[str]:
    """The name of each combination, by what is not the same in all of them; raises RunError for no name."""
    fixed = set(combinations[0]).intersection(*combinations[1:]) if len(combinations) > 1 else set()
    names = [",".join(sorted(set(combination) - fixed)) for combination in combinations]
    names = [name.replace(os.sep, "_") for name in names]  # of paths of data
    for name in names:
        if names.count(name) > 1:
            raise RunError(f"combinations must differ, got the same one {names.count(name)} times")
        if len(os.fsencode(name)) > MAX_NAME:
            rule = f"a run's folder is named by what is swept in at most {MAX_NAME} bytes"
            raise RunError(f"{rule}, got {name}: sweep over fewer keys at once")
    return names


def check_different(names: Sequence[str], wanted: Sequence[Settings]) -> None:
    """Raises RunError where two combinations train the same settings with the same seed."""
    found: dict[tuple[str, int], str] = {}
    for name, settings in zip(names, wanted, strict=True):
        told = by_value(settings)
        key = json.dumps([told[each] for each in told if each not in ("seed", "n_seeds")], default=str)
        for seed in settings.seeds:
            if (other := found.setdefault((key, seed), name)) != name:
                raise RunError(f"combinations must differ, got seed {seed} of the same in {other} and {name}")


def _sweep_folder(given: str | None, runs: Mapping[str, Settings]) -> Path:
    """The folder of a sweep: the literal path that is given, or a new one of its own."""
    if not given:
        return files.reserved(f"runs/sweep-{datetime.now():%Y%m%d-%H%M%S}")
    folder = files.expanded(given)
    for name, settings in runs.items():
        _check_there(folder / name, settings)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _check_there(path: Path, settings: Settings) -> None:
    """Raises RunError where a run with other settings is there."""
    if not is_run_folder(path):
        return
    try:
        stored = settings_from_stored(RunFolder.open(path)[1], path)
        other = ", ".join(differing([settings.identity(), stored.identity()]))
    except (RunError, SettingsError) as error:
        other = f"version's settings ({error})"
    if other:
        raise RunError(f"{path} holds a run with another {other}: choose another {FOLDER}=DIR")
