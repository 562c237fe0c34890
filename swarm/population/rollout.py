"""The rollout: a population's life under one policy, decision by decision."""

import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from swarm._support import streams
from swarm.physics.starts import Draws, Starts, draw_chance, draw_record_noise, noise_of
from swarm.physics.world import Outcome, State, World
from swarm.policies.policy import AnyPolicy, begin, lived


class Moment(NamedTuple):
    """A population between two decisions; with several worlds (worlds, cells) stands for (cells,)."""

    state: State  # (cells, ...)
    alive: np.ndarray  # (cells,) bool: lived until now; False where the life was over before the decision
    outcome: Outcome | None  # of the decision that led here; None at the start


def rollout(
    world: World,
    policy: AnyPolicy,
    starts: Starts,
    seed: int,
    *,
    population: streams.Population = "test",
    episode: int | np.ndarray = 0,
) -> Iterator[Moment]:
    """The start, then what every decision led to, until all lives are over.

    A policy with a state of its own gets it from decision to decision. Random numbers are those of the
    `population`'s seed and episode, cell by cell, whatever the policy. Starts (worlds, cells, …) are those of
    several worlds, one for each episode from `episode` on, or of the episodes (worlds,) given.
    """
    state = started(world, starts, seed, population=population, episode=episode)
    numbers = chances(world, starts.heading.shape, seed, population=population, episode=episode)
    carry = begin(policy, world, state)
    yield Moment(state, np.ones(starts.heading.shape, bool), None)
    for decision in range(world.max_decisions):
        alive = ~state.finished
        chance, kicks = numbers(decision)
        state, outcome, carry = lived(policy, world, state, chance, kicks, carry)
        yield Moment(state, alive, outcome)
        if state.finished.all():
            return


def started(
    world: World,
    starts: Starts,
    seed: int,
    *,
    population: streams.Population = "test",
    episode: int | np.ndarray = 0,
) -> State:
    """The state at t = 0, its records with their noise; starts and episodes as of `chances`."""
    cells = starts.heading.shape
    draw = functools.partial(draw_record_noise, world, cells[-1], seed, population=population)
    noise = [part for each in _episodes(cells, episode) if (part := draw(episode=each)) is not None]
    if not noise:
        return world.start(*starts)
    return world.start(*starts, noise=np.reshape(np.stack(noise), (*cells, -1)))


def chances(
    world: World,
    cells: tuple[int, ...],
    seed: int,
    *,
    population: streams.Population = "test",
    episode: int | np.ndarray = 0,
) -> Callable[[int], tuple[np.ndarray, np.ndarray | None]]:
    """The random numbers of each decision: a policy's (cells,), and the world's noise or None.

    `cells` may be (worlds, cells); each world's numbers are those of an episode of its own, by default one
    after the other from `episode` on.
    """
    episodes = np.array(_episodes(cells, episode))
    worlds = len(episodes)
    drawn = [
        Draws(draw, (worlds, cells[-1]), (seed,) * worlds, population=population)
        for draw in (draw_chance, noise_of(world))[: 1 + world.has_noise]
    ]

    def numbers(decision: int) -> tuple[np.ndarray, np.ndarray | None]:
        at = [each.at(episodes, decision) for each in drawn]
        chance, *noise = [each if len(cells) > 1 else each[0] for each in at]
        return chance, noise[0] if noise else None

    return numbers


def _episodes(cells: tuple[int, ...], episode: int | np.ndarray) -> list[int]:
    """The episode of each world."""
    if np.ndim(episode):
        return [int(each) for each in np.asarray(episode)]
    return [int(episode) + world for world in range(cells[0] if len(cells) > 1 else 1)]
