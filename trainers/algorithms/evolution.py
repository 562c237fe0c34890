"""Evolution strategies: the weights themselves are searched, by what the cells that they steer gain.

CMA-ES (Hansen 2016, arXiv:1604.00772) of the package `cma`, one search for each seed. An epoch is a
generation: each world of a seed is steered by a candidate of its own, whose fitness is the mean gain there.
"""

import copy
import warnings
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn

from swarm._support import streams
from swarm._support.checks import check_installed
from swarm.envs.torchrl import SwarmEnv
from trainers.algorithms.base import Algorithm, held_by
from trainers.algorithms.collector import SeedCollector
from trainers.algorithms.networks import seed_mlp
from trainers.settings.learning import EvolutionSettings
from trainers.settings.schema import Settings


class Candidates(TensorDictModuleBase):
    """Every world is steered by a network of its own, which always takes the best action."""

    in_keys = ["observation"]
    out_keys = ["action"]

    def __init__(self, networks: nn.Module, n_worlds: int) -> None:
        super().__init__()
        self.networks, self.n_worlds = networks, n_worlds

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        seen = tensordict["observation"]
        values = self.networks(seen.reshape(self.n_worlds, -1, seen.shape[-1]))
        return tensordict.set("action", values.argmax(-1).reshape(seen.shape[:-1]))

    def of_worlds(self, chosen: np.ndarray) -> "Candidates":
        """What steers the worlds of these numbers (worlds,)."""
        networks = copy.deepcopy(self.networks)
        for part in networks.parameters():
            part.data = part.data[chosen]
        return Candidates(networks, len(chosen))


class Evolution(Algorithm):
    """Asks for a generation of candidates, lets each live, and tells what they gained."""

    metrics = ("fitness", "step_size")
    settings: EvolutionSettings

    def __init__(self, env: SwarmEnv, settings: Settings) -> None:
        check_installed("algorithm evolution needs", "cma", extra="evolution")
        with warnings.catch_warnings():  # of what it would plot with
            warnings.simplefilter("ignore")
            from cma import CMAEvolutionStrategy

        self.env, self.settings = env, cast(EvolutionSettings, settings.learning)
        self.policy = seed_mlp(settings.layers, self.keys("network"), env.device)
        self.networks = seed_mlp(settings.layers, [0] * env.n_worlds, env.device)
        self.collector = SeedCollector(env, Candidates(self.networks, env.n_worlds))
        shape = len(env.seeds), env.n_worlds // len(env.seeds)
        self.fitness = torch.zeros(0, *shape, dtype=torch.float64)  # of all generations so far
        self.noise: list[np.random.Generator] = []
        self.searches: list[Any] = []
        for place, start in enumerate(_flat(self.policy)):
            normal = lambda *size, place=place: self.noise[place].standard_normal(size)  # noqa: E731
            options = {"popsize": shape[1], "seed": np.nan, "verbose": -9, "randn": normal}
            self.searches.append(CMAEvolutionStrategy(start, self.settings.step_size, options))

    def _ask(self, epoch: int) -> None:
        """The candidates of a generation; its random numbers are its own."""
        self.noise = [streams.generator("training", "network", seed, epoch) for seed in self.env.seeds]
        self.asked = [search.ask() for search in self.searches]

    def _tell(self, fitness: Tensor) -> None:
        for search, asked, found in zip(self.searches, self.asked, fitness.numpy(), strict=True):
            search.tell(asked, (-found).tolist())

    def begin(self, epoch: int) -> None:
        self._ask(epoch)
        _put(self.networks, np.concatenate(self.asked))

    def learn(self, rollout: TensorDict, progress: float) -> dict[str, Tensor | float] | None:
        """Once all have lived, what they gained; the policy is the mean of the search."""
        if not self.env.all_finished():
            return None
        fitness = self.env.gain().double().mean(-1).reshape(self.fitness.shape[1:]).cpu()
        self._tell(fitness)
        self.fitness = torch.cat([self.fitness, fitness[None]])
        self.updates += 1
        _put(self.policy, np.stack([search.mean for search in self.searches]))
        steps = torch.tensor([float(search.sigma) for search in self.searches])
        return {"fitness": fitness.mean(-1), "step_size": steps}

    def tensors(self) -> dict[str, Tensor]:
        return held_by(policy=self.policy) | {"fitness": self.fitness}

    def growing(self) -> dict[str, int]:
        return {"fitness": self.settings.epochs}

    def restore(self, tensors: Mapping[str, Tensor], counters: Mapping[str, int]) -> None:
        """Searches are told again what they were told: they keep more than they show."""
        self.fitness = tensors["fitness"].clone()
        if not self.fitness.isfinite().all():
            raise ValueError("fitness must be finite")
        for epoch, fitness in enumerate(self.fitness):
            self._ask(epoch)
            self._tell(fitness)
        super().restore(tensors, counters)


def _flat(networks: nn.Module) -> np.ndarray:
    """All weights and biases (networks, parameters)."""
    parts = [part.detach().cpu().double().flatten(1) for part in networks.parameters()]
    return torch.cat(parts, dim=1).numpy()


@torch.no_grad()
def _put(networks: nn.Module, flat: np.ndarray) -> None:
    """Let what is searched decide: the first output is 0, since only differences to it count; the last
    numbers, as many as it has parameters, are read by nobody.
    """
    *hidden, weight, bias = networks.parameters()
    for part in (weight, bias):
        part[..., 0] = 0.0
    numbers, used = torch.as_tensor(flat), 0
    for target in (*hidden, weight[..., 1:], bias[..., 1:]):
        size = target[0].numel()
        target.copy_(numbers[:, used : used + size].reshape(target.shape))
        used += size
