"""Actions and states as the faces know them: their spaces, and what is said of an action that is none."""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete

from swarm._support.arrays import namespace
from swarm.physics.world import State, World

Array = Any


def action_space(world: World) -> Discrete | Box:
    """Discrete(m); Box (1,) float32 of curvatures [1 / length] where these are the actions."""
    if world.action_range is None:
        return Discrete(world.n_actions)
    low, high = world.action_range
    return Box(low, high, (1,), np.float32)


def rule_of(world: World, count: int | None = None) -> str:
    """What an action, or `count` of them, must be."""
    one, many = ("a curvature", "curvatures") if world.is_continuous else ("a whole number", "whole numbers")
    low, high = world.action_range or (0, world.n_actions - 1)
    return f"{one if count is None else f'{count} {many}'} from {low:g} to {high:g}"


def checked(world: World, actions: Any, cells: int) -> np.ndarray:
    """The actions (cells,), curvatures also of (cells, 1); raises TypeError or ValueError."""
    rule = f"actions must be {rule_of(world, cells)}"
    action = np.asarray(actions)
    if action.dtype.kind not in ("iuf" if world.is_continuous else "iu"):
        raise TypeError(f"{rule}, got {action.dtype} {actions!r}")
    if world.is_continuous and action.shape == (cells, 1):
        action = action[:, 0]
    if action.shape != (cells,):
        raise ValueError(f"{rule}, got shape {action.shape}")
    wrong = ~world.is_action(action)
    if wrong.any():
        i = int(wrong.argmax())
        raise ValueError(f"{rule}, got {action[i]} for swimmer_{i}")
    return action


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
