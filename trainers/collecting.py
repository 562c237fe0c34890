"""Collecting transitions: ε-greedy decisions of every cell of every seed.

The rollout is our own: TorchRL's Collector costs several times the decision itself for worlds this cheap
(`benchmarks/training_path.py`), and a stack of seeds needs a policy and an ε coin per seed.
"""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torch import Tensor

from swarm import streams
from swarm.torchrl_env import SwarmEnv, compiled
from trainers.q_network import QNetwork


def epsilon_greedy(network: QNetwork, observation: Tensor, explores: Tensor, random_action: Tensor) -> Tensor:
    """Actions (seeds, cells): random where the cell explores, else the best (paper: ε-greedy)."""
    return torch.where(explores, random_action, network.values(observation).argmax(-1))


def multi_step(
    reward: Tensor, following: Tensor, terminated: Tensor, valid: Tensor, *, discount: float, steps: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Returns over up to `steps` decisions: reward, observation they lead to, and what its value counts for.

    All (decisions, ...), observations (decisions, ..., inputs). Sums γᵏ r until the life or the round of
    collecting ends; the last factor is γᵏ, 0 after a termination (Sutton and Barto 2018, eq. 7.1). The same
    as TorchRL's `MultiStep` within a life (a test holds it), without its overhead.
    """
    once = discount * (~terminated).to(reward.dtype)
    total, reached, bootstrap = reward.clone(), following.clone(), once.clone()
    for ahead in range(1, min(steps, len(reward))):
        alive = valid[ahead:]
        total[:-ahead] += torch.where(alive, bootstrap[:-ahead] * reward[ahead:], 0.0)
        reached[:-ahead] = torch.where(alive.unsqueeze(-1), following[ahead:], reached[:-ahead])
        bootstrap[:-ahead] = torch.where(alive, bootstrap[:-ahead] * once[ahead:], bootstrap[:-ahead])
    return total, reached, bootstrap


class Explorer:
    """Steers a `SwarmEnv` whose worlds are shared out among seeds, and hands over what happened."""

    def __init__(
        self, env: SwarmEnv, *, discount: float = 1.0, n_steps: int = 1, compile: bool = False
    ) -> None:
        self.env, self.discount, self.n_steps = env, discount, n_steps
        self._choose = compiled(epsilon_greedy) if compile else epsilon_greedy
        self.seeds = env.seeds
        self.cells = env.n_worlds // len(env.seeds) * env.n_swimmers  # of each seed
        self.rounds = 0  # which name the draws

    def _by_seed(self, values: Tensor) -> Tensor:
        """(worlds, cells, ...) -> (seeds, cells of the seed, ...)."""
        return values.reshape(len(self.seeds), self.cells, *values.shape[2:])

    def _uniform(self, decisions: int) -> Tensor:
        """Each cell's own two numbers in [0, 1) per decision (decisions, 2, seeds, cells)."""
        device = self.env.device or torch.device("cpu")
        draws = []
        for seed in self.seeds:
            key = streams.integer_seed("training", "exploration", seed, self.rounds)
            generator = torch.Generator(device).manual_seed(key)
            draws.append(torch.rand(decisions, 2, self.cells, generator=generator, device=device))
        return torch.stack(draws, dim=2)

    def collect(self, network: QNetwork, epsilon: float, decisions: int) -> TensorDict:
        """Up to `decisions` decisions of every cell, fewer when all lives end; rows (decisions · cells,
        seeds).

        With probability ε a uniformly random action, else the best (paper: ε-greedy). Rows of cells that were
        done before are not `valid`.
        """
        env, m = self.env, self.env.world.n_actions
        coin, choice = self._uniform(decisions).unbind(1)
        self.rounds += 1
        explores, random_action = coin < epsilon, (choice * m).long()
        assert env.observation is not None
        observations, actions, rewards, terminations, valid = [self._by_seed(env.observation)], [], [], [], []
        for decision in range(decisions):
            action = self._choose(network, observations[-1], explores[decision], random_action[decision])
            result = env.advance(action.reshape(env.n_worlds, env.n_swimmers))
            observations.append(self._by_seed(result.observation))
            actions.append(action)
            rewards.append(self._by_seed(result.reward))
            terminations.append(self._by_seed(result.terminated))
            valid.append(self._by_seed(result.valid))
            if self.everyone_done():
                break
        seen = torch.stack(observations)
        lives = torch.stack(valid)
        reward, following, bootstrap = multi_step(
            torch.stack(rewards).to(torch.float32),
            seen[1:],
            torch.stack(terminations),
            lives,
            discount=self.discount,
            steps=self.n_steps,
        )

        def rows(values: Tensor) -> Tensor:
            # (decisions, seeds, cells, ...) -> (decisions · cells, seeds, ...)
            return values.transpose(1, 2).flatten(0, 1)

        return TensorDict(
            {
                "observation": rows(seen[:-1]),
                "next_observation": rows(following),
                "action": rows(torch.stack(actions)),
                "reward": rows(reward),
                "bootstrap": rows(bootstrap),
                "valid": rows(lives.to(torch.float32)),
            },
            batch_size=(len(actions) * self.cells, len(self.seeds)),
        )

    def everyone_done(self) -> bool:
        """Whether every life has ended."""
        assert self.env.state is not None
        return bool(self.env.state.finished.all())

    def gains(self) -> Tensor:
        """Gain (seeds, cells) of the lives so far."""
        return self._by_seed(self.env.gain())
