"""The training loop: epochs of collecting, learning and validating, and the policies that are kept."""

import dataclasses
import logging
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl import torchrl_logger

from swarm._support import provenance
from swarm.envs.torchrl import SwarmEnv
from swarm.physics.perception import described
from swarm.policies.network import Network
from trainers.algorithms.base import learner_of, worth_compiling
from trainers.algorithms.networks import exported
from trainers.algorithms.spread import Here, SpreadCollector, Submit
from trainers.settings.schema import Settings
from trainers.training.run_folder import RunError
from trainers.training.validation import Validation

WORTH_COMPILING = 3e8  # decisions of a cell, from which compiling them saves more time than it takes
BEFORE, AFTER = ("training_gain",), ("decisions", "updates", "gain", "fraction_of_limit")


class TrainingError(RunError):
    """Training cannot go on."""


class Training:
    """All that a run carries from one epoch to the next; with `learning.block`, decisions are collected by
    tasks for `submit`, which by default does them here.
    """

    def __init__(self, settings: Settings, submit: Submit | None = None) -> None:
        torchrl_logger.setLevel(logging.WARNING)
        torch.set_num_threads(settings.threads)
        self.settings, self.seeds = settings, settings.seeds
        learning, checked, world = settings.learning, settings.validation, settings.training_world()
        worlds = learning.n_worlds * len(self.seeds)
        decisions = worlds * learning.n_swimmers * learning.epochs * world.max_decisions
        # Of environments; TorchRL moves what it is given where the processor is named.
        device = None if settings.device == "cpu" else settings.device
        self.env = SwarmEnv(
            worlds,
            device,
            n_swimmers=learning.n_swimmers,
            seeds=self.seeds,
            compile_step=not learning.block and worth_compiling(settings, decisions, WORTH_COMPILING),
            world=world,
        )
        self.algorithm = learner_of(settings)(self.env, settings)
        if learning.block:
            whole = getattr(self.algorithm, "collector", None)
            self.algorithm.collector = SpreadCollector(whole, settings, submit or Here)
        sizes = checked.cells, self.seeds, device
        self.validation = Validation(world.replace(life=checked.life), *sizes, worlds=checked.worlds)
        self.epoch = 0
        self.decisions = 0
        self.untrained = np.full(
            len(self.seeds), np.nan
        )  # validation gain before the first epoch, once known
        self.best_gain = np.full(len(self.seeds), -np.inf)
        self.best_epoch = np.zeros(len(self.seeds), np.int64)
        self.best = {name: tensor.clone() for name, tensor in self.algorithm.policy.state_dict().items()}
        self.measured = (*BEFORE, *self.algorithm.metrics, *AFTER)
        self.measures = np.zeros((0, len(self.seeds), len(self.measured)))

    # --- one epoch ------------------------------------------------------------------------------------------

    def run_epoch(self) -> None:
        """One life of every cell, with learning in between, then validation where it is due."""
        env, algorithm, epochs = self.env, self.algorithm, self.settings.learning.epochs
        env.restart()
        algorithm.begin(self.epoch)
        rounds: list[dict[str, Tensor | float]] = []
        while not env.all_finished():
            progress = (self.epoch + int(env.decision[0]) / env.world.max_decisions) / epochs
            rollout = algorithm.collect(progress)
            self._check_rewards(rollout)
            measured = algorithm.learn(rollout, progress)
            rounds += [] if measured is None else [measured]
        self.decisions += int(env.decision[0])
        self.epoch += 1
        gain = np.full(len(self.seeds), np.nan)
        if self.epoch % self.settings.validation.every == 0 or self.epoch == epochs:
            gain = self._validate()
        self._measure(rounds, gain)

    def _validate(self) -> np.ndarray:
        """Mean gain (seeds,) of the greedy policies; the best one of each seed is kept."""
        policy = self.algorithm.policy
        gain = self.validation.gains(policy)
        self._check_finite("gain", gain)
        better = gain > self.best_gain if self.settings.learning.keep == "best" else np.ones(len(gain), bool)
        self.best_gain = np.where(better, gain, self.best_gain)
        self.best_epoch = np.where(better, self.epoch, self.best_epoch)
        for name, tensor in policy.state_dict().items():
            self.best[name][better] = tensor[better]
        return gain

    def _check_rewards(self, rollout: TensorDict) -> None:
        """Raises TrainingError where a reward is not finite."""
        reward = rollout["next", "reward"]
        if math.isfinite(reward.sum()):
            return
        wrong = (~reward.isfinite()).nonzero()
        if len(wrong):
            _, place, cell, _ = wrong[0].tolist()
            raise TrainingError(
                f"reward must be finite, got {reward[tuple(wrong[0])]} for cell {cell} of "
                f"seed {self.seeds[place]} in epoch {self.epoch + 1}: the field or the flow gives such values"
            )

    def _check_finite(self, name: str, values: np.ndarray) -> None:
        """Raises TrainingError where a seed's value (seeds,) is not finite."""
        for seed, value in zip(self.seeds, values, strict=True):
            if not np.isfinite(value):
                raise TrainingError(
                    f"{name} must be finite, got {value} in epoch {self.epoch} of seed {seed}: "
                    "a lower learning.learning_rate may help"
                )

    def _measure(self, rounds: list[dict[str, Tensor | float]], gain: np.ndarray) -> None:
        """This epoch's row of metrics for each seed; raises TrainingError where something is not finite.

        training_gain: mean gain of the training cells, which explore; the algorithm's own: means over the
        epoch's rounds of what differs between seeds, and the last of what does not; gain, fraction_of_limit:
        validation (NaN where none was due).
        """
        row = np.empty((len(self.seeds), len(self.measured)))
        means = self.env.gain().double().reshape(len(self.seeds), -1).mean(-1)
        columns: dict[str, Any] = {
            "training_gain": means.cpu().numpy(),
            **{name: _over_rounds([each[name] for each in rounds]) for name in self.algorithm.metrics},
            "decisions": self.decisions,
            "updates": self.algorithm.updates,
            "gain": gain,
            "fraction_of_limit": self._of_limit(gain),
        }
        for place, name in enumerate(self.measured):
            row[:, place] = columns[name]
            if name not in AFTER:
                self._check_finite(name, row[:, place])
        weights = sum(
            each.double().flatten(1).sum(-1) for each in self.algorithm.policy.state_dict().values()
        )
        self._check_finite("sum of the weights", weights.cpu().numpy())
        self.measures = np.concatenate([self.measures, row[None]])

    def _of_limit(self, gain: np.ndarray) -> np.ndarray:
        """Gain (seeds,) as a fraction of the limit; NaN where there is none above 0."""
        nothing = np.full(len(self.seeds), np.nan)
        if np.isnan(gain).all() or (limits := self.validation.limits) is None:
            return nothing
        return np.divide(gain, limits, out=nothing, where=limits > 0)

    # --- what is told of it ---------------------------------------------------------------------------------

    def measure(self, name: str) -> np.ndarray:
        """A metric (epochs, seeds)."""
        return self.measures[:, :, self.measured.index(name)]

    @property
    def columns(self) -> tuple[str, ...]:
        """Of metrics.csv; what they mean is said where they are computed."""
        return ("epoch", "seed", *self.measured)

    def metric_rows(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """Rows of metrics.csv from epoch `first` + 1 on."""
        for index in range(first, len(self.measures)):
            for place, seed in enumerate(self.seeds):
                values = dict(zip(self.measured, self.measures[index, place].tolist(), strict=True))
                whole = {name: int(values.pop(name)) for name in ("decisions", "updates")}
                kept = {name: None if np.isnan(value) else value for name, value in values.items()}
                yield {"epoch": index + 1, "seed": seed, **kept, **whole}

    def policies(self) -> list[Network]:
        """The kept policy of every seed."""
        return [exported(self.best, place, self._card(place)) for place in range(len(self.seeds))]

    def _card(self, place: int) -> dict[str, Any]:
        """What a policy file says of itself: no times, and no paths but those of data, as they were given."""
        world, settings = self.env.world, dataclasses.asdict(self.settings)
        fraction = float(self._of_limit(self.best_gain)[place])
        return {
            "algorithm": self.settings.algorithm,
            "experiment": self.settings.experiment,
            "recipe": self.settings.recipe,
            "seed": self.seeds[place],
            "epoch": int(self.best_epoch[place]),
            "n_records": world.n_records,
            "features": world.features,
            "sensor": described(world.sensor),
            "n_actions": 1 if world.is_continuous else world.n_actions,
            **({"curvature_range": list(world.action_range)} if world.action_range else {}),
            "settings": {name: settings[name] for name in ("world", "learning", "validation", "evaluation")},
            "validation": {
                "gain": float(self.best_gain[place]),
                "fraction_of_limit": None if np.isnan(fraction) else fraction,
            },
            **provenance.origin(),
        }


def _over_rounds(values: list[Any]) -> Any:
    """The mean (seeds,) of tensors (seeds,), the last of numbers; NaN where there are none."""
    if values and isinstance(values[0], Tensor):
        return torch.stack(values).double().mean(0).cpu().numpy()
    return values[-1] if values else np.nan
