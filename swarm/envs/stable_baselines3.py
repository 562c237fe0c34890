"""The Stable-Baselines3 face: every cell is one of the environments of a `VecEnv`, in one shared world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

try:
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError:
    raise ModuleNotFoundError(
        "swarm.envs.stable_baselines3 needs Stable-Baselines3: pip install stable-baselines3"
    ) from None

from swarm.envs.face import RENDER_FPS, with_parameters
from swarm.envs.gymnasium import SpermSwarmVector
from swarm.physics.world import World


class SpermSwarmVecEnv(VecEnv):
    """`n_swimmers` cells as environments of Stable-Baselines3; arguments as `swarm.SpermSwarmVector`.

    A cell's next life begins in the step that ends the last, as Stable-Baselines3 asks: `dones` marks the
    ends, `infos[i]` holds the last observation in `terminal_observation`, and in `TimeLimit.truncated`
    whether more would have come. `infos[i]["gain"]` is c(t) − c(0) [concentration], at an end that of the
    life that ended; `eaten`, `arrival_time` and `won` stand beside it as in the other faces.

    The cells share one world and so its attributes: `get_attr`, `set_attr` and `env_method` ask that world
    once, whatever the indices. `seed(s)` gives all cells the stream s, as a reset of the other faces does.
    """

    @with_parameters
    def __init__(
        self,
        n_swimmers: int = 40,
        *,
        max_cycles: int | None = None,
        render_mode: str | None = None,
        dtype: str = "float64",
        world: World | None = None,
        **parameters: Any,
    ) -> None:
        settings: dict[str, Any] = {"max_cycles": max_cycles, "render_mode": render_mode, "dtype": dtype}
        self.env = SpermSwarmVector(
            n_swimmers, autoreset_mode="SameStep", world=world, **settings, **parameters
        )
        super().__init__(self.env.num_envs, self.env.single_observation_space, self.env.single_action_space)
        metadata: dict[str, Any] = self.metadata
        metadata["render_fps"] = RENDER_FPS

    def reset(self) -> np.ndarray:
        """Begin a life of every cell; returns the observations (cells, N_T · features) float32."""
        observation, info = self.env.reset(seed=self._seeds[0], options=self._options[0] or None)
        self.reset_infos = self._rows(info)
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations (cells, N_T · features), rewards and ends (cells,), and infos of a decision of all."""
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        done, infos = terminated | truncated, self._rows(info)
        for i in np.flatnonzero(done):
            self.reset_infos[i] = infos[i]
            infos[i] = {name: values[i] for name, values in _values(info["final_info"])}
            infos[i]["terminal_observation"] = info["final_obs"][i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
        return observation, reward.astype(np.float32), done, infos

    def close(self) -> None:
        self.env.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """The one picture (height, width, 3) uint8 of the world that all cells share."""
        frames = self.env.render()
        return [None if frames is None else frames[0]]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        returned = getattr(self.env, method_name)(*args, **kwargs)
        return [returned for _ in self._get_indices(indices)]

    def _rows(self, info: dict[str, Any]) -> list[dict[str, Any]]:
        """What is told of each cell now."""
        told = [(name, values) for name, values in _values(info) if not name.startswith("final_")]
        return [{name: values[i] for name, values in told} for i in range(self.num_envs)]


def _values(info: dict[str, Any]) -> list[tuple[str, Any]]:
    """What a vector environment's info tells, without the masks that say of whom."""
    return [(name, values) for name, values in info.items() if not name.startswith("_")]
