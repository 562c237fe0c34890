"""The JAX environment against a loop written by hand: what autoreset, draws and infos add.

Both steer 1024 × 40 cells greedily through whole lives under `jit` and `scan`; the loop by hand calls
`World.step` and begins nothing anew.
"""

from __future__ import annotations

import functools
from typing import Any

WORLDS, CELLS, DECISIONS = 1024, 40, 16
CASES = {"still water": {}, "Taylor–Green, flow sensed": {"flow": "taylor_green", "sense_flow": True}}


def run(seconds: float = 5.0) -> list[dict[str, Any]]:
    """All rows."""
    import jax

    from benchmarks.timing import best_times
    from swarm import Greedy
    from swarm.envs.jax import JaxSwarmEnv

    rows = []
    for name, parameters in CASES.items():
        env, policy = JaxSwarmEnv(CELLS, **parameters), Greedy()
        world = env.world

        def by_hand(cells: Any, keys: Any, world: Any = world, policy: Any = policy) -> Any:
            def decide(cells: Any, _: Any) -> Any:
                cells, outcome = world.step(cells, policy.act(world, cells, None))
                return cells, outcome.reward.mean()

            return jax.lax.scan(decide, cells, length=DECISIONS)

        def by_env(state: Any, keys: Any, env: Any = env, policy: Any = policy) -> Any:
            def decide(state: Any, key: Any) -> Any:
                action = policy.act(env.world, state.cells, None)
                step = jax.vmap(env.step)(jax.random.split(key, WORLDS), state, action)
                return step.state, step.reward.mean()

            return jax.lax.scan(decide, state, keys)

        _, state = jax.vmap(env.reset)(jax.random.split(jax.random.key(0), WORLDS))
        keys = jax.random.split(jax.random.key(1), DECISIONS)
        both = {"hand": (jax.jit(jax.vmap(by_hand, (0, None))), state.cells), "env": (jax.jit(by_env), state)}
        calls = {each: functools.partial(_run, *both[each], keys) for each in both}
        times = best_times(calls, seconds=seconds)
        decisions = WORLDS * CELLS * DECISIONS
        rows.append(
            {
                "case": name,
                "by hand, decisions per second": decisions / times["hand"],
                "environment, decisions per second": decisions / times["env"],
                "ratio of times": times["env"] / times["hand"],
                "target": 1.0,
            }
        )
    return rows


def _run(function: Any, state: Any, keys: Any) -> Any:
    """Its result, once it is there."""
    return function(state, keys)[1].block_until_ready()
