"""Many worlds of many cells in plain tensors: their seeds, lives and decisions."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from swarm._support import streams
from swarm._support.arrays import namespace, where_chosen
from swarm._support.checks import check_count, check_name
from swarm._support.compiler import compiled
from swarm.envs.arena import no_medium
from swarm.envs.spaces import state_table
from swarm.physics.starts import Draws, draw_shared, noise_of
from swarm.physics.world import Outcome, State, World

DTYPES = {"float32": torch.float32, "float64": torch.float64}
NUMPY_CELLS = 5_000  # up to so many, NumPy makes a decision on the CPU faster than torch (`make bench`)

Array = Any


class Transition(NamedTuple):
    """What `Worlds.advance` returns; finished cells get reward 0."""

    observation: Tensor  # (worlds, cells, N_T · features) float32
    reward: Tensor  # (worlds, cells)
    terminated: Tensor  # (worlds, cells) bool
    truncated: Tensor  # (worlds, cells) bool
    valid: Tensor  # (worlds, cells) bool: the cell was alive before this decision


class Worlds:
    """Worlds (worlds, cells, ...) that begin and decide together; what the trainer uses of `SwarmEnv`."""

    def _set_up(
        self,
        world: World,
        shape: tuple[int, int],
        device: torch.device | str | None,
        *,
        dtype: str,
        max_cycles: int | None,
        seeds: Sequence[int] | None,
        population: streams.Population,
        first: int,
        compile_step: bool,
    ) -> None:
        self.world = world
        self.n_worlds = check_count("n_worlds", shape[0])
        self.n_swimmers = check_count("n_swimmers", shape[1])
        self.max_cycles = None if max_cycles is None else check_count("max_cycles", max_cycles)
        self.float_dtype = DTYPES[check_name("dtype", dtype, DTYPES)]
        self.population, self.first = population, check_count("first", first, at_least=0)
        wrap = compiled if compile_step else functools.partial
        self._decide: Callable[..., Any] = wrap(_decision, self.world)
        self._place = _placed(device)
        few = self.n_worlds * self.n_swimmers <= NUMPY_CELLS
        self._in_numpy = few and self._place.type == "cpu" and not compile_step
        self._state: State | None = None  # in the library that computes it
        self.observation: Tensor | None = None
        self._gain: Array = None  # in a medium, in which others eat where a cell has finished
        self.set_seeds([streams.entropy()] if seeds is None else seeds)
        self._drawn = seeds is None

    @property
    def state(self) -> State | None:
        """The cells (worlds, cells, ...); None before the first restart."""
        return None if self._state is None else self._state.each(self._tensor)

    @property
    def medium(self) -> Tensor:
        """The grids (worlds, nx, ny), see [`MediumState`][swarm.physics.crowd.medium.medium.MediumState]
        [concentration]. Raises AttributeError in a world without a medium, RuntimeError before the first
        restart.
        """
        if self.world.medium is None:
            raise no_medium()
        if self._state is None:
            raise RuntimeError("restart() or reset() must come first")
        return self._tensor(self._state.medium.grid)

    def all_finished(self) -> bool:
        """Whether every cell's life has ended."""
        assert self._state is not None, "restart() must come first"
        return bool(self._state.finished.all())

    def set_seeds(self, seeds: Sequence[int]) -> None:
        """Share the worlds out among `seeds`, block after block, and begin with episode 0 at the next
        restart.
        """
        if not isinstance(seeds, Iterable) or isinstance(seeds, str):
            raise TypeError(f"seeds must be whole numbers in a list, got {seeds!r}")
        self.seeds = [streams.check_seed(seed) for seed in seeds]
        if not self.seeds or self.n_worlds % len(self.seeds):
            raise ValueError(
                f"n_worlds must be a multiple of the number of seeds, got {self.n_worlds} worlds and "
                f"{len(self.seeds)} seeds"
            )
        self._drawn = False  # whether nobody else knows the seed
        self.episode = np.full(self.n_worlds, -1)
        self.decision = np.zeros(self.n_worlds, np.int64)
        drawn: Any = noise_of(self.world), (self.n_worlds, self.n_swimmers), self.seeds
        self._noise = Draws(*drawn, population=self.population, first=self.first, place=self._array)

    def restart(self, worlds: np.ndarray | None = None) -> Tensor:
        """Begin the next episode in the chosen worlds (a mask; default all); returns all observations."""
        chosen = np.ones(self.n_worlds, bool) if worlds is None or self._state is None else np.asarray(worlds)
        if not chosen.any():
            assert self.observation is not None
            return self.observation
        self.episode[chosen] += 1
        self.decision[chosen] = 0
        shared = self.world, self.n_swimmers, self.seeds, self.episode, chosen
        starts = draw_shared(*shared, population=self.population, first=self.first)
        fresh = self.world.start(**{name: self._array(each) for name, each in starts.items()})
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
        """All that is needed to go on from here: the cells' state, the counters, a seed that was drawn."""
        state = self.state
        assert state is not None, "restart() must come first"
        held = state.named("state")
        held |= {} if self.world.medium is None else {"gain": self._tensor(self._gain)}
        counters = {"episode": self.episode, "decision": self.decision}
        counters |= {"seeds": np.array(self.seeds, np.uint64).view(np.int64)} if self._drawn else {}
        return held | {name: torch.as_tensor(each.copy()) for name, each in counters.items()}

    def load_state_dict_of_env(self, arrays: dict[str, Tensor]) -> None:
        """Go on from what `state_dict_of_env` gave, with its seed if nobody gave that one."""
        if "seeds" in arrays:
            self.set_seeds(arrays["seeds"].numpy().view(np.uint64).tolist())
            self._drawn = True
        held = {name: each for name, each in arrays.items() if name.startswith("state.")}
        state = State.of_named({n: self._bare(each.to(self._place)) for n, each in held.items()}, "state")
        if not self._in_numpy:
            parts = {name: _part_by_part(getattr(state, name)) for name in ("position", "heading", "memory")}
            state = state._replace(**parts)
        self.episode, self.decision = arrays["episode"].numpy().copy(), arrays["decision"].numpy().copy()
        self._begin(state, np.ones(self.n_worlds, bool))
        if "gain" in arrays:
            self._gain = self._bare(arrays["gain"].to(self._place))

    def _table(self) -> Tensor:
        """The state (worlds, cells, columns) float32 of all cells, see `state_table`."""
        assert self._state is not None
        return self._tensor(state_table(self.world, self._state, self.world.curvature(self._state))).float()

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


def _placed(device: Any) -> torch.device:
    """The device, on which torch can hold something here."""
    try:
        place = torch.device("cpu" if device is None else device)
        torch.empty(0, device=place)
    except (RuntimeError, AssertionError, TypeError, NotImplementedError) as error:
        reason = str(error).split("\n")[0]
        raise ValueError(f"device must be one that torch has here, got {device!r}: {reason}") from None
    return place


def _decision(world: World, state: State, action: Array, noise: Array | None) -> tuple[State, Outcome]:
    """One decision of every cell; those that were done get no reward."""
    after, outcome = world.step(state, action, noise)
    xp, reward = namespace(outcome.reward), outcome.reward
    return after, outcome._replace(reward=xp.where(state.finished, xp.zeros_like(reward), reward))


def _part_by_part(array: Tensor) -> Tensor:
    """(worlds, cells, ...) in memory as the world makes it, for which decisions are compiled."""
    return array.movedim((0, 1), (-2, -1)).contiguous().movedim((-2, -1), (0, 1))
