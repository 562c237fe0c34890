"""Stable-Baselines3's DQN learns from 40 cells at once: each cell is one of its environments.

pip install stable-baselines3
python examples/stable_baselines3_dqn.py
"""

from stable_baselines3 import DQN

import swarm
from swarm.envs.stable_baselines3 import SpermSwarmVecEnv


def main(steps: int = 100_000, cells: int = 40, life: float = 200.0) -> float:
    """Learns from `steps` decisions of single cells; returns the mean gain of fresh ones."""
    often = {"learning_starts": 1000, "train_freq": 4, "target_update_interval": 200 * cells}
    slow = {"learning_rate": lambda left: 3e-3 * left, "exploration_fraction": 0.6, "gamma": 0.98}
    model = DQN("MlpPolicy", SpermSwarmVecEnv(cells), batch_size=512, seed=0, **often, **slow)
    model.learn(steps)

    learnt = swarm.FromObservation(lambda seen: model.predict(seen, deterministic=True)[0])
    results = swarm.population_test(swarm.World(), {"dqn": learnt}, life=life)
    print(results["gain"].mean("cell").to_series())
    return float(results["gain"].sel(policy="dqn").mean())


if __name__ == "__main__":
    main()
