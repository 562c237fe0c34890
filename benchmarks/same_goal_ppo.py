"""Processor time to the same goal: our PPO beside Stable-Baselines3's, on the same cells.

The goal: the policy that always takes its likeliest action passes 98.5% of the limit at N_T = 4 on 100
validation cells. Time is of the processor, on one thread; making the environment and testing the policy are
left out. Nothing is tuned: ours has the settings as shipped, Stable-Baselines3 its own defaults, once as they
are, once with rollouts as long as a life. Without Stable-Baselines3 only ours is measured.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from benchmarks.same_goal import Pace, watched_model, watched_training
from trainers.settings.composition import settings_from
from trainers.settings.schema import Settings
from trainers.training.loop import Training

MARK = 0.985
AT_MOST = 1.0  # of the shorter time of Stable-Baselines3
SEEDS = range(3)
PACE = Pace(90.0, 0.02, False)


def settings_of(seed: int) -> Settings:
    """As shipped."""
    return settings_from(["experiment=linear_n4", "algorithm=ppo", f"seed={seed}", "compile=never"])


def ours(seed: int) -> list[float]:
    """Seconds to the mark, infinite where it is not passed; the last policy's part of the limit."""
    return watched_training(Training(settings_of(seed)), PACE, [MARK])


def stable_baselines3(seed: int, **options: int) -> list[float]:
    """As `ours`, with `options` of its PPO."""
    from stable_baselines3 import PPO

    def likelihood(model: Any) -> Callable[[torch.Tensor], torch.Tensor]:
        policy = model.policy
        return lambda seen: policy.action_net(policy.mlp_extractor.forward_actor(seen))

    return watched_model(PPO, options, settings_of(seed), 10**8, PACE, [MARK], likelihood)


def run() -> list[dict[str, Any]]:
    """All rows: medians over seeds, the learners taking turns."""
    torch.set_num_threads(1)
    life = settings_of(0).training_world().max_decisions
    learners: dict[str, Callable[[int], list[float]]] = {"ours": ours}
    if importlib.util.find_spec("stable_baselines3") is not None:
        learners["Stable-Baselines3"] = stable_baselines3
        learners["Stable-Baselines3, rollouts of a life"] = lambda seed: stable_baselines3(seed, n_steps=life)
    found = {name: np.array([learner(seed) for seed in SEEDS]) for name, learner in learners.items()}
    medians = {name: float(np.median(values[:, 0])) for name, values in found.items()}
    theirs = min((time for name, time in medians.items() if name != "ours"), default=None)
    return [
        {
            "learner": name,
            f"seconds to {MARK:.1%}": medians[name],
            "slowest": float(values[:, 0].max()),
            "ratio to the faster of theirs": None if theirs is None else medians[name] / theirs,
            "at most": AT_MOST if name == "ours" else None,
            "worst at the end": float(values[:, -1].min()),
        }
        for name, values in found.items()
    ]
