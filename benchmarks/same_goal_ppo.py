"""Processor time to the same goal: our PPO beside Stable-Baselines3's, on the same cells.

The goal: the policy that always takes its likeliest action passes 98.5% of the limit at N_T = 4 on 100
validation cells. Time is of the processor, on one thread; making the environment and testing the policy are
left out. Nothing is tuned: ours has the settings as shipped, Stable-Baselines3 its own defaults, once as they
are, once with rollouts as long as a life. Without Stable-Baselines3 only ours is measured.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np
import torch

import swarm
from benchmarks.same_goal import Pace, Watch, watched_training
from trainers.settings.composition import settings_from
from trainers.settings.schema import Settings
from trainers.training.loop import Training
from trainers.training.validation import Validation

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


def stable_baselines3(seed: int, rollout: int | None = None) -> list[float]:
    """As `ours`; `rollout` is the number of decisions of a cell between two rounds of updates."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback

    from examples.stable_baselines3_dqn import Cells

    settings = settings_of(seed)
    checked, world = settings.validation, settings.training_world()
    cells = Cells(swarm.SpermSwarmVector(settings.learning.n_swimmers, world=world))
    cells.seed(seed)

    class Looking(BaseCallback):
        def _on_training_start(self) -> None:
            watch.since = process_time()

        def _on_rollout_start(self) -> None:  # after a round of updates
            watch.look(likelihood)

        def _on_step(self) -> bool:
            return not watch.over

    given = {} if rollout is None else {"n_steps": rollout}
    model = PPO("MlpPolicy", cells, seed=seed, device="cpu", **given)

    def likelihood(seen: torch.Tensor) -> torch.Tensor:
        policy: Any = model.policy
        return policy.action_net(policy.mlp_extractor.forward_actor(seen))

    watch = Watch(Validation(world.replace(life=checked.life), checked.cells, [seed]), PACE, [MARK])
    model.learn(10**8, callback=Looking())
    return [*watch.reached, watch.part_of_limit(likelihood)]


def run() -> list[dict[str, Any]]:
    """All rows: medians over seeds, the learners taking turns."""
    torch.set_num_threads(1)
    life = settings_of(0).training_world().max_decisions
    learners: dict[str, Callable[[int], list[float]]] = {"ours": ours}
    if importlib.util.find_spec("stable_baselines3") is not None:
        learners["Stable-Baselines3"] = stable_baselines3
        learners["Stable-Baselines3, rollouts of a life"] = lambda seed: stable_baselines3(seed, life)
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
