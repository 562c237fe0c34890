"""The swarm as a task of BenchMARL."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from swarm._support.checks import check_installed

check_installed("the BenchMARL task needs", "torch", "benchmarl", extra="benchmarl")

from benchmarl.environments.common import TaskClass
from torchrl.data import Composite
from torchrl.envs import EnvBase, FlattenObservation, Transform

from swarm.envs.torchrl import GROUP, SwarmEnv


class SwarmTask(TaskClass):
    """A task whose `config` holds the arguments of `SwarmEnv` but `n_worlds`, `device` and `seed`.

    With `return_state` in it, central critics are given the state of all cells (4 n_swimmers,), else all
    observations. All cells of a world should live equally long, because BenchMARL does not leave finished
    ones out.
    """

    def __init__(self, name: str = "sperm_swarm", config: dict[str, Any] | None = None) -> None:
        super().__init__(name, config)

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        config = dict(self.config)
        return lambda: SwarmEnv(num_envs, device, seed=seed, **config)

    def supports_continuous_actions(self) -> bool:
        return bool(self.config.get("action") == "continuous")

    def supports_discrete_actions(self) -> bool:
        return not self.supports_continuous_actions()

    def has_render(self, env: EnvBase) -> bool:
        return find_spec("matplotlib") is not None

    def max_steps(self, env: EnvBase) -> int:
        return env.max_steps

    def group_map(self, env: EnvBase) -> dict[str, list[str]]:
        return env.group_map

    def observation_spec(self, env: EnvBase) -> Composite:
        whole = env.full_observation_spec_unbatched[GROUP]
        group = Composite({"observation": whole["observation"].clone()}, shape=whole.shape)
        return Composite({GROUP: group})

    def state_spec(self, env: EnvBase) -> Composite | None:
        spec = env.full_observation_spec_unbatched
        return Composite({"state": spec["state"].clone()}) if "state" in spec.keys() else None  # noqa: SIM118

    def info_spec(self, env: EnvBase) -> Composite | None:
        return None

    def action_mask_spec(self, env: EnvBase) -> Composite | None:
        return None

    def action_spec(self, env: EnvBase) -> Composite:
        return env.full_action_spec_unbatched

    def get_env_transforms(self, env: EnvBase) -> list[Transform]:
        with_state = "state" in env.full_observation_spec_unbatched.keys()  # noqa: SIM118
        return [FlattenObservation(-2, -1, in_keys=["state"])] if with_state else []

    @staticmethod
    def env_name() -> str:
        return "chemoswarm"
