"""Stacks of seeds: training them, their policies and how the gain grew; or those that are shipped."""

import itertools
import json
import shutil
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarm.policies import network
from swarm.policies.network import Network, load_policy
from swarm.policies.policy_file import PolicyError
from trainers.paper.delivery import do
from trainers.paper.measurements import Stack, TrainingGains
from trainers.paper.plan import Training, TrainingPlan, learnt
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


class Trained(NamedTuple):
    """What came of an experiment's trainings."""

    stack: Stack  # whose kind is to be named
    curve: TrainingCurve | None  # None where a shipped policy comes without
    gains: TrainingGains | None = None  # of every epoch; they are not shipped


# --- training -----------------------------------------------------------------------------------------------


def train(plan: TrainingPlan, planned: Sequence[Training]) -> None:
    """Train what is still to be trained; a run that is no longer of use is set aside."""
    found = {each.folder: each for each in reversed(planned)}  # of those that share a run, the first
    wanted = [each for each in found.values() if not is_done(each)]
    if len(wanted) < len(found):
        print(f"{len(found) - len(wanted)} of {len(found)} trainings are finished", flush=True)
    if wanted:
        from trainers.jobs.sweep import trainings  # it needs torch

        tasks, executor = trainings({each.folder: each.settings for each in wanted}, plan.executor())
        own = [
            task._replace(label=each.run, seconds=each.decisions, keep=partial(_tidy, each.folder))
            for task, each in zip(tasks, wanted, strict=True)
        ]
        do(executor, own, "trainings")


def _tidy(folder: Path, _: None) -> None:
    """The checkpoints of a finished run are no longer needed."""
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
    places = (folder.with_name(f"{folder.name}-set-aside-{count}") for count in itertools.count(1))
    aside = folder.rename(next(place for place in places if not place.exists()))
    print(f"{folder} is trained again: what was there ({reason}) is now {aside}", flush=True)
    return False


# --- what was trained ---------------------------------------------------------------------------------------


def policies_of(training: Training) -> list[Network]:
    """The kept policy of every seed."""
    run = RunFolder(training.folder)
    return [load_policy(path) for _, path in run.policies(training.settings)]


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
    lengths, epochs = [len(one) for one in by_seed], settings.learning.epochs
    if set(lengths) != {epochs}:
        raise RunError(f"{path} must have {epochs} rows for each seed, one per epoch, got {lengths}")
    return {name: np.array(values) for name, values in found.items()}


def trained(planned: Sequence[Training]) -> dict[Key, Trained]:
    """What came of every experiment, all of whose runs make one stack."""
    found = {}
    for key in dict.fromkeys((each.recipe, each.experiment) for each in planned):
        parts = [each for each in planned if (each.recipe, each.experiment) == key]
        seeds = tuple(seed for each in parts for seed in each.settings.seeds)
        policies = tuple(policy for each in parts for policy in policies_of(each))
        chosen = int(np.argmax([policy.card["validation"]["gain"] for policy in policies]))
        columns = [metrics(each) for each in parts]
        table = {name: np.concatenate([each[name] for each in columns]) for name in columns[0]}
        found[key] = Trained(
            Stack(key[0], "", key[1], seeds, policies, chosen),
            curve_of(table, parts[0].settings, seeds),
            TrainingGains(seeds, table["training_gain"]),
        )
    return found


def curve_of(table: Mapping[str, np.ndarray], settings: Settings, seeds: Sequence[int]) -> TrainingCurve:
    """The curve of an experiment with these metrics (seeds, epochs)."""
    from trainers.training.loop import Validation  # it needs torch, and shipped curves do not

    validated = np.flatnonzero(np.isfinite(table["gain"][0]))
    gain = table["gain"][:, validated]
    limits = gain[:, -1] / table["fraction_of_limit"][:, validated[-1]]
    epochs = table["training_gain"].shape[1]
    blocks = np.array_split(np.arange(epochs), min(BLOCKS, epochs))
    exploring = np.stack([table["training_gain"][:, block].mean(axis=1) for block in blocks], axis=1)
    world, checked = settings.training_world(), settings.validation
    validation = Validation(
        world.replace(life=checked.life), checked.cells, list(seeds), worlds=checked.worlds
    )
    return TrainingCurve(
        epoch=(validated + 1).tolist(),
        gain=gain.round(4).tolist(),
        greedy=float(validation.greedy.mean()),
        limit=float(limits.mean()) if np.isfinite(limits).all() else None,
        training_epoch=[float(block.mean()) + 1 for block in blocks],
        training_gain=exploring.round(4).tolist(),
    )


def shipped(plan: TrainingPlan) -> dict[Key, Trained]:
    """The shipped policies, as stacks of one seed, and their curves."""
    found = {}
    for name in network.zoo_names():
        if name in plan.experiments:
            policy = load_policy(network.ZOO + name)
            recipe, seed = str(policy.card["recipe"]), int(policy.card["seed"])
            file = resources.files("swarm") / "zoo" / f"{name}.json"
            stored = json.loads(file.read_text(encoding="utf-8")).get("training") if file.is_file() else None
            curve = TrainingCurve(**stored) if stored else None
            found[recipe, name] = Trained(Stack(recipe, "", name, (seed,), (policy,), 0), curve)
    return found
