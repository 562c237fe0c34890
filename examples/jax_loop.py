"""Whole lives inside one compiled JAX function: the environment, and `World.step` alone.

pip install jax
python examples/jax_loop.py
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from swarm import Greedy, World
from swarm.envs.jax import JaxSwarmEnv
from swarm.physics.starts import draw_starts
from swarm.policies.policy import Policy
from swarm.population.rollout import rollout

jax.config.update("jax_enable_x64", True)  # as NumPy does; without it JAX computes in float32


def mean_reward(env: JaxSwarmEnv, policy: Policy, key: jax.Array, worlds: int, decisions: int) -> jax.Array:
    """Mean reward of so many decisions in many worlds, each of which begins anew when its cells are done."""

    def decide(state, key):
        action = policy.act(env.world, state.cells, None)  # or a network's, of the observation
        step = jax.vmap(env.step)(jax.random.split(key, worlds), state, action)
        return step.state, step.reward.mean()

    _, state = jax.vmap(env.reset)(jax.random.split(key, worlds))
    return jax.lax.scan(decide, state, jax.random.split(key, decisions))[1].mean()


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


def main(worlds: int = 8, cells: int = 40, life: float = 80.0) -> float:
    """Lives in the environment; then the same lives in JAX and NumPy, whose largest difference it returns."""
    world, policy = World(flow="taylor_green", sense_flow=True, life=life), Greedy()
    env = JaxSwarmEnv(cells, life=life)  # in still water, which compiles sooner
    reward = jax.jit(mean_reward, static_argnums=(0, 1, 3, 4))(
        env, policy, jax.random.key(0), worlds, 2 * env.max_steps
    )
    starts = [draw_starts(world, cells, seed) for seed in range(worlds)]
    gain = compiled_lives(world, policy)(*(jnp.asarray(np.stack(each)) for each in zip(*starts, strict=True)))
    ends = [list(rollout(world, policy, each, seed=0))[-1].outcome.gain for each in starts]  # in NumPy
    difference = np.abs(np.stack(ends) - gain).max()
    print(f"mean reward {reward:.3f}, gain {gain.mean():.3f}; largest difference to NumPy {difference:.1e}")
    return float(difference)


if __name__ == "__main__":
    main()
