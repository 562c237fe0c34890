"""Training against a plain PyTorch loop: the same work, the same goal, many seeds at once, the first step.

- Same work: an epoch of `linear_n4` as shipped against a loop of plain tensors, nn.Module, autograd and fused
  Adam that makes the same decisions and as many updates of the same size; and what ours would be made of
  with TorchRL's own parts.
- Same goal: training time, without validation, until the greedy policy passes 97% and 99% of the limit.
- Many seeds: an epoch of 16 independent seeds at once against an epoch of one.

Run with `python -m benchmarks.training_path [--out FILE.json]`.
"""

from __future__ import annotations

import argparse
import itertools
import json
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.data import Categorical, LazyTensorStorage, TensorDictReplayBuffer
from torchrl.modules import QValueActor
from torchrl.objectives import DQNLoss, SoftUpdate

from benchmarks.timing import best_times
from swarm.starts import draw_starts
from swarm.world import State
from trainers.composing import settings_from
from trainers.dqn import dqn_loss
from trainers.settings import Settings
from trainers.training import Training

SAME_WORK, MANY_SEEDS = 1.2, 5.0  # targets: ratio to the plain loop, 16 seeds to one
SEEDS = 16
MARKS = (0.97, 0.99)


class PlainLoop:
    """The loop one would write by hand: tensors for a buffer, modules, autograd, Polyak by foreach."""

    def __init__(self, settings: Settings) -> None:
        self.learning = learning = settings.learning
        self.world = world = settings.training_world()
        torch.manual_seed(0)
        self.online, self.target = self._network(), self._network()
        self.target.load_state_dict(self.online.state_dict())
        self.optimiser = torch.optim.Adam(self.online.parameters(), lr=learning.learning_rate, fused=True)
        size, inputs = learning.buffer_size, world.observation_size
        self.seen, self.next = torch.zeros(size, inputs), torch.zeros(size, inputs)
        self.action = torch.zeros(size, dtype=torch.int64)
        self.reward, self.bootstrap = torch.zeros(size), torch.zeros(size)
        self.filled = self.place = self.episode = 0

    def _network(self) -> nn.Module:
        sizes = (self.world.observation_size, *self.learning.hidden, self.world.n_actions)
        layers: list[nn.Module] = []
        for inputs, outputs in itertools.pairwise(sizes):
            layers += [nn.Linear(inputs, outputs), nn.Tanh()]
        return nn.Sequential(*layers[:-1])

    def start(self) -> State:
        starts = draw_starts(
            self.world, self.learning.n_swimmers, 0, population="training", episode=self.episode
        )
        self.episode += 1
        position, heading = (torch.as_tensor(part, dtype=torch.float32) for part in starts[:2])
        return self.world.start(position, heading, torch.as_tensor(starts.past))

    def epoch(self) -> None:
        """One life of every cell with its rounds of updates."""
        learning, world = self.learning, self.world
        with torch.no_grad():
            state = self.start()
            observation = world.observation(state)
        left = world.max_decisions
        while left:
            decisions = min(learning.collect, left)
            left -= decisions
            with torch.no_grad():
                state, observation = self.collect(state, observation, decisions)
            for _ in range(learning.updates):
                self.update()

    def collect(self, state: State, observation: Tensor, decisions: int) -> tuple[State, Tensor]:
        learning, world = self.learning, self.world
        seen, actions, rewards = [observation], [], []
        for _ in range(decisions):
            best = self.online(seen[-1]).argmax(-1)
            explores = torch.rand(len(best)) < 0.1
            action = torch.where(explores, torch.randint(world.n_actions, best.shape), best)
            state, outcome = world.step(state, action)
            seen.append(outcome.observation)
            actions.append(action)
            rewards.append(outcome.reward)
        reward, following = torch.stack(rewards), torch.stack(seen[1:])
        bootstrap = torch.full_like(reward, learning.discount)
        total = reward.clone()
        for ahead in range(1, min(learning.n_steps, decisions)):
            total[:-ahead] += bootstrap[:-ahead] * reward[ahead:]
            following[:-ahead] = torch.stack(seen[1 + ahead :])
            bootstrap[:-ahead] *= learning.discount
        rows = decisions * reward.shape[1]
        places = (self.place + torch.arange(rows)) % learning.buffer_size
        self.seen[places], self.next[places] = torch.stack(seen[:-1]).flatten(0, 1), following.flatten(0, 1)
        self.action[places] = torch.stack(actions).flatten()
        self.reward[places], self.bootstrap[places] = total.flatten(), bootstrap.flatten()
        self.place = (self.place + rows) % learning.buffer_size
        self.filled = min(self.filled + rows, learning.buffer_size)
        return state, seen[-1]

    def update(self) -> None:
        learning = self.learning
        rows = torch.randint(self.filled, (learning.batch_size,))
        following = self.next[rows]
        with torch.no_grad():
            choice = self.online(following).argmax(-1, keepdim=True)
            best = self.target(following).gather(-1, choice).squeeze(-1)
            goal = self.reward[rows] + self.bootstrap[rows] * best
        value = self.online(self.seen[rows]).gather(-1, self.action[rows, None]).squeeze(-1)
        loss = nn.functional.smooth_l1_loss(value, goal)
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        with torch.no_grad():
            torch._foreach_lerp_(
                list(self.target.parameters()), list(self.online.parameters()), learning.target_rate
            )


class StockUpdate:
    """One update from TorchRL's own parts."""

    def __init__(self, settings: Settings) -> None:
        plain = PlainLoop(settings)
        learning, inputs = settings.learning, plain.world.observation_size
        module = TensorDictModule(plain.online, in_keys=["observation"], out_keys=["action_value"])
        actor = QValueActor(
            module,
            spec=Categorical(plain.world.n_actions),
            in_keys=["observation"],
            action_space="categorical",
        )
        self.loss = DQNLoss(actor, action_space="categorical", double_dqn=True, delay_value=True)
        self.loss.make_value_estimator(gamma=learning.discount)
        self.follow = SoftUpdate(self.loss, tau=learning.target_rate)
        self.optimiser = torch.optim.Adam(self.loss.parameters(), lr=learning.learning_rate)
        self.buffer = TensorDictReplayBuffer(
            storage=LazyTensorStorage(learning.buffer_size), batch_size=learning.batch_size
        )
        rows = 10_000
        flags = {
            "terminated": torch.zeros(rows, 1, dtype=torch.bool),
            "done": torch.zeros(rows, 1, dtype=torch.bool),
        }
        following = {"observation": torch.randn(rows, inputs), "reward": torch.randn(rows, 1), **flags}
        data = {
            "observation": torch.randn(rows, inputs),
            "action": torch.randint(2, (rows,)),
            "next": following,
        }
        self.buffer.extend(TensorDict(data, batch_size=rows))

    def update(self) -> None:
        loss = self.loss(self.buffer.sample())["loss"]
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        self.follow.step()


def shipped(n_seeds: int = 1, *words: str) -> Training:
    """`linear_n4` as shipped, without validation."""
    training = Training(
        settings_from(["experiment=linear_n4", f"n_seeds={n_seeds}", "compile=never", *words])
    )
    training._validate = lambda: np.full(n_seeds, np.nan)  # type: ignore[method-assign]
    return training


def same_work(seconds: float) -> list[dict[str, Any]]:
    """Epochs and updates of each kind."""
    ours, plain = shipped(1, "learning.epochs=100000"), PlainLoop(settings_from(["experiment=linear_n4"]))
    stock = StockUpdate(settings_from(["experiment=linear_n4"]))

    @torch.inference_mode()
    def our_epoch() -> None:
        ours.run_epoch()
        ours.measures = ours.measures[:0]

    our_epoch()
    plain.epoch()
    learner = ours.learner

    @torch.inference_mode()
    def our_update() -> None:
        batch = learner.buffer.sample(learner.settings.batch_size)
        learner.online.flat.grad = dqn_loss(
            learner.online, learner.target, batch, double=True, kind="huber"
        ).gradient
        learner.optimiser.step()
        learner.target.flat.lerp_(learner.online.flat, 0.02)

    epochs = best_times({"ours": our_epoch, "plain": plain.epoch}, seconds=seconds)
    updates = best_times(
        {"ours": our_update, "plain": plain.update, "torchrl": stock.update}, seconds=seconds
    )
    return [
        {
            "what": "epoch, ours",
            "seconds": epochs["ours"],
            "ratio": epochs["ours"] / epochs["plain"],
            "at_most": SAME_WORK,
        },
        {"what": "epoch, plain loop", "seconds": epochs["plain"], "ratio": 1.0, "at_most": None},
        {
            "what": "update, ours",
            "seconds": updates["ours"],
            "ratio": updates["ours"] / updates["plain"],
            "at_most": None,
        },
        {"what": "update, autograd", "seconds": updates["plain"], "ratio": 1.0, "at_most": None},
        {
            "what": "update, TorchRL's parts",
            "seconds": updates["torchrl"],
            "ratio": updates["torchrl"] / updates["plain"],
            "at_most": None,
        },
    ]


def many_seeds(seconds: float) -> list[dict[str, Any]]:
    """An epoch of sixteen seeds against an epoch of one."""
    stacks = {count: shipped(count, "learning.epochs=100000") for count in (1, SEEDS)}

    def epoch(training: Training) -> Any:
        @torch.inference_mode()
        def call() -> None:
            training.run_epoch()
            training.measures = training.measures[:0]

        return call

    times = best_times({str(count): epoch(stack) for count, stack in stacks.items()}, seconds=seconds)
    ratio = times[str(SEEDS)] / times["1"]
    return [
        {"what": f"epoch, {SEEDS} seeds", "seconds": times[str(SEEDS)], "ratio": ratio, "at_most": MANY_SEEDS}
    ]


@torch.inference_mode()
def time_to_marks(experiment: str, seed: int) -> list[float]:
    """Training time of one seed until each mark is passed, looked at after every third round of updates."""
    training = Training(settings_from([f"experiment={experiment}", f"seed={seed}", "compile=never"]))
    validation, learn = training.validation, training.learner.learn
    assert validation.limits is not None
    limit, reached = float(validation.limits[0]), [float("inf")] * len(MARKS)
    spent, rounds, begun = 0.0, 0, perf_counter()

    def watched(rate: Any) -> Any:
        nonlocal spent, rounds, begun
        result = learn(rate)
        spent += perf_counter() - begun
        rounds += 1
        if rounds % 3 == 0:
            part = float(validation.gains(training.learner.online)[0]) / limit
            for place, mark in enumerate(MARKS):
                if part > mark:
                    reached[place] = min(reached[place], spent)
        begun = perf_counter()
        return result

    training.learner.learn = watched  # type: ignore[method-assign]
    training._validate = lambda: np.full(1, np.nan)  # type: ignore[method-assign]
    while training.epoch < training.settings.learning.epochs and max(reached) == float("inf"):
        training.run_epoch()
    return reached


def same_goal(experiment: str, seeds: int = 5) -> list[dict[str, Any]]:
    """Medians over seeds of the training time to each mark."""
    times = np.array([time_to_marks(experiment, seed) for seed in range(seeds)])
    return [
        {
            "what": f"{experiment}: seconds to {mark:.0%} of the limit, median of {seeds} seeds",
            "seconds": float(np.median(times[:, place])),
            "ratio": None,
            "at_most": None,
        }
        for place, mark in enumerate(MARKS)
    ]


def run(seconds: float = 6.0) -> list[dict[str, Any]]:
    """All rows, printed as a table."""
    torch.set_num_threads(1)
    rows = same_work(seconds) + many_seeds(2 * seconds)
    for experiment in ("linear_n4", "linear_n8"):
        rows += same_goal(experiment)
    print(f"{'':66s}{'seconds':>10s}{'ratio':>8s}{'at most':>9s}")
    for row in rows:
        ratio = "" if row["ratio"] is None else f"{row['ratio']:.2f}"
        most = "" if row["at_most"] is None else f"{row['at_most']:.1f}"
        print(f"{row['what']:66s}{row['seconds']:10.4f}{ratio:>8s}{most:>9s}")
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="write the rows as JSON")
    parser.add_argument("--seconds", type=float, default=6.0, help="time for each comparison")
    options = parser.parse_args()
    table = run(options.seconds)
    if options.out:
        options.out.write_text(json.dumps(table, indent=1))
