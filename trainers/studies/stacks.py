"""Stacks of seeds: their policies and how the gain grew, as they were trained or are shipped."""

import itertools
import json
import shutil
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarm.policies import network
from swarm.policies.network import Network, load_policy
from swarm.policies.policy_file import PolicyError
from trainers.settings.composition import SettingsError, settings_from_stored
from trainers.settings.schema import Settings
from trainers.studies.plan import Training, TrainingPlan, learnt
from trainers.training import run_folder as runs
from trainers.training.run_folder import RunError, RunFolder

BLOCKS = 100  # most points of a curve of training cells
Key = tuple[str, str]  # recipe and experiment


class Stack(NamedTuple):
    """Networks of one kind, one for each training seed."""

    recipe: str
    kind: str  # what figures call it: dqn, aware, blind, still
    experiment: str  # what it was trained on
    seeds: tuple[int, ...]
    policies: tuple[Network, ...]
    chosen: int  # place of the policy that validation prefers

    @property
    def choice(self) -> Network:
        """The policy that validation prefers."""
        return self.policies[self.chosen]


class TrainingGains(NamedTuple):
    """Gains of the training cells, which explore."""

    seeds: tuple[int, ...]
    gain: np.ndarray  # (seeds, epochs)


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
    settings: Settings | None = None  # of its first run; shipped policies tell theirs
    gains: TrainingGains | None = None  # of every epoch; they are not shipped


def tidy(folder: Path, _: None) -> None:
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


def policies_of(training: Training) -> list[Network]:
    """The kept policy of every seed."""
    run = RunFolder(training.folder)
    return [load_policy(path) for _, path in run.policies(training.settings)]


def all_policies(planned: Sequence[Training]) -> dict[str, tuple[Network, ...]]:
    """The kept policies of all seeds by experiment, whichever runs they were trained in."""
    found: dict[str, tuple[Network, ...]] = {}
    for each in planned:
        found[each.experiment] = (*found.get(each.experiment, ()), *policies_of(each))
    return found


def arrays_of(policies: Sequence[Network]) -> list[np.ndarray]:
    return [array for each in policies for array in (*each.weights, *each.biases)]


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


def stacks_of(plan: TrainingPlan, planned: Sequence[Training]) -> dict[Key, Trained]:
    """What came of every experiment, all of whose runs make one stack; or the shipped policies.

    Raises RunError where none are shipped.
    """
    if plan.quick:
        return _shipped(plan)
    found = {}
    for key in dict.fromkeys((each.recipe, each.experiment) for each in planned):
        parts = [each for each in planned if (each.recipe, each.experiment) == key]
        seeds = tuple(seed for each in parts for seed in each.settings.seeds)
        policies = all_policies(parts)[key[1]]
        chosen = int(np.argmax([policy.card["validation"]["gain"] for policy in policies]))
        columns = [metrics(each) for each in parts]
        table = {name: np.concatenate([each[name] for each in columns]) for name in columns[0]}
        found[key] = Trained(
            Stack(key[0], "", key[1], seeds, policies, chosen),
            curve_of(table, parts[0].settings, seeds),
            parts[0].settings,
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


def _shipped(plan: TrainingPlan) -> dict[Key, Trained]:
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
    if not found:
        raise RunError("no policies are shipped with this copy: leave out --quick to train them")
    return found
