"""The rollout: a population's life under one policy, decision by decision."""

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
) -> Iterator[Moment]:
    """The start, then what every decision led to, until all lives are over.

    A policy with a state of its own gets it from decision to decision. Random numbers are those of the
    `population`'s seed and episode, cell by cell, whatever the policy. Starts (worlds, cells, …) are those of
    several worlds, one for each episode from `episode` on, or of the episodes (worlds,) given; cells may be
    those of a larger population from the `first` on.
    """
    cells = cells_of(starts)
    where: dict[str, Any] = {"population": population, "first": first}
    episodes = np.asarray(episode)
    if not episodes.ndim:
        episodes = episode + np.arange(cells[0] if len(cells) > 1 else 1)
    noise: Any = [
        draw_record_noise(world, cells[-1], seed, episode=each, **where) for each in episodes.tolist()
    ]
    state = world.start(*starts, noise=None if noise[0] is None else np.reshape(noise, (*cells, -1)))

    def drawn(draw: Callable[..., np.ndarray], wanted: bool) -> Callable[[int], np.ndarray | None]:
        if not wanted:
            return lambda decision: None
        draws = Draws(draw, (len(episodes), cells[-1]), (seed,) * len(episodes), **where)
        return lambda decision: draws.at(episodes, decision)[... if len(cells) > 1 else 0]

    chance, kicks = drawn(draw_chance, not is_deterministic(policy)), drawn(noise_of(world), world.has_noise)
    carry = begin(policy, world, state)
    yield Moment(state, np.ones(cells, bool), None)
    for decision in range(world.max_decisions):
        alive = ~state.finished
        state, outcome, carry = lived(policy, world, state, chance(decision), kicks(decision), carry)
        yield Moment(state, alive, outcome)
        if state.finished.all():
            return
