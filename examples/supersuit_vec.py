"""SuperSuit's wrappers around the PettingZoo environment, and its vector environment: cells that react late.

pip install supersuit
python examples/supersuit_vec.py
"""

import numpy as np
import supersuit

import swarm


def make_vector(late: float, *, worlds: int = 2, cells: int = 20, life: float = 80.0):
    """`worlds` · `cells` environments in which every action is, with the chance `late`, the one before.

    Worlds must let all cells live equally long: `black_death_v3`, for those that do not, waits in SuperSuit
    3.11 until every agent is both terminated and truncated, which never happens.
    """
    env = swarm.parallel_env(cells, life=life)
    env = supersuit.sticky_actions_v0(env, repeat_action_probability=late)
    env = supersuit.pettingzoo_env_to_vec_env_v1(env)
    return supersuit.concat_vec_envs_v1(env, worlds, num_cpus=0, base_class="gymnasium")


def greedy(observation: np.ndarray, action: np.ndarray) -> np.ndarray:
    """Tight arcs at the largest of the remembered values, wide ones at the smallest, or as before."""
    concentrations = observation[:, ::2]  # every other number is a curvature
    newest = concentrations[:, 0]
    rising, falling = newest >= concentrations.max(axis=1), newest <= concentrations.min(axis=1)
    return np.where(rising, 1, np.where(falling, 0, action))


def play(late: float, **settings) -> float:
    """Mean gain of all cells, one decision before their lives end: then SuperSuit begins the next."""
    env = make_vector(late, **settings)
    observation, _ = env.reset(seed=0)
    action = (observation[:, 1] > 0).astype(int)
    gain = 0.0
    while True:
        action = greedy(observation, action)
        observation, _, terminated, truncated, infos = env.step(action)
        if terminated.any() or truncated.any():
            env.close()
            return gain
        gain = float(np.mean([info["gain"] for info in infos]))


def main(chances: tuple[float, ...] = (0.0, 0.1, 0.2, 0.4), **settings) -> dict[float, float]:
    """Mean gain of greedy cells by how often they react late."""
    gains = {late: play(late, **settings) for late in chances}
    for late, gain in gains.items():
        print(f"late with a chance of {late:.0%}: mean gain {gain:.2f}")
    return gains


if __name__ == "__main__":
    main()
