"""The training loop: epochs of collecting, learning and validating, and the policies that are kept."""

import dataclasses
import functools
import logging
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl import torchrl_logger

from swarm._support import provenance
from swarm.envs.torchrl import SwarmEnv
from swarm.optimal.physical_limit import limit
from swarm.physics.perception import described
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.network import Network
from swarm.policies.strategies import Greedy
from swarm.population.blocks.block import lives
from swarm.population.results import RIVAL
from trainers.algorithms.base import learner_of, worth_compiling
from trainers.algorithms.collector import training_env
from trainers.algorithms.networks import best, exported, steered
from trainers.algorithms.spread import Here, SpreadCollector, Submit
from trainers.settings.schema import Settings
from trainers.training.run_folder import RunError

WORTH_COMPILING = 3e8  # decisions of a cell, from which compiling them saves more time than it takes
COUNTS = ("decisions", "updates")
BEFORE, AFTER = ("training_gain",), (*COUNTS, "gain", "fraction_of_limit")


class TrainingError(RunError):
    """Training cannot go on."""


class Training:
    """All that a run carries from one epoch to the next; with `learning.block`, decisions are collected by
    tasks for `submit`, which by default does them here.
    """

    def __init__(self, settings: Settings, submit: Submit | None = None) -> None:
        torchrl_logger.setLevel(logging.WARNING)
        self.settings, self.seeds = settings, settings.seeds
        learning, checked, world = settings.learning, settings.validation, settings.training_world()
        cells = learning.n_worlds * len(self.seeds) * learning.n_swimmers
        decisions = cells * learning.epochs * world.max_decisions
        compiled = not learning.block and worth_compiling(settings, decisions, WORTH_COMPILING)
        self.env = training_env(settings, learning.n_worlds, learning.n_swimmers, compile_step=compiled)
        self.algorithm = learner_of(settings)(self.env, settings)
        if learning.block:
            whole = getattr(self.algorithm, "collector", None)
            self.algorithm.collector = SpreadCollector(whole, settings, submit or Here)
        sizes = checked.cells, self.seeds, self.env.device
        self.validation = Validation(world.replace(life=checked.life), *sizes, worlds=checked.worlds)
        self.epoch = 0
        self.decisions = 0
        self.unknown = np.full(len(self.seeds), np.nan)
        self.untrained = self.unknown  # validation gain before the first epoch, once known
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
            if (measured := algorithm.learn(rollout, progress)) is not None:
                rounds.append(measured)
        self.decisions += int(env.decision[0])
        self.epoch += 1
        due = self.epoch % self.settings.validation.every == 0 or self.epoch == epochs
        self._measure(rounds, self._validate() if due else self.unknown)

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
        reward = rollout["next", "reward"]
        if math.isfinite(reward.sum()):
            return
        for decision, place, cell, _ in (~reward.isfinite()).nonzero().tolist():
            where = f"for cell {cell} of seed {self.seeds[place]} in epoch {self.epoch + 1}"
            value = reward[decision, place, cell].item()
            raise TrainingError(
                f"reward must be finite, got {value} {where}: the field or the flow gives such values"
            )

    def _check_finite(self, name: str, values: np.ndarray) -> None:
        for seed, value in zip(self.seeds, values, strict=True):
            if not np.isfinite(value):
                where = f"in epoch {self.epoch} of seed {seed}: a lower learning.learning_rate may help"
                raise TrainingError(f"{name} must be finite, got {value} {where}")

    def _measure(self, rounds: list[dict[str, Tensor | float]], gain: np.ndarray) -> None:
        """This epoch's row of metrics for each seed; raises TrainingError where something is not finite.

        training_gain: mean gain of the training cells, which explore; the algorithm's own: means over the
        epoch's rounds of what differs between seeds, and the last of what does not; gain, fraction_of_limit:
        validation (NaN where none was due).
        """
        row, algorithm = np.empty((len(self.seeds), len(self.measured))), self.algorithm
        means = self.env.gain().double().reshape(len(self.seeds), -1).mean(-1)
        own = (_over_rounds([each[name] for each in rounds]) for name in algorithm.metrics)
        after = self.decisions, algorithm.updates, gain, self._of_limit(gain)
        for place, values in enumerate((means.cpu().numpy(), *own, *after)):
            row[:, place] = values
        for place in range(len(self.measured) - len(AFTER)):
            self._check_finite(self.measured[place], row[:, place])
        weights = sum(each.double().flatten(1).sum(-1) for each in algorithm.policy.state_dict().values())
        self._check_finite("sum of the weights", weights.cpu().numpy())
        self.measures = np.concatenate([self.measures, row[None]])

    def _of_limit(self, gain: np.ndarray) -> np.ndarray:
        """Gain (seeds,) as a fraction of the limit; NaN where there is none above 0."""
        if np.isnan(gain).all() or (limits := self.validation.limits) is None:
            return self.unknown
        return np.divide(gain, limits, out=self.unknown.copy(), where=limits > 0)

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
                row: dict[str, Any] = {"epoch": index + 1, "seed": seed}
                for name, value in zip(self.measured, self.measures[index, place].tolist(), strict=True):
                    row[name] = None if np.isnan(value) else int(value) if name in COUNTS else value
                yield row

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


class Validation:
    """`worlds` worlds of `cells` cells each for every seed, drawn one after the other from the seed's
    validation streams: neither trained nor tested on.
    """

    def __init__(
        self, world: World, cells: int, seeds: list[int], device: torch.device | None = None, *, worlds: int = 1
    ) -> None:
        self.world, self.cells, self.worlds, self.seeds = world, cells, worlds, seeds
        words: dict[str, Any] = {"n_swimmers": cells, "seeds": seeds, "population": "validation"}
        self.env = SwarmEnv(worlds * len(seeds), device, world=world, **words)

    @functools.cached_property
    def limits(self) -> np.ndarray | None:
        """The physical limit (seeds,) of each seed's cells; None where there is none."""
        cells = self.worlds * self.cells
        starts = (draw_starts(self.world, cells, seed, population="validation") for seed in self.seeds)
        bounds = [limit(self.world, each) for each in starts]
        return None if None in bounds else np.array(bounds, float)

    @functools.cached_property
    def greedy(self) -> np.ndarray:
        """Mean gain (seeds,) of each seed's cells under greedy."""
        gain = np.empty((len(self.seeds), self.worlds, self.cells))
        which: dict[str, Any] = {"population": "validation"}
        for (place, number), _ in np.ndenumerate(gain[..., 0]):
            seed, which["first"] = self.seeds[place], number * self.cells
            starts = draw_starts(self.world, self.cells, seed, **which)
            gain[place, number] = lives(self.world, Greedy(), starts, seed, name=RIVAL, **which)["gain"]
        return gain.reshape(len(gain), -1).mean(axis=1)

    @torch.no_grad()
    def gains(self, policy: Callable[[Tensor], Tensor]) -> np.ndarray:
        """Mean gain (seeds,) of each seed's cells, the action always taken that `policy` prefers, see `best`:
        (seeds, cells of all worlds, inputs) -> (seeds, cells of all worlds, outputs).
        """
        env, seeds = self.env, len(self.seeds)
        env.set_seeds(self.seeds)  # the same lives every time
        observation, hidden = env.restart(), None
        while not env.all_finished():
            outputs, hidden = steered(policy, observation.reshape(seeds, -1, observation.shape[-1]), hidden)
            action = best(outputs, self.world.action_range).reshape(env.n_worlds, self.cells)
            observation = env.advance(action).observation
        return env.gain().double().reshape(seeds, -1).mean(-1).cpu().numpy()
