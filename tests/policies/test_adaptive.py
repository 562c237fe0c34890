"""The adaptive cell: its response, its drift against the exact one, its steering continuous and sampled."""

import math
import subprocess

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarm._support import streams
from swarm.physics.motion.arc import centre_of_curvature
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.adaptive import AdaptiveSteering
from swarm.policies.policy import lived
from swarm.population.contest import population_test
from swarm.population.contests import contest
from swarm.population.evaluation import evaluate
from swarm.population.rollout import rollout
from tests.reference import array, to_numpy

FAR = {"start_box": ((0, 0), (2000, 2000))}  # where a circle's own size is a thousandth of its distance
ON_OFF = {"mode": "on_off"}


def integrated(world, steering, start, life):
    """Position, heading, a and ln p at the end of a life by DOP853 at 1e-12; kinks are crossed by small steps."""
    sigma, mu = steering.times(world)
    gain = steering.gain if steering.gain is not None else 80 * world.mean_curvature

    def rates(time, values):
        x, y, heading, output, sensitivity = values
        place = np.array([x, y])
        wanted = world.mean_curvature + gain * (output - 1)
        low, high = world.curvatures[0], world.curvatures[-1]
        if steering.mode == "on_off":
            wanted = high if output > 1 else low
        elif steering.clip:
            wanted = min(max(wanted, low), high)
        u, v = world.flow.velocity(place)
        signal = world.field.concentration(place) / world.field.gradient_scale
        return [
            world.speed * math.cos(heading) + u,
            world.speed * math.sin(heading) + v,
            world.speed * wanted + world.flow.spin(place),
            (math.exp(sensitivity) * signal - output) / sigma,
            (1 - output) / mu,
        ]

    step = 1e-3 if steering.mode == "on_off" or steering.clip else np.inf
    found = solve_ivp(rates, (0, life), start, "DOP853", rtol=1e-12, atol=1e-12, max_step=step)
    return found.y[:, -1]


@pytest.mark.parametrize("flow", ["still", "taylor_green"])
@pytest.mark.parametrize(
    ("steering", "allowed"),
    [({"clip": False}, 1e-8), ({"clip": True}, 1e-6), (ON_OFF, 1e-3)],  # DOP853 meets the jump in steps of 1e-3
    ids=["unclipped", "clipped", "on-off"],
)
def test_continuous_steering_is_that_of_an_independent_integration(flow, steering, allowed):
    world = World(flow=flow, life=3.0)
    policy = AdaptiveSteering(continuous=True, **steering)
    starts = draw_starts(world, 3, 4)
    *_, last = rollout(world, policy, starts, 4)
    for cell in range(3):
        state = world.start(*starts)
        first = policy.begin(world, state)
        start = [*starts.position[cell], starts.heading[cell], 1.0, first.sensitivity[cell]]
        x, y, heading, *_ = integrated(world, policy, start, 3.0)
        found = [*last.state.position[cell], *last.state.heading[cell]]
        np.testing.assert_allclose(found, [x, y, np.cos(heading), np.sin(heading)], atol=allowed)
