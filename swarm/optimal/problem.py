"""What decides the best life: the part of a world that the physical limit depends on.

With full knowledge of the pose the best policy in a linear field follows by dynamic programming: backward
from the end of life, the largest gain still to come is found for every pose and time left. That works where
a decision leads to one known pose, in still water and in the Taylor–Green flow, and where all intervals are
whole numbers of one tick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from swarm.physics.fields import LinearField
from swarm.physics.flows import StillWater, TaylorGreen
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.collocation import swim
from swarm.physics.motion.helix import along_helix, helix
from swarm.physics.world import World

CUBIC = np.arange(-1, 3)  # the neighbours that a cubic reading goes through
CURVATURES = 65  # that stand for a range of them
MAX_TIMES = 100_000  # times left that are worth a table each

Progress = Callable[[float], None]  # told the part of the work that is done


@dataclass(frozen=True)
class Problem:
    """The swimmer, its clock and the flow, in a linear field of unit gradient along the last axis."""

    curvatures: tuple[float, ...]  # κ₁ … κ_m [1 / length]
    speeds: tuple[float, ...]  # with each action [length / time]
    ticks: tuple[int, ...]  # of a whole interval, with each action
    tick: float  # [time]
    life: float  # [time]
    flow: TaylorGreen | None  # None: still water
    dense: bool = False  # `curvatures` stand for all between the first and the last
    torsions: tuple[float, ...] | None = None  # τ₁ … τ_m [1 / length]; None: in the plane

    @cached_property
    def life_ticks(self) -> int:
        """Ticks of a life; the last one may be cut short."""
        return max(1, int(np.ceil(self.life / self.tick - 1e-9)))  # as the world counts them

    def duration(self, action: int, left: np.ndarray | int) -> np.ndarray:
        """Length (...) of the next interval with `left` (...) ticks to live: the last is cut short [time]."""
        whole = self.ticks[action]
        missing = self.life_ticks * self.tick - self.life  # of the last tick
        cut = np.maximum(left * self.tick - missing, 0.0)
        return np.where(np.asarray(left) > whole, whole * self.tick, cut)

    def after(self, action: int, left: np.ndarray | int) -> np.ndarray:
        """Ticks left (...) after that interval."""
        return np.maximum(np.asarray(left) - self.ticks[action], 0)

    def screw(self, action: int, duration: np.ndarray) -> tuple[np.ndarray, ...]:
        """What a cell in space swims for a time (...) with `action`."""
        assert self.torsions is not None
        same = np.ones(np.shape(duration))
        kappa, tau, speed = (each[action] * same for each in (self.curvatures, self.torsions, self.speeds))
        return helix(kappa, tau, speed * duration)

    def moved(self, pose: Pose, action: int, duration: np.ndarray) -> Pose:
        if self.torsions is not None:
            return along_helix(pose, self.screw(action, duration))
        same = np.ones(duration.shape)
        return swim(pose, self.curvatures[action] * same, self.speeds[action] * same, duration, self.flow)

    @cached_property
    def times(self) -> np.ndarray:
        """Ticks left (times,) that can occur at a decision or at the end, rising from 0 to the whole life."""
        occurs = np.zeros(self.life_ticks + 1, bool)
        occurs[-1] = True
        if len(set(self.ticks)) == 1:
            occurs[:: -self.ticks[0]] = True
        else:
            for left in range(self.life_ticks, 0, -1):
                if occurs[left]:
                    occurs[[max(left - whole, 0) for whole in self.ticks]] = True
        occurs[0] = True
        return np.flatnonzero(occurs)

    def row(self, left: np.ndarray) -> np.ndarray:
        """Where `left` (...) ticks stand among `times`."""
        return np.minimum(np.searchsorted(self.times, left), len(self.times) - 1)


def backward(
    problem: Problem,
    decision: Callable[[int, int], Any],
    last: Any,
    kept: Callable[[np.ndarray], Any],
    progress: Progress | None = None,
) -> Iterator[Any]:
    """The largest gain still to come at every time left, from that at the end of life, `last`, to its start.

    `decision(action, left)` has `before`, which gives what there is before it from what there is after it;
    that is `kept`, for instance as a spline.
    """
    whole = [decision(action, problem.life_ticks) for action in range(len(problem.ticks))]
    recent = {0: last}
    yield last
    for row, left in enumerate(problem.times.tolist()[1:], start=2):
        gains = []
        for action, ticks in enumerate(problem.ticks):
            step = whole[action] if left > ticks else decision(action, left)
            gains.append(step.before(recent[max(left - ticks, 0)]))
        recent[left] = kept(largest(np.asarray(gains), problem.dense)[0])
        for old in [time for time in recent if time and time < left - max(problem.ticks)]:
            del recent[old]
        yield recent[left]
        if progress is not None:
            progress(row / len(problem.times))


def largest(scores: np.ndarray, dense: bool) -> tuple[np.ndarray, np.ndarray]:
    """The largest of scores (curvatures, ...), and which curvature has it (...); where these are dense, both
    are read off a parabola through the largest and its neighbours.
    """
    if not dense:
        best = np.argmax(scores, axis=0)
        return np.maximum.reduce(scores), best
    best = np.clip(np.argmax(scores, axis=0), 1, len(scores) - 2)
    below, middle, above = (np.take_along_axis(scores, best[None] + i, axis=0)[0] for i in (-1, 0, 1))
    slope, bend = (above - below) / 2, below - 2 * middle + above
    offset = np.clip(-slope / np.where(bend < 0, bend, -np.inf), -1, 1)
    offset = np.where(bend < 0, offset, np.sign(slope))
    return middle + offset * (slope + 0.5 * offset * bend), best + offset


def heading_angle(pose: Pose) -> np.ndarray:
    """Heading θ (...) in (−π, π] [rad]."""
    return np.arctan2(pose.heading[..., 1], pose.heading[..., 0])


def lagrange(offset: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Weights (nodes, ...) of the values at whole-numbered `nodes` in a polynomial read at `offset` (...)."""
    weights = np.ones((len(nodes), *offset.shape))
    for i, node in enumerate(nodes):
        for other in nodes:
            if other != node:
                weights[i] *= (offset - other) / (node - other)
    return weights


def part_of(progress: Progress | None, low: float, high: float) -> Progress | None:
    """Reports of a part of the work as reports of the whole."""
    if progress is None:
        return None
    return lambda fraction: progress(low + (high - low) * fraction)


def why_no_limit(world: World) -> str | None:
    """What keeps the limit of a world from being computed, or None where nothing does."""
    if type(world.field) is not LinearField:
        return f"a linear field, got {world.field!r}"
    if world.dimensions == 3 and type(world.flow) is not StillWater:
        return f"still water in three dimensions, got {world.flow!r}"
    if type(world.flow) not in (StillWater, TaylorGreen):
        return f"still water or the Taylor–Green flow, got {world.flow!r}"
    if world.is_continuous and type(world.flow) is not StillWater:
        return f"still water where curvatures are chosen from a range, got {world.flow!r}"
    if world.has_noise:
        return "no perturbations, got noise"
    if world.is_shared or world.spread is not None:
        return (
            "cells that are alike and alone, got a world whose cells share a medium, meet, race, see each "
            "other or differ"
        )
    if not world.has_common_tick:
        return "intervals that share a tick, got interval_rule = 'exact' with varying speed"
    decisions = world.life_ticks / (min(world.interval_ticks) if len(set(world.interval_ticks)) == 1 else 1)
    if decisions > MAX_TIMES:
        return f"a life of at most {MAX_TIMES} times to decide at, got {decisions:.0f}"
    return None


def problem_of(world: World) -> Problem | None:
    """The problem a world poses, or None where there is no limit."""
    if why_no_limit(world) is not None:
        return None
    curvatures, dense = world.curvatures, world.action_range is not None
    if world.action_range is not None:
        curvatures = tuple(np.linspace(*world.action_range, CURVATURES).tolist())
    return Problem(
        curvatures=curvatures,
        dense=dense,
        speeds=(world.speed,) * CURVATURES if dense else world.action_speeds,
        ticks=world.interval_ticks[:1] * CURVATURES if dense else world.interval_ticks,
        tick=world.tick,
        life=world.life,
        flow=world.flow if isinstance(world.flow, TaylorGreen) else None,
        torsions=world.torsions,
    )
