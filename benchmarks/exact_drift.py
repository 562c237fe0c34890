"""Exact laws of the adaptive cell: how its circles drift, and what its curvature does between decisions."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.exact_solutions import law
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.adaptive import AdaptiveSteering
from swarm.population.rollout import rollout

FAR = ((0.0, 0.0), (2000.0, 2000.0))  # where a circle's radius is 1e-4 of its distance from c = 0
SETTLED = 30.0  # time after which the answer to the start is below 1e-8


def drift(steering: AdaptiveSteering) -> tuple[tuple[float, float], tuple[float, float]]:
    """Measured and exact drift, along the gradient and to its right, of the centre of a circle."""
    world = World(n_records=16, interval_rule="exact", life=SETTLED + 10 * math.pi, start_box=FAR)
    moments = list(rollout(world, steering, draw_starts(world, 1, 0), 0))
    time = np.array([world.time(each.state)[0] for each in moments])
    settled = time > SETTLED
    heading = np.array([world.heading_angle(each.state)[0] for each in moments])[settled]
    place = np.array([each.state.position[0] for each in moments])[settled]
    waves = [wave(n * heading) for n in (1, 2) for wave in (np.cos, np.sin)]
    columns = np.stack([np.ones_like(heading), time[settled], *waves], axis=1)
    right, along = np.linalg.lstsq(columns, place - place[0], rcond=None)[0][1]
    level = world.field.concentration(place).mean() / world.field.gradient_scale
    return (along, right), steering.drift(world, level)


def drift_error(steering: AdaptiveSteering) -> float:
    """Distance of the measured drift from the exact one, of its size."""
    measured, exact = map(np.array, drift(steering))
    return float(np.linalg.norm(measured - exact) / np.linalg.norm(exact))


for mu_omega, sigma_omega in ((1.0, 3.0), (0.5, 2.0), (2.0, 0.5)):

    @law(f"Drift of an adaptive cell, μω = {mu_omega:g}, σω = {sigma_omega:g}", "drift", 1e-5)
    def _drift(mu: float = mu_omega / 4, sigma: float = sigma_omega / 4) -> float:
        return drift_error(AdaptiveSteering(sigma, mu, 40.0, continuous=True))


def way_error(flow: str, steering: AdaptiveSteering, life: float = 2.0) -> float:
    """How far three cells are from where DOP853 at 1e-12 has them at the end of a life [length]."""
    world = World(flow=flow, life=life)
    starts = draw_starts(world, 3, 4)
    *_, last = rollout(world, steering, starts, 4)
    first = steering.begin(world, world.start(*starts))
    errors = []
    for cell in range(3):
        start = [*starts.position[cell], starts.heading[cell], 1.0, first.sensitivity[cell]]
        errors.append(math.dist(last.state.position[cell], _integrated(world, steering, start)[:2]))
    return max(errors)


def _integrated(world: World, steering: AdaptiveSteering, start: list[float]) -> np.ndarray:
    """Position, heading, a and ln p at the end of a life; small steps meet kinks and jumps."""
    sigma, mu = steering.times(world)
    low, mean, high = world.curvatures[0], world.mean_curvature, world.curvatures[-1]

    def rates(time: float, values: np.ndarray) -> list[float]:
        _, _, heading, output, sensitivity = values
        curvature = mean + 80 * mean * (output - 1)
        if steering.mode == "on_off":
            curvature = high if output > 1 else low
        elif steering.clip:
            curvature = min(max(curvature, low), high)
        u, v = world.flow.velocity(values[:2])
        signal = world.field.concentration(values[:2]) / world.field.gradient_scale
        return [
            world.speed * math.cos(heading) + u,
            world.speed * math.sin(heading) + v,
            world.speed * curvature + world.flow.spin(values[:2]),
            (math.exp(sensitivity) * signal - output) / sigma,
            (1 - output) / mu,
        ]

    smooth = steering.mode == "linear" and not steering.clip
    options = {"rtol": 1e-12, "atol": 1e-12, "max_step": np.inf if smooth else 0.01}
    return solve_ivp(rates, (0, world.life), start, "DOP853", **options).y[:, -1]


for name, bound, words in (
    ("linear, unclipped", 1e-8, {"clip": False}),
    ("linear, clipped", 1e-8, {}),
    ("on–off", 1e-6, {"mode": "on_off"}),
):
    for where in ("still", "taylor_green"):

        @law(f"Continuous steering, {name}, {where.replace('_', ' ')}: DOP853 after t = 2", "length", bound)
        def _way(flow: str = where, words: dict = words) -> float:
            return way_error(flow, AdaptiveSteering(continuous=True, **words))
