"""The TorchRL face: many worlds of many swimmers in one tensor, on any device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from swarm._support import streams
from swarm._support.arrays import where_chosen
from swarm._support.checks import check_count, check_flag, check_name
from swarm.envs.arena import RENDER_FPS, RENDER_MODES, make_world, no_medium, told, with_parameters
from swarm.envs.torchrl.specs import checked, specs_of
from swarm.envs.torchrl.worlds import Worlds
from swarm.physics.world import World

GROUP = "swimmers"


class SwarmEnv(Worlds, EnvBase):
    """`n_worlds` independent worlds of `n_swimmers` cells each; arguments otherwise as `swarm.parallel_env`.

    Tensors are (worlds, cells, ...) in the group `swimmers`: `observation`, `action`, `reward`, `done`,
    `terminated`, `truncated`, `gain`; in a medium `eaten`; in a race `arrival_time`, `won`. A cell that is
    done waits, masked, until every cell of its world is done; then the root `done` of the world is set and
    the world restarts. A row of data is valid where ("swimmers", "done") was False before the step. With
    `return_state`, `state` (worlds, cells, 4) is there for a central critic: x, y [length], heading [rad] and
    curvature [1 / length], in space (worlds, cells, 7) place and quaternion, as the PettingZoo face has it.

    Starts come from the same streams as the PettingZoo face: world w of seed s holds rows `first` + w ·
    n_swimmers … of that seed's population. With `seeds` given, the worlds are shared out evenly among several
    independent seeds. Without a seed one is drawn from the operating system, once; it stands in `seeds`.
    `compile_step` hands the decision to `torch.compile`, which pays after some ten thousand steps of many
    cells. Without it, up to `NUMPY_CELLS` cells on the CPU decide in NumPy, whose calls take a fraction of
    torch's; tensors and arrays share their memory.
    """

    batch_locked = True

    @with_parameters
    def __init__(
        self,
        n_worlds: int = 1,
        device: torch.device | str | None = None,
        *,
        n_swimmers: int = 40,
        dtype: str = "float32",
        max_cycles: int | None = None,
        seed: int | None = None,
        seeds: Sequence[int] | None = None,
        population: streams.Population = "training",
        first: int = 0,
        return_state: bool = False,
        compile_step: bool = False,
        world: World | None = None,
        **parameters: Any,
    ) -> None:
        if seed is not None and seeds is not None:
            raise ValueError(f"seed must be left out where seeds are given, got {seed} beside {seeds}")
        self._set_up(
            make_world(world, parameters),
            (n_worlds, n_swimmers),
            device,
            dtype=dtype,
            max_cycles=max_cycles,
            seeds=seeds if seed is None else [seed],
            population=population,
            first=first,
            compile_step=compile_step,
        )
        super().__init__(device=device, batch_size=torch.Size([self.n_worlds]))
        self.return_state = check_flag("return_state", return_state)
        specs = specs_of(self.world, (self.n_worlds, self.n_swimmers), GROUP, self._place, return_state)
        self.observation_spec, self.action_spec, self.reward_spec, self.done_spec = specs
        self._terminated = torch.zeros(n_worlds, n_swimmers, 1, dtype=torch.bool, device=self._place)
        self._viewers: dict[tuple[str, int], Any] = {}

    # --- what multi-agent code reads ------------------------------------------------------------------------

    @property
    def n_agents(self) -> int:
        """Cells in a world."""
        return self.n_swimmers

    @property
    def agents(self) -> list[str]:
        """The names of a world's cells, as in the PettingZoo face."""
        return [f"swimmer_{i}" for i in range(self.n_swimmers)]

    @property
    def group_map(self) -> dict[str, list[str]]:
        """The only group, and its cells."""
        return {GROUP: self.agents}

    @property
    def max_steps(self) -> int:
        """Decisions of the longest life."""
        longest = self.world.max_decisions
        return longest if self.max_cycles is None else min(longest, self.max_cycles)

    def render(self, mode: str = "rgb_array", env_index: int = 0) -> np.ndarray | None:
        """A picture (720, 960, 3) uint8 of the world `env_index`, with trails through what was rendered of
        it; with `mode="human"` a window shows it (needs pygame), and None is returned.
        """
        from swarm.figures.viewer import Viewer

        check_name("mode", mode, RENDER_MODES)
        if check_count("env_index", env_index, at_least=0) >= self.n_worlds:
            raise ValueError(f"env_index must be below {self.n_worlds}, got {env_index}")
        if self._state is None:
            raise RuntimeError("restart() or reset() must come before render()")
        key = mode, env_index
        if key not in self._viewers:
            self._viewers[key] = Viewer(self.world, window=mode == "human", fps=RENDER_FPS)
        viewer = self._viewers[key]
        viewer.follow(self._state.each(lambda array: np.asarray(self._tensor(array)[env_index].cpu())))
        return viewer.picture() if mode == "rgb_array" else None

    def __getattr__(self, name: str) -> Any:
        if name == "medium":  # a module forgets why there is none
            raise no_medium()
        return super().__getattr__(name)

    # --- TensorDicts: what TorchRL asks for -----------------------------------------------------------------

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDict:
        worlds = None
        if tensordict is not None and "_reset" in tensordict.keys():  # noqa: SIM118
            worlds = tensordict["_reset"].reshape(self.n_worlds).cpu().numpy()
        observation = self.restart(worlds)
        assert self._state is not None
        done = self._tensor(self._state.finished)[..., None]
        chosen = np.ones(self.n_worlds, bool) if worlds is None else worlds
        fresh = torch.as_tensor(chosen, device=self._place)
        self._terminated = where_chosen(fresh, torch.zeros_like(done), self._terminated)
        return self._pack(observation, self.gain(), done)

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        action = checked(self.world, tensordict[GROUP, "action"], (self.n_worlds, self.n_swimmers))
        result, gain = self._advance(action)
        assert self._state is not None
        done = self._tensor(self._state.finished)[..., None]
        if self.world.egg is not None:
            self._terminated = self._terminated | result.terminated[..., None]
        out = self._pack(result.observation, gain, done)
        out[GROUP]["reward"] = result.reward[..., None].to(torch.float32)
        return out

    def _step_proc_data(self, next_tensordict_out: TensorDictBase) -> TensorDictBase:
        """What TorchRL would complete and reshape is complete and in shape already."""
        return next_tensordict_out

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:  # without one, the episodes of the seed in use go on
            self.set_seeds([seed])

    def _pack(self, observation: Tensor, gain: Tensor, done: Tensor) -> TensorDict:
        flags = {"done": done, "terminated": self._terminated, "truncated": done & ~self._terminated}
        assert self._state is not None
        found = {name: self._tensor(each) for name, each in told(self.world, self._state).items()}
        floats = {name: each.float() for name, each in found.items() if each.is_floating_point()}
        parts = {name: each[..., None] for name, each in ({"gain": gain.float()} | found | floats).items()}
        everyone = _all_cells(done)
        ended = _all_cells(self._terminated) if self.world.egg is not None else torch.zeros_like(everyone)
        group = TensorDict(
            {"observation": observation, **parts, **flags},
            batch_size=(self.n_worlds, self.n_swimmers),
            device=self.device,
        )
        state = {"state": self._table()} if self.return_state else {}
        root = state | {GROUP: group, "done": everyone, "terminated": ended, "truncated": everyone & ~ended}
        return TensorDict(root, batch_size=self.batch_size, device=self.device)


def _all_cells(flags: Tensor) -> Tensor:
    """Whether all cells (worlds, cells, 1) are flagged (worlds, 1); to count is faster than to ask."""
    return flags.sum(dim=1, dtype=torch.int32) == flags.shape[1]
