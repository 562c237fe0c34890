"""Training: epochs of collecting, learning and validating, and the policies that are kept."""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torchrl import torchrl_logger

from swarm._support import provenance
from swarm.envs.torchrl import SwarmEnv
from swarm.physics.world import World
from trainers.algorithms.dqn import Learner
from trainers.algorithms.exploration import Explorer
from trainers.algorithms.transitions import Transitions
from trainers.settings.learning import DQNSettings, LearningSettings
from trainers.settings.schema import Settings
from trainers.training.run_folder import METRIC_COLUMNS, RunError
from trainers.training.validation import Validation

WORTH_COMPILING = 3e8  # decisions of a cell, from which compiling saves more time than it takes
MEASURES = METRIC_COLUMNS[2:]  # all but epoch and seed


class TrainingError(RunError):
    """Training cannot go on."""


def epsilon_at(settings: DQNSettings, epoch: int, progress: float) -> float:
    """ε in an epoch (from 0); `progress` is the part of all epochs that is over."""
    if settings.epsilon_schedule == "exponential":
        return max(settings.epsilon_end, settings.epsilon_start * settings.epsilon_decay**epoch)
    fallen = min(1.0, progress / settings.epsilon_fraction)
    return settings.epsilon_start + (settings.epsilon_end - settings.epsilon_start) * fallen


def learning_rate_at(settings: LearningSettings, updates: int, progress: float) -> float:
    """Learning rate after `updates` updates."""
    if settings.learning_rate_schedule == "inverse_time":
        return settings.learning_rate / (1 + settings.learning_rate_decay * updates)
    return settings.learning_rate * (1 + (settings.learning_rate_end - 1) * progress)


class Training:
    """All that a run carries from one epoch to the next."""

    @torch.inference_mode()
    def __init__(self, settings: Settings) -> None:
        torchrl_logger.setLevel(logging.WARNING)
        torch.set_num_threads(settings.threads)
        self.settings = settings
        self.seeds = settings.seeds
        # Of environments; TorchRL moves what it is given where the processor is named.
        self.device = None if settings.device == "cpu" else settings.device
        learning = settings.learning
        assert isinstance(learning, DQNSettings)
        world = settings.training_world()
        cells = learning.n_worlds * len(self.seeds) * learning.n_swimmers
        fast = settings.compile == "always" or (
            settings.compile == "auto" and cells * learning.epochs * world.max_decisions >= WORTH_COMPILING
        )
        self.explorer = self.make_explorer(world, fast)
        self.env = self.explorer.env
        self.learner = Learner(world.observation_size, world.n_actions, learning, self.seeds, settings.device)
        checked = settings.validation
        self.validation = Validation(world.replace(life=checked.life), checked.cells, self.seeds, self.device)
        self.epoch = 0
        self.decisions = 0
        self.best_gain = np.full(len(self.seeds), -np.inf)
        self.best_epoch = np.zeros(len(self.seeds), np.int64)
        self.best = self.learner.played.flat.clone()
        self.measures = np.zeros((0, len(self.seeds), len(MEASURES)))

    def make_explorer(self, world: World, compile: bool) -> Explorer:
        learning = self.settings.learning
        assert isinstance(learning, DQNSettings)
        env = SwarmEnv(
            learning.n_worlds * len(self.seeds),
            self.device,
            n_swimmers=learning.n_swimmers,
            seeds=self.seeds,
            compile_step=compile,
            world=world,
        )
        return Explorer(env, discount=learning.discount, n_steps=learning.n_steps, compile=compile)

    # --- one epoch ------------------------------------------------------------------------------------------

    def run_epoch(self) -> None:
        """One life of every cell, with rounds of updates in between, then validation where it is due."""
        settings, learning = self.settings, self.settings.learning
        assert isinstance(learning, DQNSettings)
        self.explorer.restart()
        self.learner.begin(self.epoch)
        longest = self.env.world.max_decisions
        losses, values, done = [], [], 0
        while done < longest and (done == 0 or not self.env.all_finished()):
            progress = (self.epoch + done / longest) / learning.epochs
            epsilon = epsilon_at(learning, self.epoch, progress)
            decisions = min(learning.collect or longest, longest - done)
            rows = self.explorer.collect(self.learner.online, epsilon, decisions)
            done = int(self.env.decision[0])
            if not len(rows):  # returns over several decisions take some to begin with
                continue
            self._check_rewards(rows)
            self.learner.remember(rows)
            loss, value = self.learner.learn(
                lambda updates, p=progress: learning_rate_at(learning, updates, p)
            )
            losses.append(loss)
            values.append(value)
        self.decisions += done
        self.epoch += 1
        gain = np.full(len(self.seeds), np.nan)
        if self.epoch % settings.validation.every == 0 or self.epoch == learning.epochs:
            gain = self._validate()
        self._measure(torch.stack(losses), torch.stack(values), epsilon, gain)

    def _validate(self) -> np.ndarray:
        """Mean gain (seeds,) of the greedy policies; the best one of each seed is kept."""
        network = self.learner.played
        gain = self.validation.gains(network)
        self._check_finite("gain", gain)
        better = gain > self.best_gain if self.settings.learning.keep == "best" else np.ones(len(gain), bool)
        self.best_gain = np.where(better, gain, self.best_gain)
        self.best_epoch = np.where(better, self.epoch, self.best_epoch)
        mask = torch.as_tensor(better, device=network.flat.device)[:, None]
        self.best = torch.where(mask, network.flat, self.best)
        return gain

    def _check_rewards(self, rows: Tensor) -> None:
        """Raises TrainingError where a reward of packed rows is not finite: it would spoil the buffer for
        good.
        """
        if math.isfinite(rows.sum()):
            return
        reward = Transitions.unpacked(rows).reward
        wrong = ~reward.isfinite()
        if wrong.any():
            row, place = wrong.nonzero()[0].tolist()
            raise TrainingError(
                f"reward must be finite, got {reward[row, place]} for cell {row % self.explorer.cells} of "
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

    def _measure(self, losses: Tensor, values: Tensor, epsilon: float, gain: np.ndarray) -> None:
        """This epoch's row of metrics for each seed; raises TrainingError where something is not finite.

        training_gain: mean gain of the training cells, which explore; loss, q_mean: means over the epoch's
        rounds of the last batch's loss and chosen value; gain, fraction_of_limit: validation (NaN where none
        was due).
        """
        training_gain = self.explorer.gains().double().mean(-1)
        limits = self.validation.limits
        row = np.empty((len(self.seeds), len(MEASURES)))
        columns: dict[str, Any] = {
            "training_gain": training_gain.cpu().numpy(),
            "loss": losses.double().mean(0).cpu().numpy(),
            "q_mean": values.double().mean(0).cpu().numpy(),
            "epsilon": epsilon,
            "learning_rate": self.learner.rate,
            "decisions": self.decisions,
            "updates": self.learner.updates,
            "gain": gain,
            "fraction_of_limit": np.nan if limits is None else gain / limits,
        }
        for place, name in enumerate(MEASURES):
            row[:, place] = columns[name]
        checked = {name: columns[name] for name in ("training_gain", "loss", "q_mean")}
        checked["sum of the weights"] = self.learner.online.flat.double().sum(-1).cpu().numpy()
        for name, checked_values in checked.items():
            self._check_finite(name, checked_values)
        self.measures = np.concatenate([self.measures, row[None]])

    def latest_validation(self) -> tuple[float, float]:
        """This epoch's validation gain and fraction of the limit, mean over seeds; NaN where none was due."""
        means = self.measures[-1].mean(0)
        return float(means[MEASURES.index("gain")]), float(means[MEASURES.index("fraction_of_limit")])

    def metric_rows(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """Rows of metrics.csv from epoch `first` + 1 on."""
        for index in range(first, len(self.measures)):
            for place, seed in enumerate(self.seeds):
                values = dict(zip(MEASURES, self.measures[index, place].tolist(), strict=True))
                whole = {name: int(values.pop(name)) for name in ("decisions", "updates")}
                kept = {name: None if np.isnan(value) else value for name, value in values.items()}
                yield {"epoch": index + 1, "seed": seed, **kept, **whole}

    # --- what comes out -------------------------------------------------------------------------------------

    def policy_card(self, place: int) -> dict[str, Any]:
        """What a policy file says of itself: no times, no paths."""
        limits = self.validation.limits
        gain = float(self.best_gain[place])
        world = self.env.world
        settings = dataclasses.asdict(self.settings)
        return {
            "experiment": self.settings.experiment,
            "recipe": self.settings.recipe,
            "seed": self.seeds[place],
            "epoch": int(self.best_epoch[place]),
            "n_records": world.n_records,
            "features": world.features,
            "sensor": world.sensor.name,
            "n_actions": world.n_actions,
            "settings": {name: settings[name] for name in ("world", "learning", "validation", "evaluation")},
            "validation": {
                "gain": gain,
                "fraction_of_limit": None if limits is None else gain / float(limits[place]),
            },
            "versions": provenance.versions(),
            "commit": provenance.commit(),
        }
