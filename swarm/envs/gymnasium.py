"""The Gymnasium faces: a vector environment whose sub-environments are cells, and one cell alone."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from swarm._support.checks import check_count, check_name, check_options
from swarm._support.streams import check_seed
from swarm.envs.arena import Seed
from swarm.envs.face import Watched, make_world, with_parameters
from swarm.envs.spaces import action_space, checked, checked_one, observation_space
from swarm.physics.world import World

AUTORESET_MODES = {mode.value: mode for mode in AutoresetMode}


class SpermSwarmVector(Watched, VectorEnv):
    """`n_swimmers` cells in one world, each an environment of its own; arguments as `swarm.parallel_env`.

    A cell whose life has ended begins its next by itself, at its row of the next episode's starts, while the
    others go on. `autoreset_mode` says when, as in Gymnasium:

    - "NextStep", the default as in Gymnasium: in the step after, whatever the action, with reward 0.
    - "SameStep": in the step that ends the life. The observation is already the new life's first; the last
      of the old is in `info["final_obs"]`, its gain in `info["final_info"]["gain"]`, for the cells that
      `info["_final_obs"]` marks.
    - "Disabled": in `reset(options={"reset_mask": cells})`, until which no step is possible.

    `info["gain"]` is c(t) − c(0) of every cell [concentration]; `eaten`, `arrival_time` and `won` stand
    beside it as in the PettingZoo face. A cell that begins its next life joins the medium as it is; where
    all do, it is new.

    In a race, and in a shared world that changes with time or whose grid follows the cells, no cell can begin
    before the others: one that has finished waits (`info["waiting"]`), with reward 0, and the ends of all
    lives are told in the step that ends the last.
    """

    @with_parameters
    def __init__(
        self,
        n_swimmers: int = 40,
        *,
        max_cycles: int | None = None,
        render_mode: str | None = None,
        dtype: str = "float64",
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        world: World | None = None,
        **parameters: Any,
    ) -> None:
        self._set_up(make_world(world, parameters), n_swimmers, max_cycles, render_mode, dtype)
        if not isinstance(autoreset_mode, AutoresetMode):
            autoreset_mode = AUTORESET_MODES[check_name("autoreset_mode", autoreset_mode, AUTORESET_MODES)]
        self.autoreset_mode = self.metadata["autoreset_mode"] = autoreset_mode
        self.num_envs = self.arena.n_swimmers
        self.single_observation_space = observation_space(self.world)
        self.single_action_space = action_space(self.world)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._done = np.zeros(self.num_envs, bool)  # lives that are over
        self._together = _begins_together(self.world)
        self._waiting = np.zeros((2, self.num_envs), bool)  # terminated, truncated, and not told yet

    def reset(
        self, *, seed: Seed = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a life of every cell; returns observations (cells, N_T · features) float32 and info.

        `seed` begins a stream of episodes; without it the next episode of the stream begins. A list of a seed
        or None for each cell gives each its own stream, that of the single environment with that seed; with
        None a cell's own stream goes on, or one that is drawn begins.
        `options["position"]` (cells, 2) [length] and `options["heading"]` (cells,) [rad], in space (cells, 3)
        and unit quaternions (cells, 4), set poses; with `options["reset_mask"]` (cells,) bool only those
        cells begin their next life, at their rows of the poses. Others are ignored.
        """
        cells = self._reset_mask(seed, options)
        if cells is None:
            observation = self.arena.reset(seed, options)
            self._done = np.zeros(self.num_envs, bool)
        else:
            observation = self.arena.restart(cells, options)
            self._done = self._done & ~cells
        self._waiting = np.zeros_like(self._waiting)
        super().reset(seed=None if seed is None else self.arena.seeds[0])
        self._follow()
        return observation, self._info()

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One decision of every cell; rewards, terminations and truncations are (cells,).

        Raises TypeError or ValueError where an action is none, and leaves everything as it was.
        """
        self._check_begun()
        given, over = np.asarray(actions), self._done
        if self.world.is_continuous and given.dtype.kind in "iu":
            given = given.astype(self.arena.dtype)
        chosen = checked(self.world, given, (self.num_envs,))
        action = np.where(self.arena.state.finished, self.arena.action, chosen)
        if over.any() and self.autoreset_mode is AutoresetMode.DISABLED:
            names = ", ".join(f"swimmer_{i}" for i in np.flatnonzero(over)[:3])
            raise RuntimeError(f"step: the lives of {names} are over; call reset with options['reset_mask']")
        arena = copy.copy(self.arena)  # kept only if nothing goes wrong
        observation, reward, terminated, truncated, _ = arena.step(action)
        if self.max_cycles is not None:
            truncated = truncated | ((arena.decision >= self.max_cycles) & ~terminated)
            arena.state = arena.state._replace(finished=arena.state.finished | truncated)
        if over.any():
            observation = arena.restart(over)
            reward, terminated, truncated = np.where(over, 0, reward), terminated & ~over, truncated & ~over
        waiting = self._waiting
        if self._together:
            reward = np.where(waiting.any(axis=0), 0, reward)
            terminated, truncated, waiting = _held_back(terminated, truncated, waiting)
        done = terminated | truncated
        info = {}
        if done.any() and self.autoreset_mode is AutoresetMode.SAME_STEP:
            info = self._final(done, observation, {"gain": arena.gain} | arena.told())
            observation = arena.restart(done)
            self._done = np.zeros(self.num_envs, bool)
        else:
            self._done = done
        self.arena, self._waiting = arena, waiting
        self._follow()
        return observation, reward, terminated, truncated, info | self._info()

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The picture (height, width, 3) uint8 of the world that they share once for every cell, with
        "rgb_array"; "human" shows it.
        """
        picture = super().render()
        return None if picture is None else (picture,) * self.num_envs

    def _info(self) -> dict[str, Any]:
        found = {"gain": self.arena.gain} | self.arena.told()
        if self._together:
            found["waiting"] = np.any(self._waiting, axis=0)
        everyone = {f"_{name}": np.ones(self.num_envs, bool) for name in found}
        return {name: values.copy() for name, values in found.items()} | everyone

    def _final(
        self, done: np.ndarray, observation: np.ndarray, told: dict[str, np.ndarray]
    ) -> dict[str, Any]:
        """What a life ended with, in the form that Gymnasium's own vector environments give it."""
        last = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(done):
            last[i] = observation[i].copy()
        return {
            "final_obs": last,
            "_final_obs": done.copy(),
            "final_info": {
                name: np.where(done, values, np.zeros_like(values)) for name, values in told.items()
            }
            | {f"_{name}": done.copy() for name in told},
            "_final_info": done.copy(),
        }

    def _reset_mask(self, seed: Seed, options: dict[str, Any] | None) -> np.ndarray | None:
        options = check_options(options)
        if options.get("reset_mask") is None:
            return None
        cells = options["reset_mask"]
        if not isinstance(cells, np.ndarray) or cells.dtype != bool or cells.shape != (self.num_envs,):
            raise ValueError(
                f"options['reset_mask'] must be a bool array of shape ({self.num_envs},), got {cells!r}"
            )
        if not cells.any():
            raise ValueError("options['reset_mask'] must choose at least one cell, got none")
        if seed is not None:
            raise ValueError(f"seed must be None with options['reset_mask'], got {seed!r}")
        self._check_begun()
        if self._together and not cells.all():
            rule = "options['reset_mask'] must choose all cells where none can begin before the others"
            raise ValueError(f"{rule}, got {int(cells.sum())} of {self.num_envs}")
        return cells


def _begins_together(world: World) -> bool:
    """Whether no cell can begin its next life before all do: where they race, or share what changes with time
    by itself or moves with them.
    """
    moves = not world.is_steady or (world.medium is not None and world.medium.leaving == "follow")
    return world.first_arrivals is not None or (world.is_shared and moves)


def _held_back(
    terminated: np.ndarray, truncated: np.ndarray, waiting: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends (cells,) to be told, all once all have come, else none; and (2, cells) those that wait now."""
    ended = np.array([terminated | waiting[0], (truncated & ~waiting[0]) | waiting[1]])
    untold = np.zeros_like(ended)
    return (*ended, untold) if ended.any(axis=0).all() else (*untold, ended)


def vector_env(
    num_envs: int = 40, *, max_episode_steps: int | None = None, **kwargs: Any
) -> SpermSwarmVector:
    """`SpermSwarmVector` under the names for its size and `max_cycles` that `gymnasium.make_vec` uses."""
    if "n_swimmers" in kwargs:
        raise TypeError(
            f"num_envs is the number of cells: leave out n_swimmers, got {kwargs['n_swimmers']!r}"
        )
    return SpermSwarmVector(check_count("num_envs", num_envs), **({"max_cycles": max_episode_steps} | kwargs))


class SpermSwimmer(Watched, gymnasium.Env):
    """One cell in a world of its own; arguments otherwise as `swarm.parallel_env`.

    It is what `gymnasium.make("chemoswarm/SpermSwarm-v0")` makes. With the same seed it lives the life of
    `swimmer_0` of the other faces; its spaces, rewards and ends are those of one of their cells, its info is
    that cell's: `gain` and, where there are such, `eaten`, `arrival_time` and `won`.
    """

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
        self._set_up(make_world(world, parameters), 1, max_cycles, render_mode, dtype)
        self.observation_space = observation_space(self.world)
        self.action_space = action_space(self.world)
        self._done = False

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
        self._check_begun()
        if self._done:
            raise RuntimeError("step: the life is over; call reset")
        chosen = checked_one(self.world, "action", action)
        arena = copy.copy(self.arena)  # kept only if nothing goes wrong
        observation, reward, terminated, truncated, _ = arena.step(np.array([chosen]))
        ended, over = bool(terminated[0]), bool(truncated[0])
        if self.max_cycles is not None:
            over = over or (not ended and int(arena.decision[0]) >= self.max_cycles)
        self.arena, self._done = arena, ended or over
        self._follow()
        return observation[0], float(reward[0]), ended, over, self._info()

    def _info(self) -> dict[str, Any]:
        told = {"gain": self.arena.gain} | self.arena.told()
        return {name: values[0].item() for name, values in told.items()}
