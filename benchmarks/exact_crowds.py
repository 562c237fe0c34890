"""Crowds whose cells push and stir each other, at the accuracy that ships, against DOP853."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import swarm
from benchmarks.exact_solutions import law
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.collocation import Collocation
from swarm.physics.motion.company import Company

CONTACT = swarm.Contact(0.1, 100.0)  # head-on cells keep 0.9 of the diameter
CONTACTS = [CONTACT], [swarm.Contact(0.05, 200.0)]
FILM, BULK = swarm.Dipole(0.2, 0.25), swarm.Dipole(0.25, 0.25, "bulk")


def reference(world: swarm.World, state: swarm.State, action: np.ndarray) -> np.ndarray:
    """Positions (cells, 2) after a decision, from the coupled equations of all cells."""
    cells = len(action)
    kappa = np.asarray(world.curvatures)[action]
    alive = np.ones(cells, bool)

    def rate(_: float, numbers: np.ndarray) -> np.ndarray:
        x, y, theta = numbers.reshape(3, cells)
        position, heading = np.stack([x, y], -1), np.stack([np.cos(theta), np.sin(theta)], -1)
        velocity, spin = heading * world.speed + world.flow.velocity(position), world.speed * kappa
        spin = spin + world.flow.spin(position)
        for each in world.interactions:
            drift, turning = each.drift(position, heading, alive)
            velocity, spin = velocity + drift, spin + turning
        return np.concatenate([velocity[:, 0], velocity[:, 1], spin])

    start = np.concatenate([*state.position.T, world.heading_angle(state)])
    longest = 0.002 if any(isinstance(each, swarm.Contact) for each in world.interactions) else np.inf
    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-11, "max_step": longest}
    return solve_ivp(rate, (0, world.intervals[0]), start, **options).y[: 2 * cells, -1].reshape(2, cells).T


def decisions(cells: int, side: float, *crowds: list[Any], flow: str = "still") -> float:
    """Worst of two decisions of cells that start in a square, but for the first, which separates them."""
    errors = []
    for interactions in crowds:
        world = swarm.World(interactions=interactions, flow=flow, start_box=((0, side), (0, side)))
        state = world.start(*swarm.draw_starts(world, cells, 4))
        rng = np.random.default_rng(0)
        for turn in range(3):
            action = rng.integers(2, size=cells)
            after, _ = world.step(state, action)
            if turn > 0:
                errors.append(np.abs(after.position - reference(world, state, action)).max())
            state = after
    return float(max(errors))


for name, bound, error in (
    (
        "9 cells in 1.6 × 1.6, flow of dipoles in film or bulk",
        1e-5,
        partial(decisions, 9, 1.6, [FILM], [BULK]),
    ),
    ("9 cells, dipoles in Taylor–Green flow", 1e-5, partial(decisions, 9, 1.6, [FILM], flow="taylor_green")),
    ("9 cells, contact", 1e-4, partial(decisions, 9, 1.6, *CONTACTS)),
    ("9 cells, contact and dipoles", 1e-4, partial(decisions, 9, 1.6, [CONTACT, FILM])),
    ("40 cells in 3 × 3, contact and dipoles", 1e-4, partial(decisions, 40, 3.0, [CONTACT, FILM])),
):
    law(f"A decision of {name}: DOP853", "length", bound)(error)


@law("Contact is of second order in the length of steps, through its kink: order − 2", "1", 0.3)
def order() -> float:
    """Of sixteen pairs that meet, from steps of which one is eight times as long as the other."""
    ahead, heading = np.linspace(0.16, 0.2, 16), np.array([0.0, math.pi])
    position = np.stack([np.array([[0.0, 0.0], [x, 0.03]]) for x in ahead])
    pose = Pose(position, np.tile(np.stack([np.cos(heading), np.sin(heading)], -1), (16, 1, 1)))
    ones = np.ones((16, 2))
    arcs = ones * [3.0, 5.0], ones, 0.2 * ones

    def end(steps: int) -> np.ndarray:
        company = Company(swarm.StillWater(), (CONTACT,), Collocation(3, 2, steps))
        found: np.ndarray = company.swim(pose, *arcs, ones > 0)[0].position
        return found

    best = end(8192)
    coarse, fine = (np.abs(end(steps) - best).mean() for steps in (128, 1024))
    return float(abs(math.log(coarse / fine, 8) - 2))
