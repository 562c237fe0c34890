"""The limit in space: which signs of the differences of curvature and torsion pay, and what strategies reach.

1000 cells of seed 0, whose frames are uniform over rotations, in a linear field of unit gradient.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from swarm.optimal.physical_limit import Optimal, limit_details
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.strategies import Greedy, Random, Swinging
from swarm.population.contest import population_test

CELLS, LIFE, LONG = 1000, 40.0, 200.0
TORSIONS = {
    "opposite signs": (7.7, 5.7),
    "equal signs": (5.7, 7.7),
    "curvature alone": (6.7, 6.7),
    "no torsion": (0.0, 0.0),
}


def run() -> dict[str, list[dict[str, Any]]]:
    """A table of pairs of actions, and one of records."""
    return {
        f"Lives of {LIFE:g}": [lived(name, World.in_space(torsions=each)) for name, each in TORSIONS.items()],
        f"Lives of {LONG:g}, opposite signs": [limit_at(n_records) for n_records in (2, 4, 8)],
    }


def lived(name: str, world: World) -> dict[str, Any]:
    """What policies gain in a world, as fractions of its limit."""
    assert world.torsions is not None
    rivals: dict[str, Any] = {"greedy": Greedy(), "swinging": Swinging(), "random": Random()}
    policies = {"optimal": Optimal(world.replace(life=LIFE)), **rivals}
    found = population_test(world, policies, cells=CELLS, life=LIFE, record=False, limit=False)
    details = limit_details(world.replace(life=LIFE), draw_starts(world, CELLS, 0))
    assert details is not None
    tilts = np.degrees(np.arctan2(world.curvatures, world.torsions))
    pairs = ", ".join(f"({k:g}, {t:g})" for k, t in zip(world.curvatures, world.torsions, strict=True))
    return {
        "": name,
        "(κ, τ)": pairs,
        "between the axes": f"{np.ptp(tilts):.1f}°",
        "limit": f"{details.value:.2f} ± {details.error:.2g}",
        **{each: f"{found['gain'].sel(policy=each).mean().item() / details.value:.1%}" for each in policies},
    }


def limit_at(n_records: int) -> dict[str, Any]:
    """The limit with so many decisions in a period."""
    world = World.in_space(n_records=n_records, life=LONG)
    details = limit_details(world, draw_starts(world, CELLS, 0))
    assert details is not None
    return {
        "decisions in a period": n_records,
        "limit": f"{details.value:.2f}",
        "error": f"{details.error:.2g}",
        "of the way swum": f"{details.value / (world.speed * LONG):.1%}",
    }
