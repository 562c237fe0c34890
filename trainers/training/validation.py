"""Validation: the greedy policy of every seed on a population that is neither trained nor tested on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from swarm.envs.torchrl import SwarmEnv
from swarm.optimal.physical_limit import limit
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.strategies import Greedy
from swarm.population.contest import lives
from swarm.population.results import RIVAL


class Validation:
    """A world of `cells` cells for every seed, drawn from the seed's validation streams.

    `limits` (None where there is none) and `greedy`, the gain of that strategy, are (seeds,).
    """

    def __init__(self, world: World, cells: int, seeds: list[int], device: str | None = None) -> None:
        self.seeds = seeds
        self.env = SwarmEnv(
            len(seeds),
            device,
            n_swimmers=cells,
            seeds=seeds,
            population="validation",
            world=world,
        )
        starts = [draw_starts(world, cells, seed, population="validation") for seed in seeds]
        bounds = [limit(world, each) for each in starts]
        self.limits = None if None in bounds else np.array(bounds, float)
        self.greedy = np.array(
            [
                lives(world, Greedy(), each, seed, name=RIVAL, population="validation")["gain"].mean()
                for seed, each in zip(seeds, starts, strict=True)
            ]
        )

    @torch.no_grad()
    def gains(self, policy: Callable[[Tensor], Tensor]) -> np.ndarray:
        """Mean gain (seeds,) of each seed's cells, the action always taken for which `policy` gives the
        largest number: (seeds, cells, inputs) -> (seeds, cells, actions).
        """
        env = self.env
        env.set_seeds(self.seeds)  # the same lives every time
        observation = env.restart()
        while not env.all_finished():
            observation = env.advance(policy(observation).argmax(-1)).observation
        return env.gain().double().mean(-1).cpu().numpy()
