"""The physical limit in still water: dynamic programming over heading and time left.

An arc of curvature κ over the time s raises a cell by ∫ v sin(θ + κ v s) ds and turns it by κ v s, whatever
its place. So the largest gain still to come is a function of heading and time left alone,

    V(θ; t) = max over actions of  gain(θ) + V(θ + turn; t − interval),     V(θ; 0) = 0,

held on evenly spaced headings and read between them by cubic polynomials. What the spacing leaves out is
judged from half and a quarter as many headings, and where any curvature of a range may be chosen, as many of
them: the largest is read off a parabola through three evenly spaced ones.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass

import numpy as np

from swarm.optimal.problem import CUBIC, Problem, backward, heading_angle, lagrange
from swarm.physics.motion.arc import Pose, arc

HEADINGS = 2048  # of the table the limit is read from
KEPT_HEADINGS = 512  # of the tables for all times, which the policy looks ahead in
KEPT_NUMBERS = 2**24  # of all these tables together, at most
READ = 2**13  # cells whose numbers fit a processor's cache


@dataclass(frozen=True)
class StillTables:
    """The largest gain still to come in still water, per unit of c_k [length]."""

    problem: Problem
    limits: tuple[np.ndarray, ...]  # at the start of life, by heading: on ever more headings
    values: np.ndarray  # (times, headings) float32, at all times left

    def bounds(self, pose: Pose) -> dict[str, np.ndarray]:
        """The largest gain of a life (cells,) that starts with `pose`, by ever finer grids."""
        heading = heading_angle(pose)
        return {f"{len(table)} headings": _read(table, heading) for table in self.limits}

    def ahead(self, pose: Pose, left: np.ndarray) -> np.ndarray:
        """The largest gain still to come (cells,) from `pose` with `left` (cells,) ticks to live."""
        return _read(self.values, heading_angle(pose), self.problem.row(left))


def solve(problem: Problem, headings: int = HEADINGS) -> StillTables:
    """Tables on `headings` headings, with the limit on half and a quarter as many beside it."""
    coarser = [_backward(_coarser(problem, n), headings // n, keep=0)[0] for n in (4, 2)]
    kept = min(KEPT_HEADINGS, headings, max(32, KEPT_NUMBERS // len(problem.times)))
    finest, values = _backward(problem, headings, keep=2 ** int(np.log2(kept)))
    return StillTables(problem, (*coarser, finest), values)


def _coarser(problem: Problem, times: int) -> Problem:
    """The problem with so many times fewer curvatures, where these stand for a range."""
    if not problem.dense:
        return problem
    parts = (getattr(problem, name)[::times] for name in ("curvatures", "speeds", "ticks"))
    return dataclasses.replace(problem, **dict(zip(("curvatures", "speeds", "ticks"), parts, strict=True)))


def _backward(problem: Problem, headings: int, *, keep: int) -> tuple[np.ndarray, np.ndarray]:
    """The largest gain of a life (headings,), and of all times left on `keep` of the headings."""
    theta = 2 * np.pi / headings * np.arange(headings)
    decision = functools.partial(_Arc, problem, theta)
    kept = np.zeros((len(problem.times), keep), np.float32)
    for row, values in enumerate(backward(problem, decision, np.zeros(headings), lambda values: values)):
        if keep:
            kept[row] = values[:: headings // keep]
    return values, kept


class _Arc:
    """What one decision does to every heading of a grid."""

    def __init__(self, problem: Problem, theta: np.ndarray, action: int, left: int) -> None:
        curvature, speed = problem.curvatures[action], problem.speeds[action]
        duration = problem.duration(action, left)
        (forward, _), (aside, _) = arc(np.float64(curvature), np.float64(speed), duration)
        self.gain = forward * np.sin(theta) + aside * np.cos(theta)
        steps = curvature * speed * float(duration) * len(theta) / (2 * np.pi)
        self.steps = int(np.floor(steps))
        self.weights = lagrange(np.asarray(steps - self.steps), CUBIC)

    def before(self, values: np.ndarray) -> np.ndarray:
        """The largest gain still to come (headings,) before it, from `values` (headings,) after it."""
        near = np.take(values, np.arange(self.steps - 1, self.steps + len(values) + 2), mode="wrap")
        return self.gain + np.convolve(near, self.weights[::-1], mode="valid")


def _read(table: np.ndarray, heading: np.ndarray, row: np.ndarray | None = None) -> np.ndarray:
    """`table` (headings,), or of (rows, headings) the `row` (cells,), at `heading` (cells,) [rad]."""
    if len(heading) > READ:
        parts = range(0, len(heading), READ)
        rows = [None if row is None else row[at : at + READ] for at in parts]
        read = [_read(table, heading[at : at + READ], own) for at, own in zip(parts, rows, strict=True)]
        return np.concatenate(read)
    headings = table.shape[-1]
    steps = heading * (headings / (2 * np.pi))
    lower = np.floor(steps)
    first = 0 if row is None else row * headings
    flat, near = table.reshape(-1), lower.astype(np.int64)
    total = np.zeros(heading.shape)
    for node, weight in zip(CUBIC, lagrange(steps - lower, CUBIC), strict=True):
        total += weight * flat[first + (near + node) % headings]
    return total
