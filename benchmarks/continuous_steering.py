"""Continuous steering: how much two curvatures give away, and what PPO reaches of the possible.

Gains are means of 40 cells of seed 0 in lives of 200. PPO is trained for five seeds as shipped; the policy of
a seed is the best on its own validation cells.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from swarm.optimal.physical_limit import limit_details
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.population.contest import population_test
from trainers.settings.composition import settings_from
from trainers.training.loop import Training

CELLS, LIFE, SEEDS = 40, 200.0, 5
CHOICES: dict[str, dict[str, Any]] = {
    "two curvatures": {},
    "nine curvatures": {"curvatures": tuple(np.linspace(3, 5, 9).tolist())},
    "any curvature": {"action": "continuous"},
}


def run() -> dict[str, list[dict[str, Any]]]:
    """A table of limits, and one of trained policies."""
    return {
        "Limits, κ from 3 to 5": [limits_at(n_records) for n_records in (2, 4, 8)],
        "PPO, `experiment=continuous_n4`": trained(),
    }


def limits_at(n_records: int) -> dict[str, Any]:
    """Limits with so many decisions in a period."""
    worlds = {name: World(n_records=n_records, life=LIFE, **each) for name, each in CHOICES.items()}
    found = {name: limit_details(world, draw_starts(world, CELLS, 0)) for name, world in worlds.items()}
    values = {name: each.value for name, each in found.items() if each is not None}
    two, any_ = values["two curvatures"], values["any curvature"]
    error = max(each.error for each in found.values() if each is not None)
    return {
        "decisions in a period": n_records,
        **{name: f"{value:.3f}" for name, value in values.items()},
        "two give away": f"{(any_ - two) / any_:.2%}",
        "error": f"{error:.1g}",
    }


def trained() -> list[dict[str, Any]]:
    """A row per seed: gains on test cells."""
    training = Training(settings_from(["experiment=continuous_n4", f"n_seeds={SEEDS}"]))
    for _ in range(training.settings.learning.epochs):
        training.run_epoch()
    rows = []
    for seed, policy in zip(training.seeds, training.policies(), strict=True):
        world = training.env.world
        found = population_test(world, {"ppo": policy}, cells=CELLS, life=LIFE, record=False)
        gain = found["gain"].sel(policy="ppo").values
        row = {"seed": seed, "gain": f"{gain.mean():.2f} ± {gain.std():.2f}"}
        rows.append(row | {"of its limit": f"{gain.mean() / found.attrs['limit']:.1%}"})
    return rows
