"""Deep Q-learning for a stack of independent seeds: replay, loss, optimiser and target network."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.optim.adam import adam
from torchrl.data import LazyTensorStorage, ReplayBuffer

from swarm._support import streams
from trainers.algorithms.q_network import QNetwork
from trainers.algorithms.transitions import Transitions
from trainers.settings.learning import DQNSettings


class LossOutcome(NamedTuple):
    """What one batch says; what is only looked at is computed when it is."""

    error: Tensor  # (seeds, rows) value of the chosen action less its target
    slope: Tensor  # (seeds, rows) of a row's loss by the value
    chosen: Tensor  # (seeds, rows) value of the chosen action
    weight: Tensor  # (seeds, rows) of a row in the means: 1 / valid rows, or 0
    gradient: Tensor  # (seeds, parameters)
    kind: str

    @property
    def loss(self) -> Tensor:
        """Mean loss (seeds,)."""
        huber = self.kind == "huber"
        each = self.slope * (self.error - 0.5 * self.slope) if huber else self.error * self.error
        return (each * self.weight).sum(-1)

    @property
    def value(self) -> Tensor:
        """Mean value (seeds,) of the chosen actions."""
        return (self.chosen * self.weight).sum(-1)


def dqn_loss(
    online: QNetwork, target: QNetwork, batch: Transitions, *, double: bool, kind: str
) -> LossOutcome:
    """The DQN loss (paper: loss function; van Hasselt et al. 2016 with `double`) and its gradient.

    `batch` (seeds, rows); rows that are not valid count for nothing. Equal to `torchrl.objectives.DQNLoss`
    where every row is valid (a test holds it), without its overhead.
    """
    following = target.values(batch.next_observation)
    chooser = following
    if double and online is not target:
        chooser = online.values(batch.next_observation)
    best = following.gather(-1, chooser.argmax(-1, keepdim=True)).squeeze(-1)
    layers = online.layers(batch.observation)
    action = batch.action.unsqueeze(-1)
    chosen = layers[-1].gather(-1, action).squeeze(-1)
    error = chosen - torch.addcmul(batch.reward, batch.bootstrap, best)
    weight = batch.valid / batch.valid.sum(-1, keepdim=True).clamp_(min=1)
    slope = error.clamp(-1, 1) if kind == "huber" else 2 * error
    slopes = torch.zeros_like(layers[-1]).scatter_(-1, action, (slope * weight).unsqueeze(-1))
    return LossOutcome(error, slope, chosen, weight, online.gradient(layers, slopes), kind)


class Learner:
    """Networks, optimiser and replay buffer of all seeds."""

    def __init__(
        self, n_inputs: int, n_actions: int, settings: DQNSettings, seeds: list[int], device: str = "cpu"
    ) -> None:
        self.settings, self.seeds, self.device = settings, seeds, torch.device(device)
        generators = [
            torch.Generator().manual_seed(streams.integer_seed("training", "network", seed)) for seed in seeds
        ]
        self.online = QNetwork.create((n_inputs, *settings.hidden, n_actions), generators, device)
        self.target = self.online.copy() if settings.target_rate < 1 else self.online
        self.played = self.online.copy() if settings.average_rate < 1 else self.online
        self.moments = {  # of Adam
            "step": torch.zeros((), device=self.device),
            "exp_avg": torch.zeros_like(self.online.flat),
            "exp_avg_sq": torch.zeros_like(self.online.flat),
        }
        self.rate = settings.learning_rate  # of the last update
        self.buffer = ReplayBuffer(storage=LazyTensorStorage(settings.buffer_size, device=device))
        self._draws = [torch.Generator(self.device) for _ in seeds]
        self._places = torch.arange(len(seeds), device=self.device)[:, None]
        self.updates = 0

    def begin(self, epoch: int) -> None:
        """Draw rows for epoch number `epoch` from now on, the same whatever was drawn before."""
        for draws, seed in zip(self._draws, self.seeds, strict=True):
            draws.manual_seed(streams.integer_seed("training", "replay", seed, epoch))

    def remember(self, rows: Tensor) -> None:
        """Put packed transitions (rows, seeds, width) into the buffer."""
        self.buffer.extend(rows)

    def refill(self, rows: Tensor, cursor: int) -> None:
        """Put back what `buffer[:]` gave; the next transition goes to place `cursor`."""
        self.buffer.empty()
        self.buffer.extend(rows)
        self.buffer.writer.load_state_dict({"_cursor": cursor})

    def sample(self, rows: int) -> Transitions:
        """Transitions (seeds, rows), drawn uniformly with replacement for every seed by its own generator."""
        length, seeds = len(self.buffer), len(self.seeds)
        drawn = [torch.randint(length, (rows,), generator=each, device=self.device) for each in self._draws]
        places = (torch.stack(drawn) * seeds + self._places).flatten()
        stored = self.buffer[:].flatten(0, 1)  # views
        return Transitions.unpacked(stored.index_select(0, places).unflatten(0, (seeds, rows)))

    def descend(self, gradient: Tensor) -> None:
        """One step of Adam (Kingma and Ba 2015) along `gradient` (seeds, parameters).

        Torch's function, not its optimiser, which looks longer at a single tensor than it takes to change it.
        """
        adam(
            [self.online.flat],
            [gradient],
            [self.moments["exp_avg"]],
            [self.moments["exp_avg_sq"]],
            [],
            [self.moments["step"]],
            fused=True,
            amsgrad=False,
            beta1=0.9,
            beta2=0.999,
            lr=self.rate,
            weight_decay=0.0,
            eps=1e-8,
            maximize=False,
        )

    def learn(self, learning_rate: Any) -> tuple[Tensor, Tensor]:
        """One round of updates; `learning_rate` maps the count of updates to a rate. Returns loss and value
        (seeds,).
        """
        settings = self.settings
        outcome = None
        for batch in self.sample(settings.updates * settings.batch_size).batches(settings.batch_size):
            outcome = dqn_loss(self.online, self.target, batch, double=settings.double, kind=settings.loss)
            self.rate = learning_rate(self.updates)
            self.descend(outcome.gradient)
            self.updates += 1
            for follower, rate in ((self.target, settings.target_rate), (self.played, settings.average_rate)):
                if follower is not self.online:
                    follower.flat.lerp_(self.online.flat, rate)
        assert outcome is not None
        return outcome.loss, outcome.value
