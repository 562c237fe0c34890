"""Validation: the greedy policy of every seed on a population that is neither trained nor tested on."""

import functools
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from swarm.envs.torchrl import SwarmEnv
from swarm.optimal.physical_limit import limit
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.strategies import Greedy
from swarm.population.blocks.block import lives
from swarm.population.results import RIVAL
from trainers.algorithms.networks import best, steered


class Validation:
    """A world of `cells` cells for every seed, drawn from the seed's validation streams."""

    def __init__(self, world: World, cells: int, seeds: list[int], device: str | None = None) -> None:
        self.world, self.seeds = world, seeds
        self.env = SwarmEnv(
            len(seeds), device, n_swimmers=cells, seeds=seeds, population="validation", world=world
        )
        self._starts = [draw_starts(world, cells, seed, population="validation") for seed in seeds]

    @functools.cached_property
    def limits(self) -> np.ndarray | None:
        """The physical limit (seeds,) of each seed's cells; None where there is none."""
        bounds = [limit(self.world, each) for each in self._starts]
        return None if None in bounds else np.array(bounds, float)

    @functools.cached_property
    def greedy(self) -> np.ndarray:
        """Mean gain (seeds,) of each seed's cells under greedy."""
        lived = (
            lives(self.world, Greedy(), each, seed, name=RIVAL, population="validation")
            for seed, each in zip(self.seeds, self._starts, strict=True)
        )
        return np.array([results["gain"].mean() for results in lived])

    @torch.no_grad()
    def gains(self, policy: Callable[[Tensor], Tensor]) -> np.ndarray:
        """Mean gain (seeds,) of each seed's cells, the action always taken that `policy` prefers, see `best`:
        (seeds, cells, inputs) -> (seeds, cells, outputs).
        """
        env = self.env
        env.set_seeds(self.seeds)  # the same lives every time
        observation, hidden = env.restart(), None
        while not env.all_finished():
            outputs, hidden = steered(policy, observation, hidden)
            observation = env.advance(best(outputs, self.world.action_range)).observation
        return env.gain().double().mean(-1).cpu().numpy()
