"""A population in a plain NumPy loop: no agents, no dictionaries, one array per quantity.

python examples/numpy_loop.py
"""

from __future__ import annotations

import numpy as np

from swarm import Greedy, Swinging, World
from swarm.physics.starts import draw_starts
from swarm.policies.policy import Policy


def live(world: World, policy: Policy, *, cells: int = 40, seed: int = 0) -> np.ndarray:
    """Gains c(t_life) − c(0) (cells,) of the cells' lives under a policy [concentration]."""
    chance = np.random.default_rng(seed)
    state = world.start(*draw_starts(world, cells, seed))
    gain = np.zeros(cells)
    while not state.finished.all():
        action = policy.act(world, state, chance.random(cells))  # (cells,) 0 or 1
        state, outcome = world.step(state, action)  # a new state; the old one stays as it was
        gain = outcome.gain
    return gain


def main() -> None:
    """Greedy beside swinging, on the same starts."""
    world = World(n_records=4, life=200.0)
    for policy in (Greedy(), Swinging()):
        gain = live(world, policy)
        print(f"{policy}: gain {gain.mean():.2f} ± {gain.std():.2f}")


if __name__ == "__main__":
    main()
