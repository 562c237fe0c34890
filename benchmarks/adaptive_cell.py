"""The adaptive cell beside greedy and the limit: gains of 40 cells in lives of 200."""

from __future__ import annotations

import math
from typing import Any

from swarm.physics.world import World
from swarm.policies.adaptive import AdaptiveSteering
from swarm.population.contest import population_test
from swarm.population.statistics import statistics

Steering = AdaptiveSteering


def run() -> dict[str, list[dict[str, Any]]]:
    """A table without noise, and one of cells that count molecules."""
    continuous = {
        "linear, g = 320, clipped": Steering(continuous=True),
        "linear, g = 320, unclipped": Steering(clip=False, continuous=True),
        "linear, g = 160, unclipped": Steering(gain=160.0, clip=False, continuous=True),
        "on–off": Steering(mode="on_off", continuous=True),
    }
    sampled = {"linear": Steering(), "on–off": Steering(mode="on_off")}
    tables = {"Continuous curvature in [3, 5]": rows(World(), continuous)}
    for n_records in (2, 4, 8):
        title = f"Two curvatures, {n_records} decisions a turn"
        tables[title] = rows(World(n_records=n_records), sampled)
    gains = {f"linear, g = {gain}": Steering(gain=float(gain), continuous=True) for gain in (40, 320)}
    decided = {
        "linear, g = 40 below s = 25, 320 above": Steering(gain=(40.0, 320.0), decision=25.0, continuous=True)
    }
    for rate in (300, 3000):
        tables[f"Continuous, {rate:g} bindings per concentration and time"] = rows(
            World(binding_rate=rate), gains | decided
        )
    return tables


def rows(world: World, policies: dict[str, Any]) -> list[dict[str, Any]]:
    """A row per policy: its mean gain, its interval, and its parts of the limits."""
    life = 200.0
    found = population_test(world, policies, cells=40, life=life, record=False)
    limit = found.attrs.get("limit")
    low, high = world.curvatures[0], world.curvatures[-1]
    ideal = life * world.speed * 2 * (high - low) / (math.pi * (high + low))
    return [
        {
            "policy": name,
            "gain": each["mean"],
            "95% interval": "{:.2f} … {:.2f}".format(*each["ci95"]),
            "of the limit of two curvatures": None if limit is None else f"{each['mean'] / limit:.1%}",
            "of t/2π": f"{each['mean'] / ideal:.1%}",
        }
        for name, each in statistics(found).items()
    ]
