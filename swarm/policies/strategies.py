"""Strategies: policies that somebody devised, and any function of the observation as a policy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from array_api_compat import is_array_api_obj

from swarm._support.arrays import as_array, namespace
from swarm.physics.world import State, World

Array = Any


@dataclass(frozen=True)
class Greedy:
    """Highest curvature at the largest of the N_T records, lowest at the smallest, else unchanged.

    Where all records are equal the highest is taken (paper: greedy strategy). In space it is the other way
    round where the `response_sign` of the world says so.
    """

    deterministic = True

    def act(self, world: World, state: State, uniform: Array | None = None) -> Array:
        """Actions (..., cells)."""
        xp = namespace(state.memory)
        concentrations = state.memory[..., 0]  # normalised, which keeps their order
        newest = concentrations[..., 0]
        kept = world.last_action(state)
        low, high = world.ends(kept)[:: world.response_sign]
        at_smallest = newest <= xp.min(concentrations, axis=-1)
        at_largest = newest >= xp.max(concentrations, axis=-1)
        return xp.where(at_largest, high, xp.where(at_smallest, low, kept))


@dataclass(frozen=True)
class Swinging:
    """Lowest and highest curvature by turns, switching every N_T ΔT / 2 (paper: swinging pattern).

    Decision j takes the lowest where ⌊2j/N_T⌋ is even. How many decisions a cell has made is read off its
    clock, on which swinging keeps a timetable of N_T decisions; so the policy needs no memory, and where it
    takes over from another it falls into step with the timetable.
    """

    deterministic = True

    def act(self, world: World, state: State, uniform: Array | None = None) -> Array:
        """Actions (..., cells)."""
        xp = namespace(state.clock)
        timetable = self.schedule(world)
        counted = state.clock
        if world.has_common_tick:  # the clock counts ticks: an entry for every tick of a cycle
            timetable = np.repeat(timetable, np.asarray(world.interval_ticks)[timetable])
        else:  # the clock counts the decisions with each action
            counted = xp.sum(counted, axis=-1, dtype=xp.int32)
        table = as_array(timetable, counted, dtype=xp.int32)
        row = xp.reshape(counted % len(timetable), (-1,))
        return world.action_of(xp.reshape(xp.take(table, row, axis=0), counted.shape), state.memory)

    @staticmethod
    def schedule(world: World) -> np.ndarray:
        """Actions (N_T,) of decisions 0 … N_T − 1, after which they repeat."""
        half = 2 * np.arange(world.n_records) // world.n_records
        return half * (world.n_actions - 1)


@dataclass(frozen=True)
class Random:
    """Each action with equal chance; where actions are curvatures, each of the range."""

    def act(self, world: World, state: State, uniform: Array) -> Array:
        """Actions (..., cells); `uniform` is needed."""
        if uniform is None:
            raise ValueError("uniform must be given to Random: one number in [0, 1) per cell, got None")
        xp = namespace(uniform)
        if world.action_range is not None:
            low, high = world.action_range
            return low + (high - low) * uniform
        action = xp.astype(uniform * world.n_actions, xp.int32)
        top = xp.full_like(action, world.n_actions - 1)
        return xp.minimum(action, top)  # in float32 a number below 1 may round up


@dataclass(frozen=True)
class FromObservation:
    """What any function of the observation chooses, a model of another library for instance.

    `function` gets the observations of all cells at once (..., cells, N_T · features) in float32, of the
    library that the world runs on, and returns whole numbers 0 … m − 1 (..., cells), or curvatures where
    these are the actions, as an array, tensor or list. Raises TypeError for something that cannot be called;
    `act` raises ValueError for actions of another shape or kind, or that the world does not have.
    """

    function: Callable[[Array], Any]

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise TypeError(f"function must map observations to actions, got {self.function!r}")

    def act(self, world: World, state: State, uniform: Array | None = None) -> Array:
        """Actions (..., cells)."""
        chosen = self.function(world.observation(state))
        if not is_array_api_obj(chosen):
            chosen = np.asarray(chosen)
        cells = tuple(state.clock.shape[: state.memory.ndim - 2])
        kind, wanted = (
            ("curvatures", "real floating") if world.is_continuous else ("whole numbers", "integral")
        )
        xp = namespace(chosen)
        if tuple(chosen.shape) != cells or not xp.isdtype(chosen.dtype, wanted):
            raise ValueError(
                f"actions must be {kind}, one for each cell {cells}, got {chosen.dtype} of shape "
                f"{tuple(chosen.shape)}"
            )
        wrong = ~world.is_action(chosen)
        if xp.any(wrong):
            low, high = world.action_range or (0, world.n_actions - 1)
            found = xp.reshape(chosen, (-1,))[int(xp.argmax(xp.astype(xp.reshape(wrong, (-1,)), xp.int32)))]
            raise ValueError(f"actions must lie in {low:g} … {high:g}, got {float(found):g}")
        if world.is_continuous:
            return as_array(chosen, state.memory)
        return as_array(chosen, state.memory, dtype=namespace(state.memory).int32)
