"""Deep Q-learning for a stack of independent seeds: replay, loss, optimiser and target network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.data.replay_buffers.samplers import Sampler

from swarm import streams
from trainers.q_network import QNetwork
from trainers.settings import LearningSettings


class LossOutcome(NamedTuple):
    """What one batch says."""

    loss: Tensor  # (seeds,)
    value: Tensor  # (seeds,) mean of the chosen actions' values
    gradient: Tensor  # (seeds, parameters)


def dqn_loss(
    online: QNetwork, target: QNetwork, batch: Mapping[str, Tensor], *, double: bool, kind: str
) -> LossOutcome:
    """The DQN loss (paper: loss function; van Hasselt et al. 2016 with `double`) and its gradient.

    `batch` (seeds, rows): `observation`, `next_observation` (…, inputs), `action`, `reward`, `bootstrap`, by
    which the next value counts (γ, 0 after a termination; a life cut short by time is none), and `valid`, the
    rows that count. Equal to `torchrl.objectives.DQNLoss` where every row is valid (a test holds
    it), without its overhead.
    """
    following = target.values(batch["next_observation"])
    if double:
        chooser = following if online is target else online.values(batch["next_observation"])
        best = following.gather(-1, chooser.argmax(-1, keepdim=True)).squeeze(-1)
    else:
        best = following.amax(-1)
    goal = batch["reward"] + batch["bootstrap"] * best
    layers = online.layers(batch["observation"])
    action = batch["action"].unsqueeze(-1)
    value = layers[-1].gather(-1, action).squeeze(-1)
    error = value - goal
    weight = batch["valid"] / batch["valid"].sum(-1, keepdim=True).clamp(min=1)
    if kind == "huber":
        inner = error.clamp(-1, 1)
        loss, slope = inner * (error - 0.5 * inner), inner
    else:
        loss, slope = error * error, 2 * error
    slope = torch.zeros_like(layers[-1]).scatter_(-1, action, (slope * weight).unsqueeze(-1))
    return LossOutcome((loss * weight).sum(-1), (value * weight).sum(-1), online.gradient(layers, slope))


class SeedSampler(Sampler):
    """Uniform rows for every seed from its own generator: TorchRL storage with items (seeds, …) -> (seeds,
    rows, …).
    """

    def __init__(self, generators: list[torch.Generator]) -> None:
        super().__init__()
        self.generators = generators
        self._seed = torch.arange(len(generators))[:, None]

    def sample(self, storage: Any, batch_size: int) -> tuple[Any, dict]:
        """Rows (seeds, batch_size), with replacement."""
        rows = [torch.randint(len(storage), (batch_size,), generator=each) for each in self.generators]
        return (torch.stack(rows), self._seed), {}

    def _empty(self) -> None: ...

    def dumps(self, path: Any) -> None: ...

    def loads(self, path: Any) -> None: ...

    def state_dict(self) -> dict:
        """Nothing: the learner names every draw by a counter."""
        return {}

    def load_state_dict(self, state_dict: dict) -> None: ...


class Learner:
    """Networks, optimiser and replay buffer of all seeds."""

    def __init__(
        self, n_inputs: int, n_actions: int, settings: LearningSettings, seeds: list[int], device: str = "cpu"
    ) -> None:
        self.settings, self.seeds, self.device = settings, seeds, torch.device(device)
        generators = [
            torch.Generator().manual_seed(streams.integer_seed("training", "network", seed)) for seed in seeds
        ]
        self.online = QNetwork.create((n_inputs, *settings.hidden, n_actions), generators, device)
        self.target = self.online.copy() if settings.target_rate < 1 else self.online
        self.played = self.online.copy() if settings.average_rate < 1 else self.online
        self.optimiser = torch.optim.Adam([self.online.flat], lr=settings.learning_rate, fused=True)
        self._draws = [torch.Generator() for _ in seeds]
        self.buffer = ReplayBuffer(
            storage=LazyTensorStorage(settings.buffer_size, device=device), sampler=SeedSampler(self._draws)
        )
        self.rounds = 0  # rounds of updates so far, which name their draws
        self.updates = 0

    def remember(self, rows: TensorDict) -> None:
        """Put transitions (rows, seeds) into the buffer."""
        self.buffer.extend(rows)

    def refill(self, stored: dict[str, Tensor], cursor: int) -> None:
        """Put back what `buffer[:]` gave; the next transition goes to place `cursor`."""
        length = len(next(iter(stored.values())))
        self.buffer.empty()
        self.buffer.extend(TensorDict(stored, batch_size=(length, len(self.seeds))))
        self.buffer.writer.load_state_dict({"_cursor": cursor})

    def learn(self, learning_rate: Any) -> tuple[Tensor, Tensor]:
        """One round of updates; `learning_rate` maps the count of updates to a rate. Returns loss and value
        (seeds,).
        """
        settings = self.settings
        for draws, seed in zip(self._draws, self.seeds, strict=True):
            draws.manual_seed(streams.integer_seed("training", "replay", seed, self.rounds))
        # Plain tensors: every look into a TensorDict takes as long as a small operation.
        sampled = dict(self.buffer.sample(settings.updates * settings.batch_size).items())
        outcome = None
        for first in range(0, settings.updates * settings.batch_size, settings.batch_size):
            rows = slice(first, first + settings.batch_size)
            batch = {name: values[:, rows] for name, values in sampled.items()}
            outcome = dqn_loss(self.online, self.target, batch, double=settings.double, kind=settings.loss)
            self.online.flat.grad = outcome.gradient
            self.optimiser.param_groups[0]["lr"] = learning_rate(self.updates)
            self.optimiser.step()
            self.updates += 1
            for follower, rate in ((self.target, settings.target_rate), (self.played, settings.average_rate)):
                if follower is not self.online:
                    follower.flat.lerp_(self.online.flat, rate)
        self.rounds += 1
        assert outcome is not None
        return outcome.loss, outcome.value
