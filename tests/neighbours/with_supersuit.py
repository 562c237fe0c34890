"""SuperSuit: its wrappers and its vector environment, on which Stable-Baselines3's PPO learns."""

import numpy as np
import supersuit
from stable_baselines3 import PPO

import swarm

CELLS, WORLDS, LIFE, DECISIONS = 4, 2, 8.0, 20


def make_env(base_class):
    env = supersuit.sticky_actions_v0(swarm.parallel_env(CELLS, life=LIFE), repeat_action_probability=0.1)
    env = supersuit.pettingzoo_env_to_vec_env_v1(supersuit.frame_stack_v1(env, 2))
    return supersuit.concat_vec_envs_v1(env, WORLDS, num_cpus=0, base_class=base_class)


def steps():
    env, count = make_env("gymnasium"), 50
    env.reset(seed=0)
    for _ in range(count):
        env.step(np.ones(env.num_envs, int))
    return f"{count} decisions of {env.num_envs} cells in its vector environment"


def trains():
    model = PPO("MlpPolicy", make_env("stable_baselines3"), n_steps=DECISIONS, batch_size=40)
    model.learn(2 * DECISIONS * WORLDS * CELLS)
    assert model._n_updates > 0, "nothing was learnt"
    return f"Stable-Baselines3's PPO, {model.num_timesteps} decisions of single cells"
