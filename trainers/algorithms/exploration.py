"""Collecting transitions: ε-greedy decisions of every cell of every seed.

The rollout is our own: TorchRL's Collector costs several times the decision itself for worlds this cheap
(`benchmarks/training_path.py`), and a stack of seeds needs a policy and an ε coin per seed.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from swarm._support import streams
from swarm._support.compiler import compiled
from swarm.envs.torchrl import SwarmEnv
from trainers.algorithms.q_network import QNetwork
from trainers.algorithms.transitions import Transitions

BLOCK = 64  # decisions whose random numbers are drawn at once


def epsilon_greedy(network: QNetwork, observation: Tensor, explores: Tensor, random_action: Tensor) -> Tensor:
    """Actions (seeds, cells): random where the cell explores, else the best (paper: ε-greedy)."""
    return torch.where(explores, random_action, network.values(observation).argmax(-1))


def multi_step(
    reward: Tensor, following: Tensor, terminated: Tensor, valid: Tensor, *, discount: float, steps: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Returns over up to `steps` decisions: reward, observation they lead to, and what its value counts for.

    All (decisions, ...), observations (decisions, ..., inputs). Sums γᵏ r until the life or what is given
    ends; the last factor is γᵏ, 0 after a termination (Sutton and Barto 2018, eq. 7.1). The same as TorchRL's
    `MultiStep` within a life (a test holds it), without its overhead.
    """
    once = discount * (~terminated).to(reward.dtype)
    total, reached, bootstrap = reward.clone(), following.clone(), once.clone()
    for ahead in range(1, min(steps, len(reward))):
        alive = valid[ahead:]
        total[:-ahead] += torch.where(alive, bootstrap[:-ahead] * reward[ahead:], 0.0)
        reached[:-ahead] = torch.where(alive.unsqueeze(-1), following[ahead:], reached[:-ahead])
        bootstrap[:-ahead] = torch.where(alive, bootstrap[:-ahead] * once[ahead:], bootstrap[:-ahead])
    return total, reached, bootstrap


class _Step(NamedTuple):
    """One decision of every cell (worlds, cells, ...)."""

    observation: Tensor  # that it was made on
    action: Tensor
    reward: Tensor
    terminated: Tensor
    valid: Tensor


class Explorer:
    """Steers a `SwarmEnv` whose worlds are shared out among seeds, and hands over what happened."""

    def __init__(
        self, env: SwarmEnv, *, discount: float = 1.0, n_steps: int = 1, compile: bool = False
    ) -> None:
        self.env, self.discount, self.n_steps = env, discount, n_steps
        self._choose = compiled(epsilon_greedy) if compile else epsilon_greedy
        self.seeds = env.seeds
        self.cells = env.n_worlds // len(env.seeds) * env.n_swimmers  # of each seed
        self._steps: list[_Step] = []  # of this life, whose returns still wait for later rewards

    def restart(self) -> None:
        """Begin the next life of every cell."""
        self.env.restart()
        self._steps.clear()

    def _by_seed(self, values: Tensor) -> Tensor:
        """(worlds, cells, ...) -> (seeds, cells of the seed, ...)."""
        return values.reshape(len(self.seeds), self.cells, *values.shape[2:])

    def _luck(self) -> tuple[Tensor, Tensor]:
        """Each cell's own number in [0, 1) and random action for this decision (seeds, cells), drawn by the
        block.
        """
        block, place = divmod(int(self.env.decision[0]), BLOCK)
        if place == 0:
            device, episode = self.env.device or torch.device("cpu"), int(self.env.episode[0])
            draws = []
            for seed in self.seeds:
                key = streams.integer_seed("training", "exploration", seed, episode, block)
                generator = torch.Generator(device).manual_seed(key)
                draws.append(torch.rand(2, BLOCK, self.cells, generator=generator, device=device))
            self._coins, choices = torch.stack(draws, dim=2)
            self._random = (choices * self.env.world.n_actions).long()
        return self._coins[place], self._random[place]

    def collect(self, network: QNetwork, epsilon: float, decisions: int) -> Tensor:
        """Up to `decisions` decisions of every cell, fewer when all lives end.

        With probability ε a uniformly random action, else the best (paper: ε-greedy). Returns the packed
        transitions (rows, seeds, width) that are complete, `cells` rows for each decision: the last
        `n_steps` − 1 decisions wait for the next call, unless all lives ended. Rows of cells that were done
        before are not `valid`.
        """
        env, ended = self.env, False
        for _ in range(decisions):
            assert env.observation is not None
            observation = env.observation
            coin, random_action = self._luck()
            action = self._choose(network, self._by_seed(observation), coin < epsilon, random_action)
            action = action.reshape(observation.shape[:2])
            result = env.advance(action)
            self._steps.append(_Step(observation, action, result.reward, result.terminated, result.valid))
            if ended := env.all_finished():
                break
        complete = max(0, len(self._steps) - (0 if ended else self.n_steps - 1))
        rows = self._transitions(complete).packed()
        self._steps = self._steps[complete:]
        # (decisions, worlds, cells, ...) -> (decisions, seeds, cells of the seed, ...)
        by_seed = rows.reshape(len(rows), len(self.seeds), self.cells, rows.shape[-1])
        return by_seed.transpose(1, 2).flatten(0, 1)

    def _transitions(self, complete: int) -> Transitions:
        """The first `complete` of the steps (decisions, worlds, cells)."""
        assert self.env.observation is not None
        observations, *others = zip(*self._steps, strict=True)
        seen = torch.stack([*observations, self.env.observation])
        action, reward, terminated, valid = map(torch.stack, others)
        total, following, bootstrap = multi_step(
            reward.to(torch.float32),
            seen[1:],
            terminated,
            valid,
            discount=self.discount,
            steps=self.n_steps,
        )
        parts = (seen[:-1], following, action, total, bootstrap, valid)
        return Transitions(*(part[:complete] for part in parts))

    def gains(self) -> Tensor:
        """Gain (seeds, cells) of the lives so far."""
        return self._by_seed(self.env.gain())
