"""PettingZoo's name of the environment: `parallel_env`, `env` and `raw_env`."""

from swarm.envs.pettingzoo import SpermSwarm, env, parallel_env, raw_env

__all__ = ["SpermSwarm", "env", "parallel_env", "raw_env"]
