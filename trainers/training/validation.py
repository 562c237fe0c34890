"""Validation: the greedy policy of every seed on a population that is neither trained nor tested on."""

import functools
from collections.abc import Callable
from typing import Any

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
    """`worlds` worlds of `cells` cells each for every seed, drawn one after the other from the seed's
    validation streams.
    """

    def __init__(
        self, world: World, cells: int, seeds: list[int], device: str | None = None, *, worlds: int = 1
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
