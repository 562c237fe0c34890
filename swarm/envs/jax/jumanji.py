"""The swarm as an environment of Jumanji, with what Mava asks of one besides."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

from swarm._support.checks import check_installed

check_installed("the Jumanji environment needs", "jax", "jumanji", extra="jumanji")

import jax
import jax.numpy as jnp
import numpy as np
from jumanji import Environment, specs
from jumanji.types import StepType, TimeStep, restart

from swarm.envs.jax.env import EnvState, JaxSwarmEnv
from swarm.envs.spaces import told

Array = Any


class Observation(NamedTuple):
    """What cells see, under the names that Mava uses."""

    agents_view: Array  # (cells, N_T · features) float32
    action_mask: Array  # (cells, actions) bool: every action, always
    step_count: Array  # (cells,) int32: decisions of the present life


class JumanjiState(NamedTuple):
    """What `JumanjiSwarm` carries from one decision to the next."""

    env: EnvState
    key: Array


class JumanjiSwarm(Environment):
    """`JaxSwarmEnv` with the time steps and specs of Jumanji; same arguments.

    Rewards and discounts are (cells,). The discount of a cell that has finished is 0, but 1 in the decision
    in which its time is up, so that the value of its last observation counts. The episode ends with the last
    life; Jumanji's wrappers begin the next. `extras` hold what `JaxSwarmEnv` has as `info`.
    """

    def __init__(self, n_swimmers: int = 40, **parameters: Any) -> None:
        self.env = JaxSwarmEnv(n_swimmers, **parameters)
        self.num_agents = self.env.n_swimmers
        self.time_limit = self.env.max_steps
        self.action_dim = 1 if self.env.world.is_continuous else self.env.world.n_actions
        super().__init__()

    def __repr__(self) -> str:
        return f"JumanjiSwarm({self.num_agents}, {self.env.world!r})"

    def reset(self, key: Array) -> tuple[JumanjiState, TimeStep]:
        """The state and the first time step of a life of every cell."""
        now, key = jax.random.split(key)
        observation, state = self.env.reset(now)
        cells = jnp.zeros(self.num_agents, bool)
        extras = {"gain": state.gain, "valid": ~cells, "finished": cells} | told(self.env.world, state.cells)
        step = restart(self._observation(observation, state), extras, (self.num_agents,), jnp.float32)
        return JumanjiState(state, key), step

    def step(self, state: JumanjiState, action: Array) -> tuple[JumanjiState, TimeStep]:
        """One decision of every cell, `action` (cells,)."""
        now, key = jax.random.split(state.key)
        step = self.env.step_env(now, state.env, action)
        over = jnp.all(step.info["finished"])
        alive_or_late = ~(step.info["finished"] & ~step.truncated)
        time_step = TimeStep(
            step_type=jnp.where(over, StepType.LAST, StepType.MID),
            reward=step.reward.astype(jnp.float32),
            discount=alive_or_late.astype(jnp.float32),
            observation=self._observation(step.observation, step.state),
            extras=step.info,
        )
        return JumanjiState(step.state, key), time_step

    def render(self, state: JumanjiState) -> np.ndarray:
        return self.env.render(state.env)

    @cached_property
    def observation_spec(self) -> specs.Spec:
        box, cells = self.env.single_observation_space, self.num_agents
        shape = cells, *box.shape
        low, high = (np.broadcast_to(each, shape) for each in (box.low, box.high))
        return specs.Spec(
            Observation,
            "ObservationSpec",
            agents_view=specs.BoundedArray(shape, jnp.float32, low, high, "agents_view"),
            action_mask=specs.BoundedArray((cells, self.action_dim), bool, False, True, "action_mask"),
            step_count=specs.BoundedArray((cells,), jnp.int32, 0, self.time_limit, "step_count"),
        )

    @cached_property
    def action_spec(self) -> specs.Array:
        """An action for every cell: (cells,), of curvatures (cells, 1)."""
        if (ends := self.env.world.action_range) is not None:
            return specs.BoundedArray((self.num_agents, 1), jnp.float32, *ends, "action")
        return specs.MultiDiscreteArray(jnp.full(self.num_agents, self.action_dim, jnp.int32), name="action")

    @cached_property
    def reward_spec(self) -> specs.Array:
        return specs.Array((self.num_agents,), jnp.float32, "reward")

    @cached_property
    def discount_spec(self) -> specs.BoundedArray:
        return specs.BoundedArray((self.num_agents,), jnp.float32, 0.0, 1.0, "discount")

    def _observation(self, view: Array, state: EnvState) -> Observation:
        cells = self.num_agents
        every = jnp.ones((cells, self.action_dim), bool)
        return Observation(view, every, jnp.full(cells, state.decision, jnp.int32))
