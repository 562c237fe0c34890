"""Whole lives inside one compiled JAX function: `world.step` under jit, vmap and scan.

pip install jax
python examples/jax_loop.py
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from swarm import Greedy, World
from swarm.physics.starts import Starts, draw_starts
from swarm.policies.policy import Policy
from swarm.population.rollout import rollout

jax.config.update("jax_enable_x64", True)  # as NumPy does; without it JAX computes in float32


def compiled_lives(world: World, policy: Policy) -> Callable[..., jax.Array]:
    """A function of positions (worlds, cells, 2), headings (worlds, cells) and pasts (worlds, cells, N_T)
    that gives the gains (worlds, cells) of whole lives."""

    def lives(position: jax.Array, heading: jax.Array, past: jax.Array) -> jax.Array:
        def decide(state, _):  # a finished cell stays where it is, so the longest life may set the length
            state, outcome = world.step(state, policy.act(world, state, None))
            return state, outcome.gain

        _, gain = jax.lax.scan(decide, world.start(position, heading, past), length=world.max_decisions)
        return gain[-1]

    return jax.jit(jax.vmap(lives))


def numpy_lives(world: World, policy: Policy, starts: Starts) -> np.ndarray:
    """The same gains (cells,) in NumPy."""
    *_, last = rollout(world, policy, starts, seed=0)
    return last.outcome.gain


def main(worlds: int = 8, cells: int = 40, life: float = 80.0) -> float:
    """Compares both; returns their largest difference."""
    world, policy = World(flow="taylor_green", sense_flow=True, life=life), Greedy()
    starts = [draw_starts(world, cells, seed) for seed in range(worlds)]
    stacked = (jnp.asarray(np.stack(arrays)) for arrays in zip(*starts, strict=True))
    gain = compiled_lives(world, policy)(*stacked)
    difference = np.abs(np.stack([numpy_lives(world, policy, each) for each in starts]) - gain).max()
    print(f"mean gain {gain.mean():.3f}; largest difference to NumPy {difference:.1e}")
    return float(difference)


if __name__ == "__main__":
    main()
