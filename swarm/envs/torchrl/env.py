"""The TorchRL face: many worlds of many swimmers in one tensor, on any device."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from swarm._support import streams
from swarm._support.checks import check_count, check_flag, check_name, optional
from swarm._support.compiler import compiled
from swarm.envs.face import RENDER_FPS, RENDER_MODES, make_world, no_medium, with_parameters
from swarm.envs.spaces import checked, state_bounds, told
from swarm.envs.torchrl import worlds
from swarm.envs.torchrl.worlds import DTYPES, Worlds, decision, placed
from swarm.physics.world import World
from swarm.physics.world.state import check_arrivals

GROUP = "swimmers"
ENDS = ("done", "terminated", "truncated")


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
        self.world = make_world(world, parameters)
        shape = check_count("n_worlds", n_worlds), check_count("n_swimmers", n_swimmers)
        self.n_worlds, self.n_swimmers = shape
        check_arrivals(self.world, n_swimmers)
        self.max_cycles = optional(check_count)("max_cycles", max_cycles)
        self.float_dtype = DTYPES[check_name("dtype", dtype, DTYPES)]
        self.population, self.first = population, check_count("first", first, at_least=0)
        wrap = compiled if compile_step else functools.partial
        self._decide = wrap(decision, self.world)
        self._place = placed(device)
        few = n_worlds * n_swimmers <= worlds.NUMPY_CELLS
        self._in_numpy = few and self._place.type == "cpu" and not compile_step
        given = seeds if seed is None else [seed]
        self.set_seeds([streams.entropy()] if given is None else given)
        self._drawn = given is None
        super().__init__(device=device, batch_size=torch.Size([n_worlds]))
        self.return_state = check_flag("return_state", return_state)
        specs = specs_of(self.world, shape, self._place, return_state)
        self.observation_spec, self.action_spec, self.reward_spec, self.done_spec = specs
        self._terminated = torch.zeros(*shape, 1, dtype=torch.bool, device=self._place)
        self._last: Any = 0  # actions (worlds, cells)
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
        state, key = self._begun, (mode, env_index)
        if key not in self._viewers:
            self._viewers[key] = Viewer(self.world, window=mode == "human", fps=RENDER_FPS)
        viewer = self._viewers[key]
        viewer.follow(state.each(lambda array: np.asarray(self._tensor(array)[env_index].cpu())))
        return viewer.picture() if mode == "rgb_array" else None

    def __getattr__(self, name: str) -> Any:
        if name == "medium":  # a module forgets why there is none
            raise no_medium()
        return super().__getattr__(name)

    # --- TensorDicts: what TorchRL asks for -----------------------------------------------------------------

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDict:
        fresh = torch.ones(self.n_worlds, dtype=torch.bool, device=self._place)
        if tensordict is not None and "_reset" in tensordict.keys():  # noqa: SIM118
            fresh = tensordict["_reset"].reshape(self.n_worlds)
        observation = self.restart(fresh.cpu().numpy())
        self._terminated = self._terminated & ~fresh[:, None, None]
        return self._pack(observation, self.gain())

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        action = checked(self.world, tensordict[GROUP, "action"], (self.n_worlds, self.n_swimmers))
        if self.return_state:  # in which those who have finished keep their last curvature
            action = self._last = torch.where(self._tensor(self._begun.finished), self._last, action)
        result, gain = self._advance(action)
        if self.world.egg is not None:
            self._terminated = self._terminated | result.terminated[..., None]
        out = self._pack(result.observation, gain)
        out[GROUP]["reward"] = result.reward[..., None].to(torch.float32)
        return out

    def _step_proc_data(self, next_tensordict_out: TensorDictBase) -> TensorDictBase:
        """What TorchRL would complete and reshape is complete and in shape already."""
        return next_tensordict_out

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:  # without one, the episodes of the seed in use go on
            self.set_seeds([seed])

    def _pack(self, observation: Tensor, gain: Tensor) -> TensorDict:
        state = self._begun
        done = self._tensor(state.finished)[..., None]
        flags = {"done": done, "terminated": self._terminated, "truncated": done & ~self._terminated}
        found = {name: self._tensor(each) for name, each in told(self.world, state).items()}
        floats = {name: each.float() for name, each in found.items() if each.is_floating_point()}
        parts = {name: each[..., None] for name, each in ({"gain": gain.float()} | found | floats).items()}
        everyone = _all_cells(done)
        ended = _all_cells(self._terminated) if self.world.egg is not None else torch.zeros_like(everyone)
        group = TensorDict(
            {"observation": observation, **parts, **flags},
            batch_size=(self.n_worlds, self.n_swimmers),
            device=self.device,
        )
        table = {"state": self._table()} if self.return_state else {}
        root = table | {GROUP: group, "done": everyone, "terminated": ended, "truncated": everyone & ~ended}
        return TensorDict(root, batch_size=self.batch_size, device=self.device)


def _all_cells(flags: Tensor) -> Tensor:
    """Whether all cells (worlds, cells, 1) are flagged (worlds, 1); to count is faster than to ask."""
    return flags.sum(dim=1, dtype=torch.int32) == flags.shape[1]


def specs_of(
    world: World, shape: tuple[int, int], device: torch.device, with_state: bool
) -> tuple[Composite, Composite, Composite, Composite]:
    """What (worlds, cells) cells observe, do and are paid, and the ends of whole worlds, so that there is one
    key by which they are reset; the ends of cells are observed.
    """
    numbers: dict[str, Any] = {"dtype": torch.float32, "device": device}
    flag: dict[str, Any] = {"dtype": torch.bool, "device": device, "n": 1}
    bound = torch.as_tensor(world.observation_bounds, device=device).expand(*shape, -1)

    def grouped(**specs: Any) -> Composite:
        return Composite({GROUP: Composite(specs, shape=shape)}, shape=shape[:1])

    told = ["gain"] + ["eaten"] * (world.medium is not None)
    told += ["arrival_time"] * (world.first_arrivals is not None)
    observation = grouped(
        observation=Bounded(-bound, bound, shape=bound.shape, **numbers),
        **{name: Unbounded(shape=(*shape, 1), **numbers) for name in told},
        **{name: Binary(shape=(*shape, 1), **flag) for name in ENDS},
        **({} if world.first_arrivals is None else {"won": Binary(shape=(*shape, 1), **flag)}),
    )
    if with_state:
        observation["state"] = Unbounded(shape=(*shape, len(state_bounds(world)[0])), **numbers)
    if world.action_range is None:
        action: Any = Categorical(world.n_actions, shape=shape, dtype=torch.int64, device=device)
    else:
        action = Bounded(*world.action_range, shape=(*shape, 1), **numbers)
    ends = {name: Binary(shape=(shape[0], 1), **flag) for name in ENDS}
    reward = grouped(reward=Unbounded(shape=(*shape, 1), **numbers))
    return observation, grouped(action=action), reward, Composite(ends, shape=shape[:1])
