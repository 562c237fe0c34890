"""Stable-Baselines3's DQN learns from 40 cells at once: each cell is one of its environments.

pip install stable-baselines3
python examples/stable_baselines3_dqn.py
"""

from typing import Any

import numpy as np
from stable_baselines3 import DQN
from stable_baselines3.common.vec_env import VecEnv

import swarm


class Cells(VecEnv):
    """`swarm.SpermSwarmVector` in the form that Stable-Baselines3 asks for."""

    def __init__(self, env: swarm.SpermSwarmVector) -> None:
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> np.ndarray:
        return self.env.reset(seed=self._seeds[0])[0]

    def step_async(self, actions: np.ndarray) -> None:
        self.actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        observation, reward, terminated, truncated, info = self.env.step(self.actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(terminated | truncated):  # out of time: what would come still counts
            last = info["final_obs"][i]
            infos[i] = {"terminal_observation": last, "TimeLimit.truncated": not terminated[i]}
        return observation, reward.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        self.env.close()

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.env, attr_name)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        return [getattr(self.env, method_name)(*args, **kwargs)] * self.num_envs


def main(steps: int = 100_000, cells: int = 40, life: float = 200.0) -> float:
    """Learns from `steps` decisions of single cells; returns the mean gain of fresh ones."""
    often = {"learning_starts": 1000, "train_freq": 4, "target_update_interval": 200 * cells}
    slow = {"learning_rate": lambda left: 3e-3 * left, "exploration_fraction": 0.6, "gamma": 0.98}
    model = DQN("MlpPolicy", Cells(swarm.SpermSwarmVector(cells)), batch_size=512, seed=0, **often, **slow)
    model.learn(steps)

    learnt = swarm.FromObservation(lambda seen: model.predict(seen, deterministic=True)[0])
    results = swarm.population_test(swarm.World(), {"dqn": learnt}, life=life)
    print(results["gain"].mean("cell").to_series())
    return float(results["gain"].sel(policy="dqn").mean())


if __name__ == "__main__":
    main()
