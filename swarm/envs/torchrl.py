"""The TorchRL face: many worlds of many swimmers in one tensor, on any device."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from swarm._support import streams
from swarm._support.arrays import namespace, where_chosen
from swarm._support.checks import check_count, check_name
from swarm._support.compiler import compiled
from swarm.envs.arena import make_world, no_medium, told, with_parameters
from swarm.envs.specs import check_actions, specs_of
from swarm.physics.starts import Draws, draw_record_noise, draw_starts, noise_of
from swarm.physics.world import Outcome, State, World

GROUP = "swimmers"
DTYPES = {"float32": torch.float32, "float64": torch.float64}
NUMPY_CELLS = 5_000  # up to so many, NumPy makes a decision on the CPU faster than torch (`make bench`)

Array = Any


class Transition(NamedTuple):
    """What `SwarmEnv.advance` returns; finished cells get reward 0."""

    observation: Tensor  # (worlds, cells, N_T · features) float32
    reward: Tensor  # (worlds, cells)
    terminated: Tensor  # (worlds, cells) bool
    truncated: Tensor  # (worlds, cells) bool
    valid: Tensor  # (worlds, cells) bool: the cell was alive before this decision


class SwarmEnv(EnvBase):
    """`n_worlds` independent worlds of `n_swimmers` cells each; arguments otherwise as `swarm.parallel_env`.

    Tensors are (worlds, cells, ...) in the group `swimmers`: `observation`, `action`, `reward`, `done`,
    `terminated`, `truncated`, `gain`; in a medium `eaten`; in a race `arrival_time`, `won`. A cell that is
    done waits, masked, until every cell of its world is done; then the root `done` of the world is set and
    the world restarts. A row of data is valid where ("swimmers", "done") was False before the step.

    Starts come from the same streams as the PettingZoo face: world w of seed s holds rows w · n_swimmers … of
    that seed's population. With `seeds` given, the worlds are shared out evenly among several independent
    seeds. `compile_step` hands the decision to `torch.compile`, which pays after some ten thousand steps of
    many cells. Without it, up to `NUMPY_CELLS` cells on the CPU decide in NumPy, whose calls take a fraction
    of torch's; tensors and arrays share their memory.
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
        seed: int = 0,
        seeds: Sequence[int] | None = None,
        population: streams.Population = "training",
        compile_step: bool = False,
        world: World | None = None,
        **parameters: Any,
    ) -> None:
        self.n_worlds = check_count("n_worlds", n_worlds)
        self.n_swimmers = check_count("n_swimmers", n_swimmers)
        self.max_cycles = None if max_cycles is None else check_count("max_cycles", max_cycles)
        self.world = make_world(world, parameters)
        self.float_dtype = DTYPES[check_name("dtype", dtype, DTYPES)]
        self.population = population
        wrap = compiled if compile_step else functools.partial
        self._decide: Callable[..., Any] = wrap(_decision, self.world)
        super().__init__(device=device, batch_size=torch.Size([self.n_worlds]))
        self._place = torch.device("cpu") if device is None else torch.device(device)
        few = self.n_worlds * self.n_swimmers <= NUMPY_CELLS
        self._in_numpy = few and self._place.type == "cpu" and not compile_step
        specs = specs_of(self.world, (self.n_worlds, self.n_swimmers), GROUP, self._place)
        self.observation_spec, self.action_spec, self.reward_spec, self.done_spec = specs
        self._terminated = torch.zeros(n_worlds, n_swimmers, 1, dtype=torch.bool, device=self._place)
        self._state: State | None = None  # in the library that computes it
        self.observation: Tensor | None = None
        self._gain: Array = None  # in a medium, in which others eat where a cell has finished
        self.set_seeds([seed] if seeds is None else seeds)

    # --- plain tensors: what the trainer uses ---------------------------------------------------------------

    @property
    def state(self) -> State | None:
        """The cells (worlds, cells, ...); None before the first restart."""
        return None if self._state is None else self._state.each(self._tensor)

    @property
    def medium(self) -> Tensor:
        """The medium's grids (worlds, nx, ny), see [`MediumState`][swarm.physics.crowd.medium.MediumState]
        [concentration]. Raises AttributeError in a world without a medium, RuntimeError before the first
        restart.
        """
        if self.world.medium is None:
            raise no_medium()
        if self._state is None:
            raise RuntimeError("restart() or reset() must come first")
        return self._tensor(self._state.medium.grid)

    def __getattr__(self, name: str) -> Any:
        if name == "medium":  # a module forgets why there is none
            raise no_medium()
        return super().__getattr__(name)

    def all_finished(self) -> bool:
        """Whether every cell's life has ended."""
        assert self._state is not None, "restart() must come first"
        return bool(self._state.finished.all())

    def set_seeds(self, seeds: Sequence[int]) -> None:
        """Share the worlds out among `seeds`, block after block, and begin with episode 0 at the next
        restart.
        """
        self.seeds = [streams.check_seed(seed) for seed in seeds]
        if not self.seeds or self.n_worlds % len(self.seeds):
            raise ValueError(
                f"n_worlds must be a multiple of the number of seeds, got {self.n_worlds} worlds and "
                f"{len(self.seeds)} seeds"
            )
        self.episode = np.full(self.n_worlds, -1)
        self.decision = np.zeros(self.n_worlds, np.int64)
        cells = (self.n_worlds, self.n_swimmers)
        self._noise = Draws(
            noise_of(self.world), cells, self.seeds, population=self.population, place=self._array
        )

    def restart(self, worlds: np.ndarray | None = None) -> Tensor:
        """Begin the next episode in the chosen worlds (a mask; default all); returns all observations."""
        chosen = np.ones(self.n_worlds, bool) if worlds is None or self._state is None else np.asarray(worlds)
        self.episode[chosen] += 1
        self.decision[chosen] = 0
        position = np.zeros((self.n_worlds, self.n_swimmers, 2))
        heading = np.zeros((self.n_worlds, self.n_swimmers))
        past = np.zeros((self.n_worlds, self.n_swimmers, self.world.n_records), np.int64)
        factors, noise = np.ones_like(position), np.zeros(past.shape)
        cells = self.n_worlds // len(self.seeds) * self.n_swimmers  # of each seed
        blocks = np.split(np.arange(self.n_worlds), len(self.seeds))
        for seed, block in zip(self.seeds, blocks, strict=True):
            for episode in np.unique(self.episode[block[chosen[block]]]).tolist():
                members = block[chosen[block] & (self.episode[block] == episode)]
                where: dict[str, Any] = {"population": self.population, "episode": episode}
                starts: list[Any] = [*draw_starts(self.world, cells, seed, **where)]
                starts += [np.ones((cells, 2))] if self.world.spread is None else []
                numbers = draw_record_noise(self.world, cells, seed, **where)
                starts += [] if numbers is None else [numbers]
                for whole, part in zip((position, heading, past, factors, noise), starts, strict=False):
                    whole[members] = part.reshape(len(block), *whole.shape[1:])[members - block[0]]
        further = {} if self.world.spread is None else {"factors": self._array(factors)}
        further |= {"noise": self._array(noise)} if self.world.concentration_noise > 0 else {}
        fresh = self.world.start(*map(self._array, (position, heading, past)), **further)
        return self._begin(fresh, chosen)

    def place(self, position: Tensor, heading: Tensor, past: Tensor) -> Tensor:
        """Start every cell at given poses (worlds, cells, ...); returns the observations."""
        self.episode[:] = np.maximum(self.episode, 0)
        self.decision[:] = 0
        starts = (position.to(self.float_dtype), heading.to(self.float_dtype), past)
        return self._begin(self.world.start(*map(self._bare, starts)), np.ones(self.n_worlds, bool))

    def _begin(self, fresh: State, chosen: np.ndarray) -> Tensor:
        """Put cells into the chosen worlds (a mask), for which the counters are set; returns all
        observations.
        """
        if self._state is None or chosen.all():
            self._state = fresh
        else:
            mask = self._array(chosen)
            self._state = fresh.each(functools.partial(where_chosen, mask), self._state)
        if self.world.medium is not None:
            gain = self.world.concentration(self._state) - self._state.start_concentration
            mask = self._array(chosen)
            self._gain = gain if self._gain is None else where_chosen(mask, gain, self._gain)
        self.observation = self._tensor(self.world.observation(self._state))
        return self.observation

    def advance(self, action: Tensor) -> Transition:
        """One decision of every cell, without a TensorDict; does not restart finished worlds."""
        return self._advance(action)[0]

    def _advance(self, action: Tensor) -> tuple[Transition, Tensor]:
        """What `advance` returns, and the gain."""
        if self._state is None:
            raise RuntimeError("restart() or reset() must come before advance()")
        # Not in the compiled part: torch's compiler writes flags byte by byte.
        valid = ~self._state.finished
        noise = self._noise.at(self.episode, self.decision) if self.world.has_noise else None
        state, outcome = self._decide(self._state, self._bare(action), noise)
        truncated = outcome.truncated
        self.decision[:] += 1
        if self.max_cycles is not None and (over := self.decision >= self.max_cycles).any():
            truncated = truncated | (self._array(over)[:, None] & ~outcome.terminated)
            state = state._replace(finished=state.finished | truncated)
        parts = (outcome.observation, outcome.reward, outcome.terminated, truncated, valid)
        result = Transition(*map(self._tensor, parts))
        # A module looks long at every attribute that it is given.
        self.__dict__.update(_state=state, observation=result.observation)
        gain = outcome.gain
        if self.world.medium is not None:
            gain = self._gain = namespace(gain).where(valid, gain, self._gain)
        return result, self._tensor(gain)

    def gain(self) -> Tensor:
        """Gain c(t) − c(0) (worlds, cells) so far [concentration]."""
        assert self._state is not None, "restart() must come first"
        if self.world.medium is not None:
            return self._tensor(self._gain)
        concentration = self.world.concentration(self._state)
        return self._tensor(concentration - self._state.start_concentration)

    def state_dict_of_env(self) -> dict[str, Tensor]:
        """All that is needed to go on from here: the cells' state and the counters."""
        state = self.state
        assert state is not None, "restart() must come first"
        held = {} if self.world.medium is None else {"gain": self._tensor(self._gain)}
        return (
            state.named("state")
            | held
            | {
                "episode": torch.as_tensor(self.episode.copy()),
                "decision": torch.as_tensor(self.decision.copy()),
            }
        )

    def load_state_dict_of_env(self, arrays: dict[str, Tensor]) -> None:
        """Go on from what `state_dict_of_env` gave."""
        held = {name: each for name, each in arrays.items() if name.startswith("state.")}
        state = State.of_named({n: self._bare(each.to(self._place)) for n, each in held.items()}, "state")
        if not self._in_numpy:
            parts = {name: _part_by_part(getattr(state, name)) for name in ("position", "heading", "memory")}
            state = state._replace(**parts)
        self.episode, self.decision = arrays["episode"].numpy().copy(), arrays["decision"].numpy().copy()
        self._begin(state, np.ones(self.n_worlds, bool))
        if "gain" in arrays:
            self._gain = self._bare(arrays["gain"].to(self._place))

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
        action = tensordict[GROUP, "action"]
        check_actions(action, self.world.n_actions, (self.n_worlds, self.n_swimmers))
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
        self.set_seeds([0 if seed is None else seed])

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
        root = {GROUP: group, "done": everyone, "terminated": ended, "truncated": everyone & ~ended}
        return TensorDict(root, batch_size=self.batch_size, device=self.device)

    # --- helpers --------------------------------------------------------------------------------------------

    def _array(self, values: np.ndarray) -> Array:
        """`values` in the library that computes decisions, real numbers in the environment's precision."""
        dtype = self.float_dtype if values.dtype.kind == "f" else None
        return self._bare(torch.as_tensor(values, dtype=dtype, device=self._place))

    def _bare(self, tensor: Tensor) -> Array:
        """A tensor on this environment's device as the library that computes decisions takes it."""
        return tensor.numpy() if self._in_numpy else tensor

    def _tensor(self, array: Array) -> Tensor:
        """What decisions computed, as a tensor."""
        if not self._in_numpy:
            return array
        return torch.from_numpy(array if array.flags.writeable else array.copy())


def _all_cells(flags: Tensor) -> Tensor:
    """Whether all cells (worlds, cells, 1) are flagged (worlds, 1); to count is faster than to ask."""
    return flags.sum(dim=1, dtype=torch.int32) == flags.shape[1]


def _decision(world: World, state: State, action: Array, noise: Array | None) -> tuple[State, Outcome]:
    """One decision of every cell; those that were done get no reward."""
    after, outcome = world.step(state, action, noise)
    xp, reward = namespace(outcome.reward), outcome.reward
    return after, outcome._replace(reward=xp.where(state.finished, xp.zeros_like(reward), reward))


def _part_by_part(array: Tensor) -> Tensor:
    """(worlds, cells, ...) in memory as the world makes it, for which decisions are compiled."""
    return array.movedim((0, 1), (-2, -1)).contiguous().movedim((-2, -1), (0, 1))
