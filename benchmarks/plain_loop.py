"""What training is measured against: a plain PyTorch loop, and an update made of TorchRL's own parts."""

from __future__ import annotations

import itertools

import numpy as np
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.data import Categorical, LazyTensorStorage, TensorDictReplayBuffer
from torchrl.modules import QValueActor
from torchrl.objectives import DQNLoss, SoftUpdate

from swarm.physics.starts import draw_starts
from swarm.physics.world import State
from trainers.settings.schema import Settings


class PlainLoop:
    """The loop one would write by hand: cells in NumPy, buffer in tensors, autograd, Polyak by foreach."""

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
        position, heading = (part.astype(np.float32) for part in starts[:2])
        return self.world.start(position, heading, starts.past)

    def epoch(self) -> None:
        """One life of every cell with its rounds of updates."""
        learning, world = self.learning, self.world
        with torch.no_grad():
            state = self.start()
            observation = torch.from_numpy(world.observation(state))
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
            state, outcome = world.step(state, action.numpy())
            seen.append(torch.from_numpy(outcome.observation))
            actions.append(action)
            rewards.append(torch.from_numpy(outcome.reward))
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
