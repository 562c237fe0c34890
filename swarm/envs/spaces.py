"""Observations, actions and states as the faces know them: their spaces, and what is no action."""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete

from swarm._support.arrays import namespace
from swarm.physics.world import State, World

Array = Any


def observation_space(world: World) -> Box:
    """Box (N_T · features,) float32 whose finite bounds hold."""
    bounds = world.observation_bounds
    return Box(-bounds, bounds, dtype=np.float32)


def action_space(world: World) -> Discrete | Box:
    """Discrete(m); Box (1,) float32 of curvatures [1 / length] where these are the actions."""
    if world.action_range is None:
        return Discrete(world.n_actions)
    low, high = world.action_range
    return Box(low, high, (1,), np.float32)


def rule_of(world: World, shape: tuple[int, ...] | None = None) -> str:
    """What an action, or an array of them, must be."""
    one, many = ("a curvature", "curvatures") if world.is_continuous else ("a whole number", "whole numbers")
    low, high = world.action_range or (0, world.n_actions - 1)
    ends = f"from {low:g} to {high:g}"
    return f"{one} {ends}" if shape is None else f"{many} {ends} of shape {shape}"


def of_shape(world: World, actions: Array, shape: tuple[int, ...]) -> Array:
    """An array of `shape` of any library from one of it, of curvatures also of one axis (1,) more; raises
    TypeError unless it holds numbers of the right kind, ValueError unless they are as many.
    """
    kind = "real floating" if world.is_continuous else "integral"
    dtype = getattr(actions, "dtype", None)
    if dtype is None or not namespace(actions).isdtype(dtype, kind):
        raise TypeError(f"actions must be {rule_of(world, shape)}, got {dtype or type(actions).__name__}")
    if world.is_continuous and tuple(actions.shape) == (*shape, 1):
        actions = actions[..., 0]
    if tuple(actions.shape) != shape:
        raise ValueError(f"actions must be {rule_of(world, shape)}, got shape {tuple(actions.shape)}")
    return actions


def checked(world: World, actions: Array, shape: tuple[int, ...]) -> Array:
    """`of_shape`; raises ValueError, too, unless all are actions of the world."""
    actions = of_shape(world, actions, shape)
    wrong = ~world.is_action(actions)
    if wrong.any():
        *_, cell = first = tuple(int(each[0]) for each in namespace(wrong).nonzero(wrong))
        rule = rule_of(world, shape)
        raise ValueError(f"actions must be {rule}, got {actions[first]} for swimmer_{cell}")
    return actions


def checked_one(world: World, name: str, action: Any) -> float:
    """The action of one cell as a number; a curvature may stand in an array of one."""
    rule = f"{name} must be {rule_of(world)}, got {action!r}"
    number: float
    try:
        if world.is_continuous:
            given = np.asarray(action)
            if given.dtype.kind not in "iuf" or given.size != 1:
                raise TypeError
            number = given.item()
        else:
            number = operator.index(action)
    except TypeError:
        raise TypeError(rule) from None
    if not world.is_action(number):
        raise ValueError(rule)
    return number


def told(world: World, state: State) -> dict[str, Any]:
    """What is told of each cell (..., cells) beside its gain: what it has `eaten` [amount] in a medium; in a
    race its `arrival_time` [time], infinite before, and whether it has `won`.
    """
    found = {} if state.medium is None else {"eaten": state.medium.eaten}
    if state.arrival_time is not None:
        found |= {"arrival_time": state.arrival_time, "won": world.won(state)}
    return found


def state_bounds(world: World) -> tuple[list[float], list[float]]:
    """The lowest and the highest number of each column of a `state_table`; infinite where there is none."""
    somewhere = [math.inf] * world.dimensions
    if world.dimensions == 3:
        return [*(-each for each in somewhere), *[-1.0] * 4], [*somewhere, *[1.0] * 4]
    (low, high), turn = world.curvature_bounds, math.pi
    return [*(-each for each in somewhere), -turn, low], [*somewhere, turn, high]


def state_table(world: World, state: State, curvature: Array) -> Array:
    """What a central critic is shown of every cell (..., cells, columns): x, y [length], heading in [−π, π]
    [rad] and `curvature` (..., cells) [1 / length]; in space x, y, z and the unit quaternion w, x, y, z.
    """
    place, heading = state.position, world.orientation(state)
    flat = [heading[..., None], curvature[..., None]] if world.dimensions == 2 else [heading]
    return namespace(place).concat([place, *flat], axis=-1)
