"""The PettingZoo face: every cell is an agent of one parallel environment.

| agents | `swimmer_0` … `swimmer_{N−1}`; one that has finished leaves `agents` |
|---|---|
| action | `Discrete(m)`: the curvature of the next interval, 0 the lowest |
| observation | `Box` (N_T · features,) float32: the normalised memory, newest record first |
| reward | change of the memory's mean concentration over the interval, normalised |
| terminated | the cell's path came within reach of the egg |
| truncated | its life is over, it left its field's or flow's domain, or `max_cycles` is reached |
| info | `gain`: c(t) − c(0) [concentration]; `eaten` with a medium; `arrival_time`, `won` in a race |
| state | (N, 4): x, y [length], heading [rad] in [−π, π], curvature of the last interval [1 / length]; \
in space (N, 7): x, y, z and the unit quaternion w, x, y, z that turns the cell's frame into the lab's |
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from pettingzoo import ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec_wrapper
from pettingzoo.utils.env import AECEnv
from pettingzoo.utils.wrappers import AssertOutOfBoundsWrapper, OrderEnforcingWrapper

from swarm._support import streams
from swarm.envs.face import Watched, make_world, with_parameters
from swarm.envs.spaces import action_space, checked_one, observation_space, state_bounds
from swarm.physics.fields import Field
from swarm.physics.flows import Flow
from swarm.physics.world import World


@with_parameters
def parallel_env(
    n_swimmers: int = 40,
    n_records: int = World.n_records,
    field: str | Field = World.field,
    flow: str | Flow = World.flow,
    sense_flow: bool = World.sense_flow,
    varying_speed: bool = World.varying_speed,
    life: float = World.life,
    start_box: tuple[tuple[float, float], ...] | None = World.start_box,
    max_cycles: int | None = None,
    render_mode: str | None = None,
    curvatures: Sequence[float] = World.curvatures,
    speed: float = World.speed,
    speeds: tuple[float, float] = World.speeds,
    time_step: float = World.time_step,
    interval_rule: str = World.interval_rule,
    dtype: str = "float64",
    **parameters: Any,
) -> SpermSwarm:
    """A swarm in one world, as a PettingZoo `ParallelEnv`.

    `n_swimmers` is the number of cells, `max_cycles` truncates after that many decisions, `render_mode` is
    None, "rgb_array" or "human", `dtype` "float64" or "float32" is what positions are computed in. The others
    are the parameters of `swarm.World`; `start_box=None` is the flow's own box or one period of it, else the
    field's own, else [0, 10]². Raises TypeError or ValueError that names the parameter, the rule and the
    value.
    """
    given = {name: value for name, value in locals().items() if name in World.defaults()}
    world = make_world(None, given | parameters)
    return SpermSwarm(world, n_swimmers, max_cycles=max_cycles, render_mode=render_mode, dtype=dtype)


@functools.wraps(parallel_env, assigned=(), updated=())
def raw_env(*args: Any, **kwargs: Any) -> AECEnv:
    """`parallel_env` with agents that act one after another; same arguments."""
    return OrderEnforcingWrapper(InTurns(parallel_env(*args, **kwargs)))


@functools.wraps(parallel_env, assigned=(), updated=())
def env(*args: Any, **kwargs: Any) -> AECEnv:
    """`raw_env` that refuses actions outside the action space at once; same arguments."""
    return OrderEnforcingWrapper(AssertOutOfBoundsWrapper(raw_env(*args, **kwargs)))


class InTurns(parallel_to_aec_wrapper):
    """PettingZoo's conversion, with whatever else the parallel environment has: `world`, `np_random`, …"""

    observation_spaces = property(lambda self: self.env.observation_spaces)
    action_spaces = property(lambda self: self.env.action_spaces)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "env":
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return getattr(self.env, name)


class SpermSwarm(Watched, ParallelEnv):
    """All cells of one world as agents; see the module and `parallel_env`."""

    metadata = Watched.metadata | {"name": "sperm_swarm_v0", "is_parallelizable": True}

    def __init__(
        self,
        world: World,
        n_swimmers: int = 40,
        *,
        max_cycles: int | None = None,
        render_mode: str | None = None,
        dtype: str = "float64",
    ) -> None:
        self._set_up(world, n_swimmers, max_cycles, render_mode, dtype)
        self.possible_agents = [f"swimmer_{i}" for i in range(self.arena.n_swimmers)]
        self.agents: list[str] = []
        self._known = f"swimmer_0 to {self.possible_agents[-1]}"
        self._index = {agent: i for i, agent in enumerate(self.possible_agents)}
        self._live: np.ndarray | None = None  # rows of `agents`; None while nobody has finished
        self.steps = 0  # decisions since the last reset
        self._spaces: dict[Any, Any] = {}  # of the agents that were asked for
        self.np_random = np.random.default_rng()  # for wrappers and users; nothing here draws from it
        low, high = np.nan_to_num(np.array(state_bounds(world), self.arena.dtype))
        cells = self.arena.n_swimmers, 1
        self.state_space = Box(np.tile(low, cells), np.tile(high, cells), dtype=self.arena.dtype)

    def observation_space(self, agent: str) -> Box:
        """Box (N_T · features,) float32 whose finite bounds hold."""
        return self._own(observation_space, agent)

    def action_space(self, agent: str) -> Discrete | Box:
        """Discrete(m), or a Box (1,) of curvatures; see `swarm.envs.spaces`."""
        return self._own(action_space, agent)

    def _own(self, make: Callable[[World], Space[Any]], agent: str) -> Any:
        """An agent's own space, which can be seeded by itself; a hundred thousand at once would take long."""
        if (make, agent) not in self._spaces:
            self._index[agent]  # raises
            self._spaces[make, agent] = make(self.world)
        return self._spaces[make, agent]

    @functools.cached_property
    def observation_spaces(self) -> dict[str, Box]:
        """Every agent's observation space; made when they are asked for."""
        return {agent: self.observation_space(agent) for agent in self.possible_agents}

    @functools.cached_property
    def action_spaces(self) -> dict[str, Discrete | Box]:
        """Every agent's action space; made when they are asked for."""
        return {agent: self.action_space(agent) for agent in self.possible_agents}

    def agent_index(self, agent: str) -> int:
        """The row of an agent in `state()` and in options; raises ValueError where none has the name."""
        if agent not in self._index:
            raise ValueError(f"agent must be one of {self._known}, got {agent!r}")
        return self._index[agent]

    # --- episodes ---

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, float]]]:
        """Begin a life of every cell.

        `seed` begins a stream of episodes; without it the next episode of the stream begins.
        `options["position"]` (N, 2) [length] and `options["heading"]` (N,) [rad], in space (N, 3) and unit
        quaternions (N, 4), set poses, inside the start box or not; other options are ignored.
        """
        observation = self.arena.reset(None if seed is None else streams.check_seed(seed), options)
        if seed is not None:
            self.np_random = np.random.default_rng(seed)
        self.agents, self._live, self.steps = self.possible_agents[:], None, 0
        self._follow()
        infos = self._infos(self.arena.gain, self.agents, None)
        return dict(zip(self.agents, observation, strict=True)), infos

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, np.ndarray], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, float]]
    ]:
        """One decision of every cell in `agents`, whatever its length.

        Every agent in `agents` needs an action; those of finished agents are ignored. Once all have finished
        nothing happens, and five empty dictionaries are returned. Raises TypeError or ValueError where
        something is wrong, and leaves everything as it was.
        """
        self._check_begun()
        action, agents, live = self._unpack(actions), self.agents, self._live
        if not agents:
            return {}, {}, {}, {}, {}
        outcome = self.arena.step(action)
        self.steps += 1
        observation, reward, terminated, truncated, gain = (
            outcome if live is None else (values[live] for values in outcome)
        )
        if self.max_cycles is not None and self.steps >= self.max_cycles:
            truncated = ~terminated
        if (done := terminated | truncated).any():
            self._live = np.flatnonzero(~done) if live is None else live[~done]
            self.agents = [self.possible_agents[i] for i in self._live]
            terminations = dict(zip(agents, terminated.tolist(), strict=True))
            truncations = dict(zip(agents, truncated.tolist(), strict=True))
        else:
            terminations, truncations = dict.fromkeys(agents, False), dict.fromkeys(agents, False)
        self._follow()
        return (
            dict(zip(agents, observation, strict=True)),
            dict(zip(agents, reward.tolist(), strict=True)),
            terminations,
            truncations,
            self._infos(gain, agents, live),
        )

    def _infos(
        self, gain: np.ndarray, agents: list[str], live: np.ndarray | None
    ) -> dict[str, dict[str, float]]:
        """What each agent is told beside its observation."""
        infos = {agent: {"gain": value} for agent, value in zip(agents, gain.tolist(), strict=True)}
        for name, values in self.arena.told().items():
            chosen = values if live is None else values[live]
            for info, value in zip(infos.values(), chosen.tolist(), strict=True):
                info[name] = value
        return infos

    # --- checks ---

    def _unpack(self, actions: dict[str, Any]) -> np.ndarray:
        """Actions (cells,); a finished cell keeps its last."""
        try:
            values = list(map(actions.__getitem__, self.agents))
        except (AttributeError, LookupError, TypeError):
            raise self._wrong_agents(actions) from None
        if len(values) != len(actions) and not actions.keys() <= self._index.keys():
            raise self._wrong_agents(actions)
        chosen = self._numbers(values)
        if self._live is None:
            return chosen
        everyone = self.arena.action.copy()
        everyone[self._live] = chosen
        return everyone

    def _numbers(self, values: list[Any]) -> np.ndarray:
        """The agents' actions; raises unless all are."""
        world = self.world
        if not world.is_continuous:
            try:  # whole numbers in [0, 256)
                chosen = np.frombuffer(bytes(values), np.uint8)
                if chosen.max(initial=0) < world.n_actions:
                    return chosen
            except (TypeError, ValueError):
                pass
        pairs = zip(self.agents, values, strict=True)
        numbers = [checked_one(world, f"the action of {agent}", value) for agent, value in pairs]
        return np.array(numbers, self.arena.dtype if world.is_continuous else None)

    def _wrong_agents(self, actions: Any) -> Exception:
        if not isinstance(actions, dict):
            return TypeError(f"actions must be a dictionary from agents to actions, got {actions!r}")
        for agent in actions:
            if agent not in self._index:
                return ValueError(f"actions must be for {self._known}, got one for {agent!r}")
        missing = [agent for agent in self.agents if agent not in actions]
        more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        listed = ", ".join(missing[:3]) + more
        return ValueError(f"actions must be given for every agent in `agents`, got none for {listed}")
