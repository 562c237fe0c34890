"""Actions as the faces know them: their spaces, and what is said of one that is none."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete

from swarm.physics.world import World


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
