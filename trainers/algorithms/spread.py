"""Spread collecting: the decisions of blocks of cells are tasks, wherever these are done.

What a task finds is a pure function of what it is given: settings, block, policy, the cells' state, a number
of decisions. Blocks have a fixed size and are put together in their order, so that no bit depends on who did
which, how many did them, or how often one had to be begun again.
"""

import copy
import pickle
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NamedTuple

import numpy as np
import torch
from tensordict import TensorDict
from torch import nn
from torchrl.envs import EnvBase

from trainers.algorithms.collector import SeedCollector, training_env
from trainers.settings.learning import LearningSettings
from trainers.settings.schema import Settings

Arrays = dict[str, np.ndarray]
Submit = Callable[..., Future]  # of an executor

SEEN, FOLLOWS, ALIVE = "observation", "next.observation", "collector.mask"
HIDDEN = "hidden"  # attribute of policies that remember something of each cell
OVER = {"next.reward": 0.0, "next.terminated": False, "next.done": True, ALIVE: False}  # all lives


class Block(NamedTuple):
    """Cells that decide in one task: of every seed some whole worlds, or a part of one."""

    number: int
    worlds: tuple[int, int]  # of each seed: the first, and the one after the last
    cells: tuple[int, int]  # of each of these worlds
    n_swimmers: int  # of a whole world

    @property
    def first(self) -> int:
        """Its first row in the population of a seed."""
        return self.worlds[0] * self.n_swimmers + self.cells[0]

    @property
    def columns(self) -> slice:
        """Its rows in the population of a seed."""
        return slice(self.first, (self.worlds[1] - 1) * self.n_swimmers + self.cells[1])

    def of(self, whole: np.ndarray) -> np.ndarray:
        """The view of what is the block's of an array (seeds, worlds, ...)."""
        part = whole[:, slice(*self.worlds)]
        whole_worlds = self.cells == (0, self.n_swimmers)
        return part if whole_worlds or whole.ndim < 3 else part[:, :, slice(*self.cells)]


def blocks_of(learning: LearningSettings) -> list[Block]:
    """Blocks of `learning.block` cells of each seed at most."""
    size, cells, worlds = learning.block, learning.n_swimmers, learning.n_worlds
    several = max(size // cells, 1)
    parts = [(first, min(first + size, cells)) for first in range(0, cells, size)]
    places = [((w, min(w + several, worlds)), part) for w in range(0, worlds, several) for part in parts]
    return [Block(number, *place, cells) for number, place in enumerate(places)]


def collected(
    settings: Settings, block: Block, policy: nn.Module, state: Arrays, decisions: int
) -> tuple[Arrays, Arrays]:
    """Up to `decisions` decisions of a block's cells, fewer where all their lives end, by a policy that stays
    as it is: the rollout (decisions, seeds, cells, ...), of `observation` one more, what follows the last;
    and the state (seeds · worlds, ...) after them.
    """
    (first, end), (left, right) = block.worlds, block.cells
    env = training_env(settings, end - first, right - left, first=block.first)
    device = env.device or "cpu"
    before = {name: torch.from_numpy(each.copy()).to(device) for name, each in state.items()}
    steering: Any = copy.deepcopy(policy).to(device)
    hidden = before.pop(HIDDEN, None)
    env.load_state_dict_of_env(before)
    if hidden is not None:
        steering.hidden = hidden.reshape(len(settings.seeds), -1, *hidden.shape[2:])
    flat = SeedCollector(env, steering, block.number).collect(decisions).flatten_keys(".")
    rollout = {name: _array(each) for name, each in flat.items()}
    rollout[SEEN] = np.concatenate([rollout[SEEN], rollout.pop(FOLLOWS)[-1:]])
    after = {name: _array(each) for name, each in env.state_dict_of_env().items()}
    after |= {} if hidden is None else {HIDDEN: _array(steering.hidden).reshape(hidden.shape)}
    return rollout, after


class Here(Future):
    """The outcome of a task that is done in this process, when it is asked for."""

    def __init__(self, *task: Any) -> None:
        super().__init__()
        self._task = task

    def result(self, timeout: float | None = None) -> Any:
        do, *arguments = self._task
        return do(*arguments)


def check_portable(policy: nn.Module) -> nn.Module:
    """Return what decides; raises ValueError unless it can go to another process, without its environment."""
    try:
        if any(isinstance(each, EnvBase) for each in policy.modules()):
            raise TypeError("holds its environment")
        pickle.dumps(policy)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        rule = "a policy must be one that pickle takes where learning.block collects by tasks"
        raise ValueError(f"{rule}, got {type(policy).__name__}: {error}") from None
    return policy


class SpreadCollector(SeedCollector):
    """Does what another collector does, by tasks for `submit`.

    With `learning.staleness`, each round of decisions but the first of a life is begun when the one before
    has ended: while that is learnt from, by the policy of before.
    """

    def __init__(self, whole: SeedCollector | None, settings: Settings, submit: Submit = Here) -> None:
        if type(whole) is not SeedCollector:
            rule = f"learning.block must be 0 where {type(whole).__name__} collects"
            raise ValueError(f"{rule}, got {settings.learning.block}")
        super().__init__(whole.env, check_portable(whole.policy))
        self.settings, self.submit, self.blocks = settings, submit, blocks_of(settings.learning)
        self._begun: tuple[tuple[int, int], list[Future]] | None = None  # at which moment, and which tasks

    def collect(self, decisions: int) -> TensorDict:
        env, now, decisions = self.env, self._moment(), min(decisions, self.env.world.max_decisions)
        tasks = self._begun[1] if self._begun and self._begun[0] == now else self._begin(decisions)
        self._begun = None
        rollout, states = self._joined(tasks, decisions)
        self._put(states, now[1] + len(rollout))
        if self.settings.learning.staleness and not env.all_finished():
            self._begun = self._moment(), self._begin(decisions)
        return rollout

    def _joined(self, tasks: list[Future], decisions: int) -> tuple[TensorDict, list[Arrays]]:
        """What the blocks found side by side, put together as it comes, and their states.

        Cells of a block whose lives have all ended wait for the others'.
        """
        whole, states, length = Arrays(), list[Arrays](), 0
        for block in self.blocks:
            rollout, state = tasks.pop(0).result()
            states.append(state)
            length = max(length, len(rollout[ALIVE]))
            for name, part in rollout.items():
                if name not in whole:
                    shape = decisions + (name == SEEN), part.shape[1], self.cells, *part.shape[3:]
                    whole[name] = np.empty(shape, part.dtype)
                of_block = whole[name][:, :, block.columns]
                of_block[: len(part)] = part
                of_block[len(part) :] = OVER.get(name, part[-1])
        tensors = {name: torch.from_numpy(each).to(self.env.device or "cpu") for name, each in whole.items()}
        seen = tensors[SEEN]
        tensors = {name: each[:length] for name, each in tensors.items()} | {FOLLOWS: seen[1 : length + 1]}
        return TensorDict(tensors, (length, *seen.shape[1:3])).unflatten_keys("."), states

    def _moment(self) -> tuple[int, int]:
        return int(self.env.episode[0]), int(self.env.decision[0])

    def _begin(self, decisions: int) -> list[Future]:
        """Tasks of all blocks, with the policy and the cells as they are now."""
        held, futures = self._held(), []
        policy = copy.copy(self.policy)
        policy.__dict__.pop(HIDDEN, None)  # every block gets its own
        policy = copy.deepcopy(policy).cpu()  # which learning goes on changing
        of_worlds = getattr(policy, "of_worlds", None)
        numbers = np.arange(self.env.n_worlds).reshape(len(self.env.seeds), -1)
        for block in self.blocks:
            parts = {name: block.of(each) for name, each in held.items()}
            begin = {name: each.reshape(-1, *each.shape[2:]).copy() for name, each in parts.items()}
            steering = policy if of_worlds is None else of_worlds(block.of(numbers).flatten())
            futures.append(self.submit(collected, self.settings, block, steering, begin, decisions))
        return futures

    def _held(self) -> Arrays:
        """What the environment and the policy go on from: arrays (seeds, worlds, ...)."""
        arrays = {name: _array(each) for name, each in self.env.state_dict_of_env().items()}
        seeds, hidden = len(self.env.seeds), getattr(self.policy, HIDDEN, None)
        held = {name: each.reshape(seeds, -1, *each.shape[1:]) for name, each in arrays.items()}
        if hidden is not None:
            held[HIDDEN] = _array(hidden).reshape(seeds, -1, self.env.n_swimmers, *hidden.shape[2:])
        return held

    def _put(self, states: list[Arrays], decision: int) -> None:
        """Let the environment and the policy go on from the blocks' states."""
        whole = {name: np.empty_like(each) for name, each in self._held().items()}
        for block, state in zip(self.blocks, states, strict=True):
            for name, each in state.items():
                place = block.of(whole[name])
                place[...] = each.reshape(place.shape)
        whole["decision"][:] = decision  # those of a block whose lives all ended count no further
        tensors = {name: torch.from_numpy(each).flatten(0, 1) for name, each in whole.items()}
        if (hidden := tensors.pop(HIDDEN, None)) is not None:
            self.policy.hidden = hidden.reshape(self.policy.hidden.shape).to(self.env.device or "cpu")
        self.env.load_state_dict_of_env(tensors)


def _array(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy()
