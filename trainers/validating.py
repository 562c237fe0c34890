"""Validation: the greedy policy of every seed on a population that is neither trained nor tested on."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from swarm.optimal import limit
from swarm.starts import NOISE_BLOCK, Starts, draw_noise, draw_starts
from swarm.strategies import Greedy, Policy
from swarm.world import World
from trainers.q_network import QNetwork


class Validation:
    """Fixed starts for every seed, drawn from the seed's validation streams; `limits` and `greedy` are
    (seeds,).
    """

    def __init__(self, world: World, cells: int, seeds: list[int], device: str = "cpu") -> None:
        self.world, self.cells, self.seeds, self.device = world, cells, seeds, torch.device(device)
        starts = [draw_starts(world, cells, seed, population="validation") for seed in seeds]
        bounds = [limit(world, each) for each in starts]
        self.limits = None if None in bounds else np.array(bounds, float)
        stacked = Starts(*(np.stack(parts) for parts in zip(*starts, strict=True)))
        self.greedy = self._play_numpy(stacked, Greedy())
        self._starts = [
            torch.as_tensor(
                part, dtype=torch.float32 if part.dtype.kind == "f" else torch.int64, device=self.device
            )
            for part in stacked
        ]

    def gains(self, network: QNetwork) -> np.ndarray:
        """Mean gain (seeds,) of each seed's cells, the best action always taken."""
        state = self.world.start(*self._starts)
        observation = self.world.observation(state)
        for decision in range(self.world.max_decisions):
            action = network.values(observation).argmax(-1)
            state, outcome = self.world.step(state, action, self._noise(decision))
            observation = outcome.observation
            if bool(state.finished.all()):
                break
        return outcome.gain.double().mean(-1).cpu().numpy()

    def _play_numpy(self, starts: Starts, policy: Policy) -> np.ndarray:
        state = self.world.start(*starts)
        uniform = np.zeros(starts.heading.shape)
        for decision in range(self.world.max_decisions):
            noise = self._noise(decision)
            action = policy.act(self.world, state, uniform)
            state, outcome = self.world.step(state, action, None if noise is None else noise.double().numpy())
            if state.finished.all():
                break
        return outcome.gain.mean(-1)

    def _noise(self, decision: int) -> Tensor | None:
        if not self.world.has_noise:
            return None
        block, place = divmod(decision, NOISE_BLOCK)
        if place == 0:
            drawn = [
                draw_noise(seed, self.cells, NOISE_BLOCK, population="validation", block=block)
                for seed in self.seeds
            ]
            self._noise_block = torch.as_tensor(np.stack(drawn), dtype=torch.float32, device=self.device)
        return self._noise_block[:, :, place]
