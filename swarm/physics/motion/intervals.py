"""Intervals: how long a decision lasts, the motion during it, and the clock that counts them.

Where all intervals are whole ticks, what a decision does is looked up in tables; else it is computed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, at_least, look_up, namespace
from swarm.physics.motion import swimmer
from swarm.physics.motion.swimmer import Motion

if TYPE_CHECKING:
    from swarm.physics.world import State, World

Array = Any


class Tables(NamedTuple):
    """What a decision does: column `action · (longest + 2) + min(ticks left, longest + 1)`.

    The last column of an action is a whole interval, the others are the clipped last interval of a life.
    """

    rows: Array  # (3 + 4 · targets, columns): κ*, duration [time], speed, the motions of `swimmer`
    whole: Array  # (actions,) ticks of a whole interval; (1,) where they are all the same
    last: Array  # (1,) longest + 1
    weights: Array  # collocation weights; None in still water
    width: int  # columns of an action


def make_tables(world: World, like: Array) -> Tables:
    """The tables in the array library, dtype and device of `like`."""
    xp = namespace(like)
    weights = as_array(world.scheme.weights, like) if world.in_flow else None
    ticks = world.interval_ticks if len(set(world.interval_ticks)) > 1 else world.interval_ticks[:1]
    whole = as_array(np.asarray(ticks), like, dtype=xp.int32)
    last = as_array(np.asarray([max(ticks) + 1]), like, dtype=xp.int32)
    return Tables(as_array(_rows(world), like), whole, last, weights, _width(world))


def _width(world: World) -> int:
    """Columns of the tables for each action."""
    return max(world.interval_ticks) + 2


def _rows(world: World) -> np.ndarray:
    """`Tables.rows` in float64."""
    left = np.tile(np.arange(_width(world)), world.n_actions)
    action = np.repeat(np.arange(world.n_actions), _width(world))
    whole = np.asarray(world.interval_ticks)[action]
    slack = world.life_ticks * world.tick - world.life  # what is missing of the last tick
    clipped = np.maximum(left * world.tick - slack, 0.0)
    duration = np.where(left > whole, np.asarray(world.intervals)[action], clipped)
    curvature, speed = np.asarray(world.curvatures)[action], np.asarray(world.action_speeds)[action]
    parts = (part.reshape(-1, len(left)) for part in motion(world, curvature, speed, duration))
    return np.vstack([world.normal_curvature(curvature), duration, speed, *parts])


def motion(world: World, curvature: Array, speed: Array, duration: Array) -> Motion:
    """Motion (2, ...) of an arc, or in a flow to all the scheme's targets (2, targets, ...)."""
    if not world.in_flow:
        return swimmer.arc(curvature, speed, duration)
    return world.scheme.motions(curvature, speed, duration)


def swum_curvature(world: World, action: Array, noise: Array, like: Array) -> Array:
    """Curvature (..., cells) of the arcs that are swum: what is chosen and its perturbation [1 / length]."""
    chosen = look_up(as_array(np.asarray(world.curvatures), like), action)
    return chosen + world.curvature_noise * noise[..., 1] if world.curvature_noise > 0 else chosen


def next_interval(world: World, state: State, action: Array, noise: Array) -> tuple[Array, ...]:
    """Clock after it (as `State.clock`), motion, duration [time], speed [length / time] and κ* (..., cells)
    of the next interval of each cell."""
    if not world.has_common_tick:
        return _counted_interval(world, state, action, noise)
    tables = world.tables(state.position)
    xp = namespace(state.position)
    action = xp.astype(action, xp.int32, copy=False)
    left = world.life_ticks - state.clock
    if world.egg is not None or world.domains:
        left = xp.where(state.finished, xp.zeros_like(left), left)
    whole = tables.whole if tables.whole.shape[0] == 1 else look_up(tables.whole, action)
    clock = state.clock + xp.minimum(left, whole)
    column = action * tables.width + xp.minimum(left, tables.last)
    rows = look_up(tables.rows, column)
    normal_curvature, duration, speed = rows[0, ...], rows[1, ...], rows[2, ...]
    if world.curvature_noise > 0:
        curvature = swum_curvature(world, action, noise, state.position)
        return clock, motion(world, curvature, speed, duration), duration, speed, normal_curvature
    parts = xp.reshape(rows[3:, ...], (4, -1, *column.shape)) if world.in_flow else rows[3:, ...]
    return clock, Motion(parts[:2, ...], parts[2:, ...]), duration, speed, normal_curvature


def _counted_interval(world: World, state: State, action: Array, noise: Array) -> tuple[Array, ...]:
    """`next_interval` where no common tick exists: decisions are counted by action, so rounding never piles
    up."""
    xp = namespace(state.position)
    speeds, intervals = (
        as_array(np.asarray(values), state.position) for values in (world.action_speeds, world.intervals)
    )
    left = world.life - time(world, state)
    whole, speed = look_up(intervals, action), look_up(speeds, action)
    duration = xp.minimum(whole, left)
    duration = xp.where(state.finished | time_is_up(world, state.clock), xp.zeros_like(left), duration)
    actions = as_array(np.arange(world.n_actions), action)
    taken = xp.astype(action[..., None] == actions, xp.int32)
    clock = state.clock + xp.where((duration > 0)[..., None], taken, xp.zeros_like(taken))
    chosen = look_up(as_array(np.asarray(world.curvatures), state.position), action)
    swum = swum_curvature(world, action, noise, state.position)
    return clock, motion(world, swum, speed, duration), duration, speed, world.normal_curvature(chosen)


def time_is_up(world: World, clock: Array) -> Array:
    """Whether lives (..., cells) have lasted as long as they can, by `State.clock`."""
    if world.has_common_tick:
        return at_least(clock, world.life_ticks)
    return _elapsed(world, clock, clock) >= world.life * (1 - 1e-6)


def time(world: World, state: State) -> Array:
    """Time lived (..., cells), `life` exactly when it is up [time]."""
    elapsed = _elapsed(world, state.clock, state.position)
    xp = namespace(elapsed)
    life = xp.full_like(elapsed, world.life)
    return xp.where(time_is_up(world, state.clock), life, xp.minimum(elapsed, life))


def _elapsed(world: World, clock: Array, like: Array) -> Array:
    xp = namespace(clock)
    dtype = like.dtype if xp.isdtype(like.dtype, "real floating") else xp.float32
    if world.has_common_tick:
        return xp.astype(clock, dtype) * world.tick
    durations = as_array(np.asarray(world.intervals), clock, dtype=dtype)
    return xp.sum(xp.astype(clock, dtype) * durations, axis=-1)
