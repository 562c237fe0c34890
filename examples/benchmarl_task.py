"""The swarm as a task of BenchMARL, and its independent Q-learning (IQL) with one network for all cells.

BenchMARL asks for an older TorchRL than the trainers here, so it needs an environment of its own:

python -m venv .venv-benchmarl
.venv-benchmarl/bin/pip install . benchmarl torch==2.13.0
.venv-benchmarl/bin/python examples/benchmarl_task.py
"""

from dataclasses import replace
from pathlib import Path

from benchmarl.algorithms import IqlConfig
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig

from swarm.envs.benchmarl import SwarmTask
from swarm.torchrl_env import SwarmEnv


def main(iterations: int = 20, cells: int = 40, life: float = 80.0, folder: str = "runs/benchmarl") -> float:
    """Each iteration lives a life and makes 50 updates from it; returns the mean gain of a test's cells."""
    task = SwarmTask("linear_n4", {"n_swimmers": cells, "life": life})
    decisions = SwarmEnv(**task.config).max_steps  # BenchMARL counts those of whole worlds
    settings = {"gamma": 0.98, "lr": 3e-3, "polyak_tau": 0.02, "max_n_frames": None, "loggers": ["csv"]}
    settings |= {"max_n_iters": iterations, "save_folder": folder, "evaluation_episodes": 1}
    settings |= {"evaluation_interval": 10 * decisions, "off_policy_collected_frames_per_batch": decisions}
    settings |= {"off_policy_n_envs_per_worker": 1, "off_policy_n_optimizer_steps": 50}
    settings |= {"off_policy_train_batch_size": 16, "off_policy_memory_size": 3000}
    config = replace(ExperimentConfig.get_from_yaml(), **settings)
    network = replace(MlpConfig.get_from_yaml(), num_cells=[24, 24, 24])

    Path(folder).mkdir(parents=True, exist_ok=True)
    experiment = Experiment(task, IqlConfig.get_from_yaml(), network, seed=0, config=config)
    experiment.run()
    test = experiment.test_env.rollout(decisions, experiment.policy)
    gain = test["next", "swimmers", "gain"][:, -1].mean().item()
    print(f"mean gain {gain:.2f}")
    return gain


if __name__ == "__main__":
    main()
