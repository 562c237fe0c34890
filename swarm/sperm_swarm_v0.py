"""The PettingZoo face: every cell is an agent of one parallel environment.

| agents | `swimmer_0` … `swimmer_{N−1}`; one that has finished leaves `agents` |
|---|---|
| action | `Discrete(m)`: the curvature of the next interval, 0 the lowest |
| observation | `Box` (N_T · features,) float32: the normalised memory, newest record first (see `perception`) |
| reward | change of the memory's mean concentration over the interval, normalised |
| terminated | the cell's path came within reach of the egg |
| truncated | its life is over, it left the domain of its field or flow, or `max_cycles` is reached |
| info | `gain`: c(t) − c(0) [concentration] |
| state | (N, 4): x, y [length], heading in [−π, π] [rad], curvature of the last interval [1 / length] |
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.logger import warn
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv
from pettingzoo.utils import parallel_to_aec
from pettingzoo.utils.env import AECEnv
from pettingzoo.utils.wrappers import AssertOutOfBoundsWrapper, OrderEnforcingWrapper

from swarm import streams
from swarm.checks import check_count, check_name
from swarm.fields import Field
from swarm.flows import Flow
from swarm.starts import draw_noise, draw_starts
from swarm.world import State, World

DTYPES = {"float32": np.float32, "float64": np.float64}
RENDER_MODES = ["human", "rgb_array"]
NOISE_BLOCK = 64  # decisions whose noise is drawn at once
POPULATION: streams.Population = "training"

Box2 = tuple[tuple[float, float], tuple[float, float]]


def parallel_env(
    n_swimmers: int = 40,
    n_records: int = 4,
    field: str | Field = "linear",
    flow: str | Flow = "still",
    sense_flow: bool = False,
    varying_speed: bool = False,
    life: float = 80.0,
    start_box: Box2 | None = None,
    max_cycles: int | None = None,
    render_mode: str | None = None,
    curvatures: Sequence[float] = (3.0, 5.0),
    speed: float = 1.0,
    speeds: tuple[float, float] = (1.1, 0.9),
    time_step: float = 0.02,
    interval_rule: str = "truncated",
    dtype: str = "float64",
    *,
    concentration_noise: float = 0.0,
    curvature_noise: float = 0.0,
    rotational_diffusion: float = 0.0,
) -> SpermSwarm:
    """A swarm in one world, as a PettingZoo `ParallelEnv`.

    `n_swimmers` is the number of cells, `max_cycles` truncates after that many decisions, `render_mode` is None,
    "rgb_array" or "human", `dtype` "float64" or "float32" is what positions are computed in. The others are the
    parameters of `swarm.World`; `start_box=None` is one period of the flow, or [0, 10]² where it has none.
    """
    world = World(
        n_records=n_records,
        field=field,  # type: ignore[arg-type]
        flow=flow,  # type: ignore[arg-type]
        sense_flow=sense_flow,
        varying_speed=varying_speed,
        life=life,
        start_box=start_box,
        curvatures=curvatures,  # type: ignore[arg-type]
        speed=speed,
        speeds=speeds,
        time_step=time_step,
        interval_rule=interval_rule,
        concentration_noise=concentration_noise,
        curvature_noise=curvature_noise,
        rotational_diffusion=rotational_diffusion,
    )
    return SpermSwarm(world, n_swimmers, max_cycles=max_cycles, render_mode=render_mode, dtype=dtype)


@functools.wraps(parallel_env, assigned=(), updated=())
def raw_env(*args: Any, **kwargs: Any) -> AECEnv:
    """`parallel_env` with agents that act one after another; same arguments."""
    return parallel_to_aec(parallel_env(*args, **kwargs))


@functools.wraps(parallel_env, assigned=(), updated=())
def env(*args: Any, **kwargs: Any) -> AECEnv:
    """`raw_env` that refuses actions outside the action space at once; same arguments."""
    return OrderEnforcingWrapper(AssertOutOfBoundsWrapper(raw_env(*args, **kwargs)))


class SpermSwarm(ParallelEnv):
    """All cells of one world as agents; see the module and `parallel_env`."""

    metadata = {
        "name": "sperm_swarm_v0",
        "render_modes": RENDER_MODES,
        "render_fps": 15,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        world: World,
        n_swimmers: int = 40,
        *,
        max_cycles: int | None = None,
        render_mode: str | None = None,
        dtype: str = "float64",
    ) -> None:
        self.world = world
        self.n_swimmers = check_count("n_swimmers", n_swimmers)
        self.max_cycles = None if max_cycles is None else check_count("max_cycles", max_cycles)
        self.render_mode = (
            None if render_mode is None else check_name("render_mode", render_mode, RENDER_MODES)
        )
        self.dtype = DTYPES[check_name("dtype", dtype, DTYPES)]
        self.possible_agents = [f"swimmer_{i}" for i in range(self.n_swimmers)]
        self.agents: list[str] = []
        self._index = {agent: i for i, agent in enumerate(self.possible_agents)}
        bounds = world.observation_bounds
        self._observation_spaces = {
            agent: Box(-bounds, bounds, dtype=np.float32) for agent in self.possible_agents
        }
        self._action_spaces = {agent: Discrete(world.n_actions) for agent in self.possible_agents}
        self.state_space = self._make_state_space()
        self._seed: int | None = None
        self._episode = 0
        self._state: State | None = None
        self._viewer: Any = None

    def observation_space(self, agent: str) -> Box:
        """Box (N_T · features,) float32 whose finite bounds hold."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> Discrete:
        """Discrete(m)."""
        return self._action_spaces[agent]

    # --- episodes ---------------------------------------------------------------------------------------------------

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, float]]]:
        """Begin a life of every cell.

        `seed` begins a stream of episodes, and without it the next episode of the stream begins (of a stream of its own
        where there was no seed yet). `options["position"]` (N, 2) [length] and `options["heading"]` (N,) [rad] set
        poses, inside the start box or not; other options are ignored.
        """
        if seed is not None:
            seed, episode = streams.check_seed(seed), 0
        elif self._seed is not None:
            seed, episode = self._seed, self._episode + 1
        else:  # fresh entropy of the operating system; the global generators stay as they are
            seed, episode = int(np.random.SeedSequence().generate_state(1, np.uint64)[0]), 0
        drawn = draw_starts(self.world, self.n_swimmers, seed, population=POPULATION, episode=episode)
        options = options or {}
        position = self._option(options, "position", drawn.position)
        heading = self._option(options, "heading", drawn.heading)
        self._check_domains(position)
        state = self.world.start(position, heading, drawn.past)
        observation = self.world.observation(state)
        gain = np.zeros(self.n_swimmers, self.dtype)
        self._check_numbers(state, observation, gain)

        self._seed, self._episode, self._cycle = seed, episode, 0
        self._state, self._gain, self._last_action = state, gain, drawn.past[:, 0]
        self.agents = self.possible_agents[:]
        self._live: np.ndarray | None = None  # rows of `agents`; None while nobody has finished
        if self.render_mode is not None:
            self._watch().restart(state)
        return dict(zip(self.agents, observation, strict=True)), self._infos(gain)

    def step(
        self, actions: dict[str, int]
    ) -> tuple[
        dict[str, np.ndarray], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, float]]
    ]:
        """One decision of every cell in `agents`, whatever its length.

        Every agent in `agents` needs an action; those of finished agents are ignored. What is wrong raises TypeError or
        ValueError and leaves everything as it was.
        """
        before = self._current()
        if not self.agents:
            raise RuntimeError("step: every swimmer has finished; call reset to begin the next episode")
        agents, live = self.agents, self._live
        action = self._unpack(actions)
        state, outcome = self.world.step(before, action, self._noise())
        self._check_numbers(state, outcome.observation, outcome.gain)

        self._state, self._gain, self._last_action = state, outcome.gain, action
        self._cycle += 1
        observation, reward, terminated, truncated, gain = (
            outcome if live is None else (x[live] for x in outcome)
        )
        if self.max_cycles is not None and self._cycle >= self.max_cycles:
            truncated = ~terminated
        if (done := terminated | truncated).any():
            self._live = np.flatnonzero(~done) if live is None else live[~done]
            self.agents = [self.possible_agents[i] for i in self._live]
            terminations = dict(zip(agents, terminated.tolist(), strict=True))
            truncations = dict(zip(agents, truncated.tolist(), strict=True))
        else:
            terminations, truncations = dict.fromkeys(agents, False), dict.fromkeys(agents, False)
        if self.render_mode is not None:
            self._watch().follow(state)
        return (
            dict(zip(agents, observation, strict=True)),
            dict(zip(agents, reward.tolist(), strict=True)),
            terminations,
            truncations,
            {agent: {"gain": value} for agent, value in zip(agents, gain.tolist(), strict=True)},
        )

    def state(self) -> np.ndarray:
        """x, y, heading and curvature (N, 4) of every cell, also of those that have finished."""
        now = self._current()
        curvature = np.asarray(self.world.curvatures, self.dtype)[self._last_action]
        return np.column_stack([now.position, self.world.heading_angle(now), curvature])

    # --- pictures ---------------------------------------------------------------------------------------------------

    def render(self) -> np.ndarray | None:
        """The picture (height, width, 3) uint8 with `render_mode="rgb_array"`; shown in a window with "human"."""
        now = self._current()
        if self.render_mode is None:
            warn(
                'render: no render_mode was chosen; make the environment with render_mode="rgb_array" or "human"'
            )
            return None
        viewer = self._watch()
        if not viewer.states:  # a copy of an environment has no pictures of its past
            viewer.restart(now)
        return viewer.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._viewer is not None:
            self._viewer.close()

    def _watch(self) -> Any:
        from swarm.render import Viewer

        if self._viewer is None:
            window = self.render_mode == "human"
            self._viewer = Viewer(self.world, window=window, frames_per_second=self.metadata["render_fps"])
        return self._viewer

    def __getstate__(self) -> dict[str, Any]:
        """Everything but pictures and windows."""
        return self.__dict__ | {"_viewer": None}

    # --- checks -----------------------------------------------------------------------------------------------------

    def _current(self) -> State:
        if self._state is None:
            raise RuntimeError("reset must be called first")
        return self._state

    def _unpack(self, actions: dict[str, int]) -> np.ndarray:
        """Actions (cells,); a finished cell keeps its last."""
        try:
            values = list(map(actions.__getitem__, self.agents))
        except (AttributeError, KeyError):
            raise self._wrong_agents(actions) from None
        if len(values) != len(actions) and not actions.keys() <= self._index.keys():
            raise self._wrong_agents(actions)
        try:  # whole numbers in [0, 256)
            chosen = np.frombuffer(bytes(values), np.uint8)
        except (TypeError, ValueError):
            chosen = None
        if chosen is None or chosen.max() >= self.world.n_actions:
            chosen = self._unpack_slowly(values)
        if self._live is None:
            return chosen
        everyone = self._last_action.copy()
        everyone[self._live] = chosen
        return everyone

    def _unpack_slowly(self, values: list[Any]) -> np.ndarray:
        """Raises unless all values are actions."""
        top = self.world.n_actions - 1
        for agent, value in zip(self.agents, values, strict=True):
            rule = f"the action of {agent} must be a whole number from 0 to {top}, got {value!r}"
            try:
                number = operator.index(value)
            except TypeError:
                raise TypeError(rule) from None
            if not 0 <= number <= top:
                raise ValueError(rule)
        return np.array(values)

    def _wrong_agents(self, actions: Any) -> Exception:
        if not isinstance(actions, dict):
            return TypeError(f"actions must be a dictionary from agents to actions, got {actions!r}")
        for agent in actions:
            if agent not in self._index:
                known = f"swimmer_0 to swimmer_{self.n_swimmers - 1}"
                return ValueError(f"actions must be for {known}, got one for {agent!r}")
        missing = [agent for agent in self.agents if agent not in actions]
        return ValueError(
            f"actions must be given for every agent in `agents`, got none for {_listed(missing)}"
        )

    def _check_numbers(self, state: State, observation: np.ndarray, gain: np.ndarray) -> None:
        """Raises ValueError where a field or flow gave NaN or infinity."""
        # The sum of their squares tells whether any is not finite.
        if math.isfinite(sum(np.vdot(values, values) for values in (observation, state.position, gain))):
            return
        for name, values in (
            ("position", state.position),
            ("concentration", gain),
            ("observation", observation),
        ):
            wrong = ~np.isfinite(values).reshape(self.n_swimmers, -1).all(axis=-1)
            if wrong.any():
                i = int(wrong.argmax())
                x, y = state.position[i]
                what = f"field {self.world.field!r} and flow {self.world.flow!r} must give finite numbers"
                raise ValueError(f"{what}, got {name} {values[i]} for swimmer_{i} at ({x:g}, {y:g})")

    def _option(self, options: dict[str, Any], name: str, drawn: np.ndarray) -> np.ndarray:
        """The option as an array of the shape of what was drawn, else what was drawn."""
        if options.get(name) is None:
            return drawn.astype(self.dtype)
        rule = f"options[{name!r}] must be finite numbers of shape {drawn.shape}"
        try:
            values = np.array(options[name], self.dtype)
        except (TypeError, ValueError):
            raise TypeError(f"{rule}, got {options[name]!r}") from None
        if values.shape != drawn.shape:
            raise ValueError(f"{rule}, got shape {values.shape}")
        if not np.isfinite(values).all():
            raise ValueError(f"{rule}, got {values[~np.isfinite(values)][0]}")
        return values

    def _check_domains(self, position: np.ndarray) -> None:
        for inside in self.world.domains:
            outside = np.flatnonzero(~np.asarray(inside(position)))
            if len(outside):
                x, y = position[outside[0]]
                raise ValueError(
                    f"starts must lie where field and flow are known, got ({x:g}, {y:g}) for swimmer_{outside[0]}"
                )

    # --- helpers ----------------------------------------------------------------------------------------------------

    def _noise(self) -> np.ndarray | None:
        """This decision's random numbers (cells, 3)."""
        if not self.world.has_noise:
            return None
        assert self._seed is not None
        block, row = divmod(self._cycle, NOISE_BLOCK)
        key = (self._seed, self._episode, block)
        if getattr(self, "_noise_key", None) != key:
            self._noise_key = key
            self._noise_block = draw_noise(
                self._seed,
                self.n_swimmers,
                NOISE_BLOCK,
                population=POPULATION,
                episode=self._episode,
                block=block,
            ).astype(self.dtype)
        return self._noise_block[:, row]

    def _infos(self, gain: np.ndarray) -> dict[str, dict[str, float]]:
        return {agent: {"gain": value} for agent, value in zip(self.agents, gain.tolist(), strict=True)}

    def _make_state_space(self) -> Box:
        anywhere, kappa = float(np.finfo(self.dtype).max), self.world.curvatures
        low, high = [-anywhere, -anywhere, -np.pi, kappa[0]], [anywhere, anywhere, np.pi, kappa[-1]]
        shape = (self.n_swimmers, 4)
        return Box(
            np.broadcast_to(low, shape).astype(self.dtype),
            np.broadcast_to(high, shape).astype(self.dtype),
            dtype=self.dtype,
        )


def _listed(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
