"""Three dimensions: what strategies, DQN and PPO reach of the possible.

Gains are means of 40 cells of seed 0 in lives of 200. Each algorithm is trained for five seeds as shipped;
the policy of a seed is the best on its own validation cells. `python -m benchmarks.three_dimensions` trains
DQN and puts the policy that validation prefers among its seeds into swarm/zoo, with a card and its curve.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from swarm.optimal.physical_limit import Optimal
from swarm.policies.adaptive import AdaptiveSteering
from swarm.policies.network import load_policy
from swarm.policies.policy import AnyPolicy
from swarm.policies.strategies import Random, Swinging
from swarm.population.contest import population_test
from swarm.population.statistics import fraction_of_limit
from trainers.settings.composition import settings_from
from trainers.settings.schema import Settings
from trainers.studies import zoo
from trainers.studies.stacks import Stack, Trained, curve_of
from trainers.training.loop import Training

EXPERIMENT, CELLS, SEEDS = "space", 40, 5
SHIPPED = {"cells": 400, "seed": 100}  # of the test that the card tells of


def run() -> dict[str, list[dict[str, Any]]]:
    """A table of strategies, then one of trained policies for each algorithm."""
    settings = settings_of()
    others: dict[str, AnyPolicy] = {
        "adaptive": AdaptiveSteering(),
        "swinging": Swinging(),
        "random": Random(),
    }
    others |= {"optimal": Optimal(settings.test_world()), "learnt in the plane": load_policy("zoo:linear_n4")}
    lived = tested(settings, others, cells=CELLS)
    found = {"Not learnt in space": [row({"policy": name}, lived, name) for name in lived["policy"].values]}
    for algorithm in ("dqn", "ppo"):
        training = trained(settings_of(f"algorithm={algorithm}"))
        policies = dict(zip(map(str, training.seeds), training.policies(), strict=True))
        lived = tested(settings, policies, cells=CELLS)
        found[algorithm.upper()] = [row({"seed": seed}, lived, seed) for seed in policies]
    return found


def settings_of(*words: str) -> Settings:
    """Settings of the experiment."""
    return settings_from([f"experiment={EXPERIMENT}", f"n_seeds={SEEDS}", *words])


def trained(settings: Settings) -> Training:
    """A training that is over."""
    training = Training(settings)
    for _ in range(settings.learning.epochs):
        training.run_epoch()
    return training


def tested(settings: Settings, policies: dict[str, AnyPolicy], **sizes: int) -> xr.Dataset:
    """The lives of test cells under each policy and greedy."""
    world = settings.test_world()
    return population_test(world, policies, life=world.life, record=False, **sizes)


def row(about: dict[str, Any], lived: xr.Dataset, policy: str) -> dict[str, Any]:
    """What the table says of a policy."""
    gain = lived["gain"].sel(policy=policy).values
    part = fraction_of_limit(float(gain.mean()), lived.attrs.get("limit"))
    told = {} if part is None else {"of its limit": f"{part:.1%}"}
    return about | {"gain": f"{gain.mean():.1f} ± {gain.std():.1f}"} | told


def ship(training: Training) -> None:
    """Puts the policy that validation prefers into swarm/zoo."""
    settings = training.settings
    policies = tuple(training.policies())
    chosen = int(np.argmax([policy.card["validation"]["gain"] for policy in policies]))
    stack = Stack(settings.recipe, "dqn", EXPERIMENT, tuple(training.seeds), policies, chosen)
    lived = tested(settings, {"dqn": stack.choice}, **SHIPPED)
    gain, greedy = (lived["gain"].sel(policy=name).values for name in ("dqn", "greedy"))
    limit = lived.attrs.get("limit")
    told = {
        **SHIPPED,
        "life": settings.evaluation.life,
        "gain": {name: float(getattr(gain, name)()) for name in ("mean", "std", "min", "max")},
        "limit": limit,
        "fraction_of_limit": fraction_of_limit(float(gain.mean()), limit),
        "greedy": float(greedy.mean()),
    }
    names = ("gain", "fraction_of_limit", "training_gain")
    curve = curve_of({name: training.measure(name).T for name in names}, settings, training.seeds)
    zoo.put(zoo.SHIPPED, Trained(stack, curve, settings), told)


if __name__ == "__main__":
    ship(trained(settings_of()))
