"""RLlib's PPO trains one policy for all cells, through RLlib's own PettingZoo wrapper.

RLlib asks for another Gymnasium than the one tested here, so it needs an environment of its own:

python -m venv .venv-rllib
.venv-rllib/bin/pip install . 'ray[rllib]' torch==2.13.0
.venv-rllib/bin/python examples/rllib_ppo.py
"""

import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env

import swarm


def make_env(config: dict) -> ParallelPettingZooEnv:
    """What every runner of RLlib calls; `config` holds the arguments of `parallel_env`."""
    return ParallelPettingZooEnv(swarm.parallel_env(**config))


def main(iterations: int = 10, cells: int = 10, life: float = 80.0, decisions: int = 1000) -> float:
    """Each iteration lives `decisions` decisions and learns from them; returns the mean gain in the last."""
    register_env("sperm_swarm", make_env)
    config = (
        PPOConfig()
        .environment("sperm_swarm", env_config={"n_swimmers": cells, "life": life})
        .env_runners(num_env_runners=0)
        .multi_agent(policies={"cell"}, policy_mapping_fn=lambda agent, episode, **rest: "cell")
        .training(gamma=0.98, lr=3e-4, minibatch_size=min(256, decisions), num_epochs=5)
        .training(train_batch_size_per_learner=decisions)
        .debugging(seed=0)
    )
    algorithm = config.build_algo()
    # The rewards of a life add up to the rise of the remembered mean over c_k |1/κ₁ − 1/κ₂|, here 2/15.
    unit = abs(1 / 3 - 1 / 5) / cells
    gain = float("nan")
    for i in range(iterations):
        gain = algorithm.train()["env_runners"]["episode_return_mean"] * unit
        print(f"iteration {i + 1}: mean gain about {gain:.2f}")
    algorithm.stop()
    ray.shutdown()
    return gain


if __name__ == "__main__":
    main()
