"""What is kept of the dynamic programming in the Taylor–Green flow: the limit by grid, and a small table to
steer by.

The limit needs the table at the start of life alone; it is computed on three grids, which shows what they
leave out. The policy looks one decision ahead, so it needs the tables of all times left. They are alike: a
few of their principal components hold them all to a fraction of what a decision can win or lose, in a file
of a few megabytes.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from swarm.optimal.problem import Problem, Progress, heading_angle, part_of
from swarm.optimal.vortices import Grid, backward, commensurate_headings
from swarm.physics.motion.arc import Pose

Grids = tuple[tuple[int, int], ...]  # places, headings at least
Shapes = dict[str, tuple[type, tuple[int, ...]]]  # of tensors by name

GRIDS = ((40, 32), (56, 64), (80, 96))  # places and, at least, headings: for the limit
KEPT_PLACES = 40  # of the grid that the limit is kept on
POLICY_GRID = (40, 32)
COMPONENTS = 40  # that the policy's tables are made of
SAMPLES = 1200  # tables that these are found from, at most
FAST = 1.5  # flow speed, in climbing speeds of the swimmers, from which on vortices hold them
CLIMBING = 0.16  # about the climbing speed per swimming speed


def is_fast(problem: Problem) -> bool:
    """Whether the flow is faster than swimmers climb, so that what they can still gain has steep fronts."""
    assert problem.flow is not None
    return problem.flow.speed_scale > FAST * CLIMBING * max(problem.speeds)


def grid_of(problem: Problem, places: int, headings: int) -> Grid:
    """A grid with that many places and at least that many headings."""
    assert problem.flow is not None
    curvature = 0.5 * (problem.curvatures[0] + problem.curvatures[-1])
    return Grid(places, commensurate_headings(problem, headings), problem.flow.period, curvature)


@dataclass(frozen=True)
class _Kept:
    """Tables of a problem on grids."""

    problem: Problem
    grids: Grids
    tensors: dict[str, np.ndarray]  # see `shapes`


class VortexLimit(_Kept):
    """The largest gain of a life in the flow, per unit of c_k [length], by ever finer grids."""

    name = "limit"

    @staticmethod
    def kept_on(problem: Problem, grids: Grids) -> Grid:
        """The grid that the values are kept on."""
        return grid_of(problem, min(KEPT_PLACES, grids[-1][0]), grids[-1][1])

    @classmethod
    def shapes(cls, problem: Problem, grids: Grids) -> Shapes:
        points = math.prod(cls.kept_on(problem, grids).shape)
        return {"means": (np.float64, (len(grids),)), "values": (np.float16, (len(grids), points))}

    @classmethod
    def compute(cls, problem: Problem, grids: Grids = GRIDS, progress: Progress | None = None) -> VortexLimit:
        kept = cls.kept_on(problem, grids)
        coordinates = kept.coordinates(kept.pose(*kept.points))
        work = np.array([math.prod(pair) * pair[0] for pair in grids], float)
        before = np.concatenate([[0.0], np.cumsum(work)]) / work.sum()
        means, values = [], []
        for number, pair in enumerate(grids):
            grid = grid_of(problem, *pair)
            report = part_of(progress, before[number], before[number + 1])
            steps = backward(problem, grid, monotone=is_fast(problem), progress=report)
            mean, rest = deque(steps, maxlen=1)[0]  # a whole life left
            places = tuple(
                part * b / a for part, a, b in zip(coordinates, grid.spacing, kept.spacing, strict=True)
            )
            means.append(mean)
            values.append(grid.read(rest, places))
        return cls(problem, grids, {"means": np.array(means), "values": np.array(values, np.float16)})

    def bounds(self, pose: Pose) -> dict[str, np.ndarray]:
        """The largest gain of a life (cells,) that starts with `pose`, by ever finer grids."""
        kept = self.kept_on(self.problem, self.grids)
        read = kept.read(self.tensors["values"].T.astype(np.float64), kept.coordinates(pose))
        by_grid = read + self.tensors["means"] + np.cos(heading_angle(pose))[:, None] / kept.curvature
        named = [grid_of(self.problem, *pair) for pair in self.grids]
        names = [f"{grid.places}² places, {grid.headings} headings" for grid in named]
        return dict(zip(names, by_grid.T, strict=True))


class VortexTables(_Kept):
    """The largest gain still to come in the flow at all times left, on one grid, as a sum of components."""

    name = "policy"

    @classmethod
    def shapes(cls, problem: Problem, grids: Grids) -> Shapes:
        points, times = math.prod(grid_of(problem, *grids[0]).shape), len(problem.times)
        components = min(COMPONENTS, times)
        return {
            "means": (np.float64, (times,)),
            "coefficients": (np.float16, (times, components)),
            "components": (np.float16, (points, components)),
        }

    @classmethod
    def compute(
        cls, problem: Problem, grids: Grids = (POLICY_GRID,), progress: Progress | None = None
    ) -> VortexTables:
        """The tables on one grid. Where times are too many to keep them all, they are computed twice."""
        grid = grid_of(problem, *grids[0])
        stride = math.ceil(len(problem.times) / SAMPLES)
        fast = is_fast(problem)
        means, samples = [], []
        report = part_of(progress, 0.0, 1.0 if stride == 1 else 0.5)
        for row, (mean, rest) in enumerate(backward(problem, grid, monotone=fast, progress=report)):
            means.append(mean)
            if row % stride == 0:
                samples.append(rest)
        components = _principal(np.stack(samples), min(COMPONENTS, len(means)))
        if stride > 1:
            again = backward(problem, grid, monotone=fast, progress=part_of(progress, 0.5, 1.0))
            coefficients = np.stack([rest @ components for _, rest in again])
        else:
            coefficients = np.stack(samples) @ components
        scale = math.sqrt(len(components))  # so that both have numbers of ordinary size
        tensors = {
            "means": np.array(means),
            "coefficients": (coefficients / scale).astype(np.float16),
            "components": (components * scale).astype(np.float16),
        }
        return cls(problem, grids, tensors)

    @cached_property
    def _grid(self) -> Grid:
        return grid_of(self.problem, *self.grids[0])

    @cached_property
    def _working(self) -> tuple[np.ndarray, np.ndarray]:
        return self.tensors["coefficients"].astype(np.float32), self.tensors["components"].astype(np.float32)

    def ahead(self, pose: Pose, left: np.ndarray) -> np.ndarray:
        """The largest gain still to come (cells,) from `pose` with `left` (cells,) ticks to live."""
        coefficients, components = self._working
        row = self.problem.row(left)
        read = self._grid.read(components, self._grid.coordinates(pose))
        rest = (read * coefficients[row]).sum(axis=-1)
        return self.tensors["means"][row] + rest + np.cos(heading_angle(pose)) / self._grid.curvature


def _principal(samples: np.ndarray, count: int) -> np.ndarray:
    """The `count` directions (points, count), orthonormal, that hold most of `samples` (samples, points)."""
    vectors = np.linalg.eigh((samples @ samples.T).astype(np.float64))[1]
    largest = vectors[:, : -count - 1 : -1].astype(np.float32)
    return np.linalg.qr(samples.T @ largest)[0]
