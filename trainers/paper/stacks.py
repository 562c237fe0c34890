"""Stacks of seeds: training them, their policies and how the gain grew; or those that are shipped."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarm.policies import network
from swarm.policies.network import Network, load_policy
from swarm.policies.policy_file import PolicyError
from swarm.population.contest import population_test
from swarm.population.results import RIVAL
from trainers.jobs.executors import Task
from trainers.paper.measurements import Stack, TrainingGains
from trainers.paper.plan import Plan, Training, learnt
from trainers.settings.composition import SettingsError, settings_from_stored
from trainers.settings.schema import Settings
from trainers.training import run_folder as runs
from trainers.training.run_folder import RunError, RunFolder

BLOCKS = 100  # most points of a curve of training cells
Key = tuple[str, str]  # recipe and experiment


class TrainingCurve(NamedTuple):
    """Gains during training: of the validation cells, which do not explore, and of the training cells."""

    epoch: list[int]  # (validations,)
    gain: list[list[float]]  # (seeds, validations)
    greedy: float | None  # the same validation cells under greedy
    limit: float | None
    training_epoch: list[float]  # (blocks,) middle of the epochs that are averaged
    training_gain: list[list[float]]  # (seeds, blocks)


Curves = Mapping[Key, TrainingCurve]


# --- training -----------------------------------------------------------------------------------------------


def tasks(planned: Iterable[Training]) -> list[Task]:
    """What is still to be trained; a run that is no longer of use is set aside."""
    folders: dict[Path, Training] = {}
    for each in planned:
        folders.setdefault(each.folder, each)
    wanted = [each for each in folders.values() if not is_done(each)]
    if len(wanted) < len(folders):
        print(f"{len(folders) - len(wanted)} of {len(folders)} trainings are finished", flush=True)
    return [
        Task(each.run, train_one, (each.settings, each.folder), each.decisions, partial(part_done, each))
        for each in wanted
    ]


def train_one(settings: Settings, folder: Path) -> None:
    """One run, from its newest checkpoint if it was begun; then its checkpoints are no longer needed."""
    from trainers.training import run as running

    running.train_in(folder, settings)
    shutil.rmtree(folder / runs.CHECKPOINTS, ignore_errors=True)


def is_done(training: Training) -> bool:
    """Whether the run is finished and valid; one with other settings or damaged files is set aside."""
    folder = training.folder
    if not runs.is_run_folder(folder):
        return False
    try:
        run, stored = RunFolder.open(folder)
        if learnt(settings_from_stored(stored), seeds=True) == learnt(training.settings, seeds=True):
            if run.finished:
                policies_of(training)
                metrics(training)
            return run.finished
        reason = "has other settings"
    except (RunError, SettingsError, PolicyError) as error:
        reason = str(error)
    count = 1
    while (aside := folder.with_name(f"{folder.name}-set-aside-{count}")).exists():
        count += 1
    folder.rename(aside)
    print(f"{folder} is trained again: what was there ({reason}) is now {aside}", flush=True)
    return False


def part_done(training: Training) -> float:
    """The part of a run's epochs that are over, read off its timings."""
    return len(RunFolder(training.folder).rows(runs.TIMINGS)) / training.settings.learning.epochs


# --- what was trained ---------------------------------------------------------------------------------------


def policies_of(training: Training) -> list[Network]:
    """The kept policy of every seed."""
    run, settings = RunFolder(training.folder), training.settings
    if settings.n_seeds == 1:
        return [load_policy(run.policy)]
    return [load_policy(run.seed_folder(seed) / runs.POLICY) for seed in settings.seeds]


def metrics(training: Training) -> dict[str, np.ndarray]:
    """Columns (seeds, epochs) of a finished run's metrics; NaN where a column has no number.

    Raises RunError unless there is a row of numbers for every seed and epoch.
    """
    run, settings = RunFolder(training.folder), training.settings
    rows, path = run.rows(runs.METRICS), run.path / runs.METRICS
    try:
        by_seed = [[row for row in rows if int(row["seed"]) == seed] for seed in settings.seeds]
        found = {
            name: [[float(row[name] or "nan") for row in one] for one in by_seed]
            for name in ("gain", "fraction_of_limit", "training_gain")
        }
    except (KeyError, ValueError) as error:
        raise RunError(f"{path} must hold numbers in the columns of a run's metrics, got {error}") from None
    lengths = [len(one) for one in by_seed]
    if set(lengths) != {settings.learning.epochs}:
        raise RunError(
            f"{path} must have {settings.learning.epochs} rows for each seed, one per epoch, got {lengths}"
        )
    return {name: np.array(values) for name, values in found.items()}


def by_experiment(planned: Iterable[Training]) -> dict[Key, list[Training]]:
    """The runs of each experiment, whose seeds make one stack."""
    found: dict[Key, list[Training]] = {}
    for each in planned:
        found.setdefault((each.recipe, each.experiment), []).append(each)
    return found


def seeds_of(parts: Sequence[Training]) -> tuple[int, ...]:
    """Training seeds of an experiment's runs."""
    return tuple(seed for each in parts for seed in each.settings.seeds)


def trained_stacks(planned: Iterable[Training]) -> dict[Key, Stack]:
    """Policies of every experiment; the kind is to be named."""
    stacks = {}
    for (recipe, experiment), parts in by_experiment(planned).items():
        policies = tuple(policy for each in parts for policy in policies_of(each))
        chosen = int(np.argmax([policy.card["validation"]["gain"] for policy in policies]))
        stacks[recipe, experiment] = Stack(recipe, "", experiment, seeds_of(parts), policies, chosen)
    return stacks


def table_of(parts: Iterable[Training]) -> dict[str, np.ndarray]:
    """Metrics (seeds, epochs) of an experiment's runs."""
    tables = [metrics(each) for each in parts]
    return {name: np.concatenate([each[name] for each in tables]) for name in tables[0]}


def training_gains(planned: Iterable[Training]) -> dict[Key, TrainingGains]:
    """Gains of the training cells in every epoch."""
    return {
        key: TrainingGains(seeds_of(parts), table_of(parts)["training_gain"])
        for key, parts in by_experiment(planned).items()
    }


def trained_curves(planned: Iterable[Training]) -> dict[Key, TrainingCurve]:
    """Curves of every experiment."""
    return {key: curve_of(parts) for key, parts in by_experiment(planned).items()}


def curve_of(parts: Sequence[Training]) -> TrainingCurve:
    """The curve of one experiment's runs."""
    table = table_of(parts)
    validated = np.flatnonzero(np.isfinite(table["gain"][0]))
    gain = table["gain"][:, validated]
    limits = gain[:, -1] / table["fraction_of_limit"][:, validated[-1]]
    epochs = table["training_gain"].shape[1]
    blocks = np.array_split(np.arange(epochs), min(BLOCKS, epochs))
    exploring = np.stack([table["training_gain"][:, block].mean(axis=1) for block in blocks], axis=1)
    return TrainingCurve(
        epoch=(validated + 1).tolist(),
        gain=gain.round(4).tolist(),
        greedy=_greedy(parts[0].settings, seeds_of(parts)),
        limit=float(limits.mean()) if np.isfinite(limits).all() else None,
        training_epoch=[float(block.mean()) + 1 for block in blocks],
        training_gain=exploring.round(4).tolist(),
    )


def _greedy(settings: Settings, seeds: Sequence[int]) -> float:
    """Mean gain of greedy on the validation cells of all seeds."""
    world, checked = settings.training_world(), settings.validation
    options: dict[str, Any] = {
        "cells": checked.cells,
        "life": checked.life,
        "record": False,
        "limit": False,
        "population": "validation",
    }
    tests = (population_test(world, {}, seed=seed, **options) for seed in seeds)
    return float(np.mean([test["gain"].sel(policy=RIVAL).mean() for test in tests]))


# --- what is shipped ----------------------------------------------------------------------------------------


def shipped_stacks(plan: Plan) -> dict[Key, Stack]:
    """The shipped policies, as stacks of one seed."""
    stacks = {}
    for name in network.zoo_names():
        if name in plan.experiments:
            policy = load_policy(network.ZOO + name)
            recipe, seed = str(policy.card["recipe"]), int(policy.card["seed"])
            stacks[recipe, name] = Stack(recipe, "", name, (seed,), (policy,), 0)
    return stacks


def shipped_curves(stacks: Iterable[Key]) -> dict[Key, TrainingCurve]:
    """Curves that are shipped with policies, where they are."""
    found = {}
    for recipe, experiment in stacks:
        file = resources.files("swarm") / "zoo" / f"{experiment}.json"
        if file.is_file() and (stored := json.loads(file.read_text(encoding="utf-8")).get("training")):
            found[recipe, experiment] = TrainingCurve(**stored)
    return found
