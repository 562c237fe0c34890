"""SuperSuit's wrappers around the PettingZoo environment, and its vector environment: cells that react late.

Wide arcs are fast and tight ones slow, so lives are of unequal numbers of decisions: `black_death_v3` gives
cells that have finished zeros until all have.

pip install supersuit
python examples/supersuit_vec.py
"""

import numpy as np
import supersuit

import swarm


def make_vector(late: float, *, worlds: int = 2, cells: int = 20, life: float = 80.0):
    """`worlds` · `cells` environments in which every action is, with the chance `late`, the one before."""
    env = swarm.parallel_env(cells, life=life, varying_speed=True)
    env = supersuit.sticky_actions_v0(env, repeat_action_probability=late)
    env = supersuit.black_death_v3(env)
    env = supersuit.pettingzoo_env_to_vec_env_v1(env)
    return supersuit.concat_vec_envs_v1(env, worlds, num_cpus=0, base_class="gymnasium")


def greedy(observation: np.ndarray, action: np.ndarray) -> np.ndarray:
    """Tight arcs at the largest of the remembered values, wide ones at the smallest, or as before."""
    concentrations = observation[:, ::2]  # every other number is a curvature
    newest = concentrations[:, 0]
    rising, falling = newest >= concentrations.max(axis=1), newest <= concentrations.min(axis=1)
    return np.where(rising, 1, np.where(falling, 0, action))


def play(late: float, **settings) -> float:
    """Mean gain of all cells at the ends of their lives; after the last, SuperSuit begins the next."""
    env = make_vector(late, **settings)
    observation, _ = env.reset(seed=0)
    action = (observation[:, 1] > 0).astype(int)
    gains = np.zeros(len(observation))
    while True:
        action = greedy(observation, action)
        observation, _, terminated, truncated, infos = env.step(action)
        if terminated.any() or truncated.any():
            env.close()
            return float(gains.mean())
        gains = np.array([info.get("gain", gain) for info, gain in zip(infos, gains, strict=True)])


def main(chances: tuple[float, ...] = (0.0, 0.1, 0.2, 0.4), **settings) -> dict[float, float]:
    """Mean gain of greedy cells by how often they react late."""
    gains = {late: play(late, **settings) for late in chances}
    for late, gain in gains.items():
        print(f"late with a chance of {late:.0%}: mean gain {gain:.2f}")
    return gains


if __name__ == "__main__":
    main()
