"""The swarm as an environment of JaxMARL."""

from __future__ import annotations

import functools
from typing import Any

from swarm._support.checks import check_installed

check_installed("the JaxMARL environment needs", "jax", "jaxmarl", extra="jaxmarl")

import jax
import jax.numpy as jnp
from jaxmarl.environments import spaces
from jaxmarl.environments.multi_agent_env import MultiAgentEnv

from swarm.envs.jax.env import EnvState, JaxSwarmEnv, Step

Array = Any
ByAgent = dict[str, Any]


class JaxMARLSwarm(MultiAgentEnv):
    """`JaxSwarmEnv` with the dictionaries of JaxMARL; same arguments.

    Agents are `swimmer_0` …, all of one class. `dones` tells who has finished, out of time or arrived:
    JaxMARL knows one end only, so its learners take no value from beyond. `infos` are (cells,) arrays.
    """

    def __init__(self, n_swimmers: int = 40, **parameters: Any) -> None:
        self.env = JaxSwarmEnv(n_swimmers, **parameters)
        super().__init__(self.env.n_swimmers)
        self.agents = [f"swimmer_{i}" for i in range(self.num_agents)]
        box = self.env.single_observation_space
        seen = spaces.Box(box.low, box.high, box.shape)
        world = self.env.world
        ends = world.action_range
        chosen = spaces.Discrete(world.n_actions) if ends is None else spaces.Box(*ends, (1,))
        self.observation_spaces = dict.fromkeys(self.agents, seen)
        self.action_spaces = dict.fromkeys(self.agents, chosen)

    @functools.partial(jax.jit, static_argnums=0)
    def reset(self, key: Array) -> tuple[ByAgent, EnvState]:
        """Observations by agent, and the state."""
        observation, state = self.env.reset(key)
        return self._by_agent(observation), state

    @functools.partial(jax.jit, static_argnums=0)
    def step(
        self, key: Array, state: EnvState, actions: ByAgent, reset_state: EnvState | None = None
    ) -> tuple[ByAgent, EnvState, ByAgent, ByAgent, ByAgent]:
        """One decision; where all have finished, the next life begins, in `reset_state` if that is given."""
        if reset_state is not None:
            return super().step(key, state, actions, reset_state)
        return self._dictionaries(self.env.step(key, state, self._stacked(actions)))

    @functools.partial(jax.jit, static_argnums=0)
    def step_env(
        self, key: Array, state: EnvState, actions: ByAgent
    ) -> tuple[ByAgent, EnvState, ByAgent, ByAgent, ByAgent]:
        """`step` that leaves finished worlds as they are."""
        return self._dictionaries(self.env.step_env(key, state, self._stacked(actions)))

    def get_obs(self, state: EnvState) -> ByAgent:
        return self._by_agent(self.env.world.observation(state.cells))

    def get_avail_actions(self, state: EnvState) -> ByAgent:
        count = 1 if self.env.world.is_continuous else self.env.world.n_actions
        every = jnp.ones((self.num_agents, count), bool)
        return self._by_agent(every)

    @property
    def name(self) -> str:
        return "sperm_swarm"

    @property
    def agent_classes(self) -> dict[str, list[str]]:
        return {"swimmers": self.agents}

    def _stacked(self, actions: ByAgent) -> Array:
        if missing := [agent for agent in self.agents if agent not in actions]:
            raise ValueError(f"actions must be given for every agent, got none for {', '.join(missing[:3])}")
        return jnp.stack([jnp.reshape(actions[agent], ()) for agent in self.agents])

    def _by_agent(self, rows: Array) -> ByAgent:
        return {agent: rows[i] for i, agent in enumerate(self.agents)}

    def _dictionaries(self, step: Step) -> tuple[ByAgent, EnvState, ByAgent, ByAgent, ByAgent]:
        info = dict(step.info)
        info.pop("final_observation", None)  # JaxMARL's scripts want rows of one number an agent
        dones = self._by_agent(info["finished"]) | {"__all__": jnp.all(info["finished"])}
        return self._by_agent(step.observation), step.state, self._by_agent(step.reward), dones, info
