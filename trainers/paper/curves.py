"""Training curves: how the gain grew, read off the metrics of runs or shipped with the policies."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import NamedTuple

import numpy as np

from swarm.population.contest import population_test
from swarm.population.results import RIVAL
from trainers.paper.measurements import Stack
from trainers.paper.plan import Training
from trainers.settings.schema import Settings
from trainers.training import run_folder as runs
from trainers.training.run_folder import RunError, RunFolder

COLUMNS = ("training_gain", "gain", "fraction_of_limit")  # of metrics.csv, those that are read
BLOCKS = 100  # most points of a curve of training cells


class TrainingCurve(NamedTuple):
    """Gains during training: of the validation cells, which do not explore, and of the training cells."""

    epoch: list[int]  # (validations,)
    gain: list[list[float]]  # (seeds, validations)
    greedy: float | None  # the same validation cells under greedy
    limit: float | None
    training_epoch: list[float]  # (blocks,) middle of the epochs that are averaged
    training_gain: list[list[float]]  # (seeds, blocks)


Curves = Mapping[tuple[str, str], TrainingCurve]  # by recipe and experiment


def metrics(run: RunFolder, settings: Settings) -> dict[str, np.ndarray]:
    """The `COLUMNS` (seeds, epochs) of a finished run's metrics; NaN where a column has no number.

    Raises RunError unless there is a row of numbers for every seed and epoch.
    """
    rows, path = run.rows(runs.METRICS), run.path / runs.METRICS
    try:
        by_seed = [[row for row in rows if int(row["seed"]) == seed] for seed in settings.seeds]
        found = {name: [[float(row[name] or "nan") for row in one] for one in by_seed] for name in COLUMNS}
    except (KeyError, ValueError) as error:
        raise RunError(f"{path} must hold numbers in the columns of a run's metrics, got {error}") from None
    lengths = [len(one) for one in by_seed]
    if set(lengths) != {settings.learning.epochs}:
        raise RunError(
            f"{path} must have {settings.learning.epochs} rows for each seed, one per epoch, got {lengths}"
        )
    return {name: np.array(values) for name, values in found.items()}


def trained_curves(planned: Iterable[Training]) -> dict[tuple[str, str], TrainingCurve]:
    """Curves of every training."""
    return {
        (each.recipe, each.experiment): curve_of(RunFolder(each.folder), each.settings) for each in planned
    }


def curve_of(run: RunFolder, settings: Settings) -> TrainingCurve:
    """The curve of one run."""
    table = metrics(run, settings)
    validated = np.flatnonzero(np.isfinite(table["gain"][0]))
    gain = table["gain"][:, validated]
    limits = gain[:, -1] / table["fraction_of_limit"][:, validated[-1]]
    epochs = table["training_gain"].shape[1]
    blocks = np.array_split(np.arange(epochs), min(BLOCKS, epochs))
    exploring = np.stack([table["training_gain"][:, block].mean(axis=1) for block in blocks], axis=1)
    return TrainingCurve(
        epoch=(validated + 1).tolist(),
        gain=gain.round(4).tolist(),
        greedy=_greedy(settings),
        limit=float(limits.mean()) if np.isfinite(limits).all() else None,
        training_epoch=[float(block.mean()) + 1 for block in blocks],
        training_gain=exploring.round(4).tolist(),
    )


def _greedy(settings: Settings) -> float:
    """Mean gain of greedy on the validation cells of all seeds."""
    checked = settings.validation
    world = settings.training_world()
    means = []
    for seed in settings.seeds:
        results = population_test(
            world,
            {},
            cells=checked.cells,
            life=checked.life,
            seed=seed,
            population="validation",
            record=False,
            limit=False,
        )
        means.append(float(results["gain"].sel(policy=RIVAL).mean()))
    return float(np.mean(means))


def shipped_curves(stacks: Mapping[tuple[str, str], Stack]) -> dict[tuple[str, str], TrainingCurve]:
    """Curves that are shipped with policies, where they are."""
    found = {}
    for key, stack in stacks.items():
        file = resources.files("swarm") / "zoo" / f"{stack.experiment}.json"
        if file.is_file():
            stored = json.loads(file.read_text(encoding="utf-8")).get("training")
            if stored:
                found[key] = TrainingCurve(**stored)
    return found
