"""Brains: small networks that decide between two curvatures, many of them side by side.

Only which of two actions is better counts, so a network has one output, and the second action is taken where
it is above 0. Every number that is not 0 is a parameter.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarm._support.streams import Population
from swarm.physics.starts import Starts
from swarm.physics.world import State, World
from swarm.policies.network import Network
from swarm.population.rollout import rollout

CELLS = 20_000  # that live at once


@dataclass(frozen=True)
class Brains:
    """Networks of tanh nodes with one linear output, each for a population of its own.

    Row j of the weights says what node j adds up, its bias to it: first the inputs, then the nodes before it;
    the last row is the output's.
    """

    weights: np.ndarray  # (brains, nodes + 1, inputs + nodes)
    biases: np.ndarray  # (brains, nodes + 1)

    def __len__(self) -> int:
        return len(self.biases)

    def __getitem__(self, chosen: Any) -> "Brains":
        """Some of them: a slice, places or a mask."""
        return Brains(self.weights[chosen], self.biases[chosen])

    @property
    def nodes(self) -> int:
        """Tanh nodes, of which some may be idle."""
        return self.biases.shape[1] - 1

    @property
    def inputs(self) -> int:
        return self.weights.shape[2] - self.nodes

    @property
    def parameters(self) -> np.ndarray:
        """How many numbers (brains,) are not 0."""
        return np.count_nonzero(self.flat, axis=1)

    @property
    def flat(self) -> np.ndarray:
        """All numbers (brains, …): weights, then biases."""
        return np.concatenate([self.weights.reshape(len(self), -1), self.biases], axis=1)

    def with_flat(self, flat: np.ndarray) -> "Brains":
        """Networks of the same shape with other numbers (brains, …)."""
        split = flat.shape[1] - self.nodes - 1
        return Brains(flat[:, :split].reshape(len(flat), *self.weights.shape[1:]), flat[:, split:])

    @functools.cached_property
    def _depth(self) -> int:
        """The most nodes on the way from an input to the output."""
        linked = reach = np.any(self.weights[:, :-1, self.inputs :] != 0, axis=0).astype(int)
        depth = min(self.nodes, 1)
        while reach.any():
            reach, depth = np.minimum(reach @ linked, 1), depth + 1
        return depth

    def values(self, observation: np.ndarray) -> np.ndarray:
        """The outputs (brains, cells) for observations (brains, cells, inputs)."""
        seen, linked = (np.swapaxes(part, 1, 2) for part in np.split(self.weights, [self.inputs], axis=2))
        added = observation.astype(np.float64) @ seen + self.biases[:, None]
        active = np.zeros_like(added[..., :-1])
        for _ in range(self._depth):
            active = np.tanh(added[..., :-1] + active @ linked[..., :-1])
        return added[..., -1] + (active @ linked[..., -1:])[..., 0]

    def act(self, world: World, state: State, uniform: Any = None) -> np.ndarray:
        """Actions (brains, cells); of a single brain also (cells,)."""
        observation = world.observation(state)
        alone = observation.ndim == 2
        action = (self.values(observation[None] if alone else observation) > 0).astype(np.int32)
        return action[0] if alone else action


def brains_of(networks: Sequence[Network]) -> Brains:
    """The brains of networks of the same shape, for two actions, with one hidden layer at most.

    Raises ValueError for others.
    """
    layers = len(networks[0].weights)
    if layers > 2 or networks[0].n_actions != 2:
        raise ValueError(f"a brain must have one hidden layer at most and two actions, got {networks[0]!r}")
    first, last = (np.stack([each.weights[at] for each in networks]).astype(float) for at in (0, -1))
    biases, ends = (np.stack([each.biases[at] for each in networks]).astype(float) for at in (0, -1))
    output, threshold = last[:, 1:] - last[:, :1], ends[:, 1:] - ends[:, :1]
    if layers == 1:
        return Brains(output, threshold)
    nodes, inputs = first.shape[1:]
    weights = np.zeros((len(networks), nodes + 1, inputs + nodes))
    weights[:, :-1, :inputs], weights[:, -1:, inputs:] = first, output
    return Brains(weights, np.concatenate([biases, threshold], axis=1))


def stacked(brains: Sequence[Brains]) -> Brains:
    """All of them side by side, with idle nodes where one has fewer than another."""
    most = max(each.nodes for each in brains)
    parts = []
    for each in brains:
        weights = np.zeros((len(each), most + 1, each.inputs + most))
        rows = [*range(each.nodes), most]
        weights[:, rows, : each.inputs + each.nodes] = each.weights
        biases = np.zeros((len(each), most + 1))
        biases[:, rows] = each.biases
        parts.append(Brains(weights, biases))
    return Brains(
        np.concatenate([each.weights for each in parts]), np.concatenate([each.biases for each in parts])
    )


def gains(world: World, brains: Brains, starts: Starts, seed: int, *, population: Population) -> np.ndarray:
    """Gains (brains, cells) of lives under each brain, all from the same starts (cells, …), or each from its
    own (brains, cells, …) [concentration].
    """
    own = starts.position.ndim == 3
    cells, found = starts.position.shape[-2], []
    for block in np.array_split(np.arange(len(brains)), -(-len(brains) * cells // CELLS)):
        parts = (part[block] if own else np.broadcast_to(part, (len(block), *part.shape)) for part in starts)
        begun, episode = Starts(*parts), np.zeros(len(block), int)
        for moment in rollout(world, brains[block], begun, seed, population=population, episode=episode):
            outcome = moment.outcome
        assert outcome is not None, "a life has a decision at least"
        found.append(np.asarray(outcome.gain))
    return np.concatenate(found)
