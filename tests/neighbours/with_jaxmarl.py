"""JaxMARL: its statistics around `JaxMARLSwarm`, and REINFORCE with one layer for all cells."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxmarl.wrappers.baselines import LogWrapper

from swarm.envs.jax.jaxmarl import JaxMARLSwarm

WORLDS, CELLS, LIFE, DECISIONS, UPDATES = 16, 4, 8.0, 20, 3

ENV = LogWrapper(JaxMARLSwarm(CELLS, life=LIFE))


@jax.jit
@partial(jax.vmap, in_axes=(None, 0))
def rollout(weights, key):
    """What was seen, done and earned (worlds, decisions, cells, …)."""
    begin, key = jax.random.split(key)

    def decide(carry, key):
        seen, state = carry
        rows = jnp.stack([seen[agent] for agent in ENV.agents])
        choose, go = jax.random.split(key)
        action = jax.random.categorical(choose, rows @ weights)
        seen, state, reward, _, _ = ENV.step(go, state, dict(zip(ENV.agents, action, strict=True)))
        return (seen, state), (rows, action, jnp.stack([reward[agent] for agent in ENV.agents]))

    return jax.lax.scan(decide, ENV.reset(begin), jax.random.split(key, DECISIONS))[1]


def loss(weights, seen, action, reward):
    """Of which the gradient is REINFORCE's."""
    to_come = jnp.cumsum(reward[:, ::-1], axis=1)[:, ::-1]
    chosen = jnp.take_along_axis(jax.nn.log_softmax(seen @ weights), action[..., None], -1)[..., 0]
    return -(chosen * (to_come - to_come.mean())).mean()


def first_weights():
    return jnp.zeros((ENV.observation_space(ENV.agents[0]).shape[0], 2))


def steps():
    _, action, _ = rollout(first_weights(), jax.random.split(jax.random.key(0), WORLDS))
    return f"{action.shape[1]} decisions of {WORLDS} × {CELLS} cells, compiled"


def trains():
    weights = first_weights()
    for update in range(UPDATES):
        found = rollout(weights, jax.random.split(jax.random.key(update), WORLDS))
        weights -= 0.1 * jax.grad(loss)(weights, *found)
    assert bool((weights != 0).any()), "nothing was learnt"
    return f"REINFORCE of its program's own, {UPDATES} × {DECISIONS} decisions of {WORLDS} × {CELLS} cells"
