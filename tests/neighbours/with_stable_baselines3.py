"""Stable-Baselines3: PPO on one cell by the environment's name, and on several at once."""

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

NAME, LIFE, DECISIONS = "swarm:chemoswarm/SpermSwarm-v0", 8.0, 40


def steps():
    env, count = make_vec_env(NAME, n_envs=3, env_kwargs={"life": LIFE}), 50
    env.reset()
    for _ in range(count):
        env.step([1] * env.num_envs)
    return f"{count} decisions of {env.num_envs} cells in `make_vec_env`"


def trains():
    env = make_vec_env(NAME, n_envs=3, env_kwargs={"life": LIFE})
    model = PPO("MlpPolicy", env, n_steps=DECISIONS, batch_size=40, seed=0)
    model.learn(2 * DECISIONS * env.num_envs)
    assert model._n_updates > 0, "nothing was learnt"
    return f"PPO, {model.num_timesteps} decisions of single cells"
