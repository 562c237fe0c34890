"""Laws of pairs of cells: contact, and the flow of force dipoles."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

import swarm
from benchmarks.exact_solutions import law

KAPPA, APART, TURNS = 4.0, 4.0, 10  # of cells that circle far from each other
STRENGTH = 0.25


def apart(position: np.ndarray) -> float:
    """Distance of two cells."""
    return float(np.hypot(*(position[1] - position[0])))


@law("Contact head on: r = d − v/(μK) at the time 20/(2μK)", "length", 1e-6)
def head_on() -> float:
    """Worst of three contacts."""
    errors = []
    for diameter, stiffness in ((0.1, 100.0), (0.05, 200.0), (0.1, 40.0)):
        position = np.array([[0.0, 0.0], [0.95 * diameter, 0.0]])
        contact = swarm.Contact(diameter, stiffness)
        time = 20 / (2 * stiffness)
        end = swarm.swim(position, np.array([0.0, math.pi]), 0.0, 1.0, time, interactions=contact)
        errors.append(abs(apart(end.position) - (diameter - 1 / stiffness)))
    return max(errors)


def side_by_side(dipole: swarm.Dipole, power: int, law: float) -> float:
    """Relative error of r^power of parallel pushers that do not turn, of which the law tells the rate."""
    position, heading = np.array([[0.0, 0.0], [1.0, 0.0]]), np.full(2, math.pi / 2)
    ends = ((time, swarm.swim(position, heading, 0.0, 1.0, time, interactions=dipole)) for time in (1.0, 4.0))
    return max(abs(apart(end.position) ** power / (1 - law * time) - 1) for time, end in ends)


law("Side by side pushers in a film: r² = r₀² − pt/(πη)", "r²", 1e-8)(
    partial(side_by_side, swarm.Dipole(0.1, 0.0), 2, 0.1 / math.pi)
)
law("Side by side pushers in bulk: r³ = r₀³ − 3pt/(4πη)", "r³", 1e-8)(
    partial(side_by_side, swarm.Dipole(0.1, 0.0, "bulk"), 3, 0.3 / (4 * math.pi))
)


def circling(dipole: swarm.Dipole, phase: float) -> float:
    """Distance of the centres of two circling pushers after whole turns."""
    theta = np.array([0.3, 0.3 + phase])
    position = np.array([[0.0, 0.0], [APART, 0.0]]) - np.stack([-np.sin(theta), np.cos(theta)], -1) / KAPPA
    time = TURNS * 2 * math.pi / KAPPA
    end = swarm.swim(position, theta, KAPPA, 1.0, time, interactions=dipole)
    return apart(end.position + np.stack([-np.sin(end.heading), np.cos(end.heading)], -1) / KAPPA)


def circling_in_bulk(phase: float, *, corrected: bool = False) -> float:
    """Relative error of R³ − R₀³ against 3pt/(8πη), with its correction by the radius of the circles."""
    expected = 3 * STRENGTH * TURNS * 2 * math.pi / KAPPA / (8 * math.pi)
    if corrected:
        offset = 2 / KAPPA * abs(math.sin(phase / 2))
        expected *= 1 + 2.25 * math.cos(phase / 2) ** 2 * (offset / APART) ** 2
    return abs((circling(swarm.Dipole(STRENGTH, 0.0, "bulk"), phase) ** 3 - APART**3) / expected - 1)


law("Circling pushers in bulk, in phase: R³ = R₀³ + 3pt/(8πη)", "R³ − R₀³", 1e-4)(
    partial(circling_in_bulk, 0.0)
)
law("Out of phase by 1: the same, and 9/4 cos²(Δφ/2) (ρ/R)² of it more", "R³ − R₀³", 1e-4)(
    partial(circling_in_bulk, 1.0, corrected=True)
)


@law("Circling pushers in a film stay where they are", "length", 2e-4)
def circling_in_a_film() -> float:
    """In phase and out of it."""
    return max(abs(circling(swarm.Dipole(STRENGTH, 0.0), phase) - APART) for phase in (0.0, 1.0))
