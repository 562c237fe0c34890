"""The rollout: a population's life under one policy, decision by decision."""

import functools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from swarm._support import streams
from swarm.physics.starts import Draws, Starts, cells_of, draw_chance, draw_record_noise, noise_of
from swarm.physics.world import Outcome, State, World
from swarm.policies.policy import AnyPolicy, begin, is_deterministic, lived


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
    first: int = 0,
    state: State | None = None,
) -> Iterator[Moment]:
    """The start, then what every decision led to, until all lives are over.

    A policy with a state of its own gets it from decision to decision. Random numbers are those of the
    `population`'s seed and episode, cell by cell, whatever the policy. Starts (worlds, cells, …) are those of
    several worlds, one for each episode from `episode` on, or of the episodes (worlds,) given; cells may be
    those of a larger population from the `first` on. `state` is the one at t = 0, where that is known.
    """
    which: Any = {"population": population, "episode": episode, "first": first}
    state = started(world, starts, seed, **which) if state is None else state
    numbers = chances(world, cells_of(starts), seed, chance=not is_deterministic(policy), **which)
    carry = begin(policy, world, state)
    yield Moment(state, np.ones(cells_of(starts), bool), None)
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
    first: int = 0,
) -> State:
    """The state at t = 0, its records with their noise; starts and episodes as of `chances`."""
    cells = cells_of(starts)
    draw = functools.partial(draw_record_noise, world, cells[-1], seed, population=population, first=first)
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
    first: int = 0,
    chance: bool = True,
) -> Callable[[int], tuple[np.ndarray | None, np.ndarray | None]]:
    """The random numbers of each decision: a policy's (cells,), or None without `chance`, and the world's
    noise or None.

    `cells` may be (worlds, cells); each world's numbers are those of an episode of its own, by default one
    after the other from `episode` on.
    """
    episodes = np.array(_episodes(cells, episode))
    worlds = len(episodes)

    def drawn(draw: Callable[..., np.ndarray], wanted: bool) -> Callable[[int], np.ndarray | None]:
        if not wanted:
            return lambda decision: None
        draws = Draws(draw, (worlds, cells[-1]), (seed,) * worlds, population=population, first=first)
        return lambda decision: draws.at(episodes, decision)[... if len(cells) > 1 else 0]

    of_policy, of_world = drawn(draw_chance, chance), drawn(noise_of(world), world.has_noise)
    return lambda decision: (of_policy(decision), of_world(decision))


def _episodes(cells: tuple[int, ...], episode: int | np.ndarray) -> list[int]:
    """The episode of each world."""
    if np.ndim(episode):
        return [int(each) for each in np.asarray(episode)]
    return [int(episode) + world for world in range(cells[0] if len(cells) > 1 else 1)]
