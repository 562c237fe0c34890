"""The swarm as a task of BenchMARL, and its independent Q-learning (IQL) with one network for all cells.

BenchMARL asks for an older TorchRL than the trainers here, so it needs an environment of its own:

python -m venv .venv-benchmarl
.venv-benchmarl/bin/pip install . benchmarl torch==2.13.0
.venv-benchmarl/bin/python examples/benchmarl_task.py
"""

from dataclasses import replace
from pathlib import Path

from benchmarl.algorithms import IqlConfig
from benchmarl.environments.common import TaskClass
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig

from swarm.envs.torchrl import SwarmEnv


class SwarmTask(TaskClass):
    """`config` holds the arguments of `SwarmEnv`. All cells of a world should live equally long, because
    BenchMARL does not leave finished ones out."""

    def get_env_fun(self, num_envs, continuous_actions, seed, device):
        return lambda: SwarmEnv(num_envs, device, seed=seed or 0, **self.config)

    def group_map(self, env):
        return {"swimmers": [f"swimmer_{i}" for i in range(env.n_swimmers)]}

    def observation_spec(self, env):
        spec = env.observation_spec_unbatched.clone()
        del spec["swimmers", "gain"]
        return spec

    action_spec = staticmethod(lambda env: env.full_action_spec_unbatched)
    max_steps = staticmethod(lambda env: env.world.max_decisions)
    state_spec = action_mask_spec = info_spec = staticmethod(lambda env: None)
    supports_continuous_actions = has_render = staticmethod(lambda *_: False)
    supports_discrete_actions = staticmethod(lambda: True)
    env_name = staticmethod(lambda: "chemoswarm")


def main(iterations: int = 20, cells: int = 40, life: float = 80.0, folder: str = "runs/benchmarl") -> float:
    """Each iteration lives a life and makes 50 updates from it; returns the mean gain of a test's cells."""
    task = SwarmTask("linear_n4", {"n_swimmers": cells, "life": life})
    decisions = SwarmEnv(**task.config).world.max_decisions  # BenchMARL counts those of whole worlds
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
