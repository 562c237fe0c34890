"""The rollout: one population's life under one policy, decision by decision."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from swarm._support import streams
from swarm.physics.starts import Draws, Starts, draw_chance, draw_record_noise, noise_of
from swarm.physics.world import Outcome, State, World
from swarm.policies.policy import AnyPolicy, begin, decide


class Moment(NamedTuple):
    """A population between two decisions."""

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
    episode: int = 0,
) -> Iterator[Moment]:
    """The start, then what every decision led to, until all lives are over.

    A policy with a state of its own gets it from decision to decision. Random numbers are those of the
    `population`'s seed and episode, cell by cell, whatever the policy.
    """
    cells = len(starts.heading)
    noise_of_records = draw_record_noise(world, cells, seed, population=population, episode=episode)
    state = world.start(*starts, noise=noise_of_records)
    chance, noise = (
        Draws(draw, (1, cells), (seed,), population=population) for draw in (draw_chance, noise_of(world))
    )
    carry = begin(policy, world, state)
    yield Moment(state, np.ones(cells, bool), None)
    for decision in range(world.max_decisions):
        alive = ~state.finished
        action, carry = decide(policy, world, state, chance.at(episode, decision)[0], carry)
        kicks = noise.at(episode, decision)[0] if world.has_noise else None
        state, outcome = world.step(state, action, kicks)
        yield Moment(state, alive, outcome)
        if state.finished.all():
            return
