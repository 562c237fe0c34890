"""The Gymnasium face of one cell: an ordinary environment, for what knows one agent and no more."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from swarm._support.streams import check_seed
from swarm.envs.arena import RENDER_FPS, RENDER_MODES, Arena, Watched, make_world, with_parameters
from swarm.envs.spaces import action_space, checked_one, rule_of
from swarm.physics.world import World


class SpermSwimmer(Watched, gymnasium.Env):
    """One cell in a world of its own; arguments otherwise as `swarm.parallel_env`.

    It is what `gymnasium.make("chemoswarm/SpermSwarm-v0")` makes. With the same seed it lives the life of
    `swimmer_0` of the other faces; its spaces, rewards and ends are those of one of their cells, its info is
    that cell's: `gain` and, where there are such, `eaten`, `arrival_time` and `won`.
    """

    metadata = {"render_modes": RENDER_MODES, "render_fps": RENDER_FPS}

    @with_parameters
    def __init__(
        self,
        *,
        max_cycles: int | None = None,
        render_mode: str | None = None,
        dtype: str = "float64",
        world: World | None = None,
        **parameters: Any,
    ) -> None:
        self.world = make_world(world, parameters)
        self.arena = Arena(self.world, 1, dtype)
        self._set_up(max_cycles, render_mode)
        bounds = self.world.observation_bounds
        self.observation_space = Box(-bounds, bounds, dtype=np.float32)
        self.action_space = action_space(self.world)
        self._done: bool | None = None  # None before the first reset

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a life; returns the observation (N_T · features,) float32 and info.

        `seed` begins a stream of episodes; without it the next episode of the stream begins.
        `options["position"]` (1, 2) [length] and `options["heading"]` (1,) [rad], in space (1, 3) and a unit
        quaternion (1, 4), set the pose; other options are ignored.
        """
        observation = self.arena.reset(None if seed is None else check_seed(seed), options)
        super().reset(seed=None if seed is None else self.arena.seeds[0])
        self._done = False
        self._follow()
        return observation[0], self._info()

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One decision; raises ValueError or TypeError where the action is none, RuntimeError where no life
        has begun or it is over, and leaves everything as it was.
        """
        if self._done is not False:
            raise RuntimeError("step: the life is over; call reset" if self._done else _UNBEGUN)
        if not self.world.is_continuous and not self.action_space.contains(action):
            raise ValueError(f"action must be {rule_of(self.world)}, got {action!r}")
        chosen = checked_one(self.world, "action", action)
        arena = copy.copy(self.arena)  # kept only if nothing goes wrong
        observation, reward, terminated, truncated, _ = arena.step(np.array([chosen]))
        ended, over = bool(terminated[0]), bool(truncated[0])
        if self.max_cycles is not None:
            over = over or (not ended and int(arena.decision[0]) >= self.max_cycles)
        self.arena, self._done = arena, ended or over
        self._follow()
        return observation[0], float(reward[0]), ended, over, self._info()

    def state(self) -> np.ndarray:
        """The cell's state (1, 4), in space (1, 7), as the PettingZoo face has it."""
        self._check_begun()
        return self.arena.table()

    def render(self) -> np.ndarray | None:
        """The picture (height, width, 3) uint8 with "rgb_array"; "human" shows it in a window."""
        self._check_begun()
        return self._picture()

    def close(self) -> None:
        """Close the window, if there is one."""
        self._close()

    def _check_begun(self) -> None:
        if self._done is None:
            raise RuntimeError(_UNBEGUN)

    def _info(self) -> dict[str, Any]:
        told = {"gain": self.arena.gain} | self.arena.told()
        return {name: values[0].item() for name, values in told.items()}


_UNBEGUN = "reset must be called first"
