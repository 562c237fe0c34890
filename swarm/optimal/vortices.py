"""Dynamic programming in the Taylor–Green flow: over place, heading and time left, on a periodic grid.

The table is laid out over the centre r + n/κ̄ of the circle a cell swims on and over its heading θ. Seen
from there the largest gain still to come is smooth in place, and a decision moves the centre but little.
With the height of the centre taken out, what is left to find is

    W(X, Y, θ; t) = max over actions of  ΔY + W(X′, Y′, θ′; t − interval),     W(X, Y, θ; 0) = −cos θ / κ̄,

and the largest gain of a life is W + cos θ/κ̄. The flow is the same after half a period along both x and y,
so half a period in x and a whole one in y hold everything. No other symmetry of the flow keeps the gradient
and the sense of turning.

Reading W at (X′, Y′, θ′) is done one coordinate after the other, by polynomials through five neighbours:
over θ for the centres and over Y for the X where the motion ends, which makes the three readings one motion
exactly. Maximising feeds the shortest waves of such a scheme; so they are damped in place, by δ⁸, which
leaves all longer ones alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from swarm.optimal.problem import CUBIC, Problem, Progress, heading_angle, lagrange
from swarm.optimal.problem import backward as problem_backward
from swarm.physics.motion.arc import Pose, centre_of_curvature

NODES = np.arange(-2, 3)  # the neighbours that a reading goes through while it builds a table
DAMPING = 0.2  # of the shortest wave, per decision
DAMPING_ORDER = 4  # half the order of the difference that damps
INVERSE_STEPS = 60  # at most, to find where a motion comes from
SETTLED = 1e-6  # and how exactly [length]
CHUNK = 10_000  # places whose motions are computed at once


@dataclass(frozen=True)
class Grid:
    """Centres (X, Y) and headings θ: `headings` × `places`/2 × `places` values, in this order."""

    places: int  # per period along y, even
    headings: int
    period: float  # [length]
    curvature: float  # κ̄, of the circle whose centre is meant [1 / length]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Headings, places along x (half a period), places along y."""
        return (self.headings, self.places // 2, self.places)

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Between neighbours in θ [rad], X and Y [length]."""
        step = self.period / self.places
        return (2 * math.pi / self.headings, step, step)

    @cached_property
    def points(self) -> tuple[np.ndarray, ...]:
        """θ, X and Y (points,) of every value."""
        axes = np.meshgrid(*(np.arange(n) for n in self.shape), indexing="ij")
        return tuple(axis.reshape(-1) * step for axis, step in zip(axes, self.spacing, strict=True))

    def index(self, theta: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Where the value at whole steps (θ, X, Y) is found; half a period in x goes with half a one in y."""
        headings, half, places = self.shape
        turns, x = np.divmod(x, half)
        return ((theta % headings) * half + x) * places + (y - turns * half) % places

    def coordinates(self, pose: Pose) -> tuple[np.ndarray, ...]:
        """θ, X and Y (...) of poses, in steps of the grid."""
        centre = centre_of_curvature(pose, np.asarray(self.curvature))
        parts = (heading_angle(pose), centre[..., 0], centre[..., 1])
        return tuple(part / step for part, step in zip(parts, self.spacing, strict=True))

    def pose(self, theta: np.ndarray, x: np.ndarray, y: np.ndarray) -> Pose:
        """The pose with heading θ [rad] on the circle around (X, Y) [length]."""
        cosine, sine = np.cos(theta), np.sin(theta)
        position = np.stack([x + sine / self.curvature, y - cosine / self.curvature], axis=-1)
        return Pose(position, np.stack([cosine, sine], axis=-1))

    def read(self, values: np.ndarray, coordinates: tuple[np.ndarray, ...]) -> np.ndarray:
        """`values` (points, ...) at `coordinates` (cells,), cubic in between: (cells, ...).

        Sums run in the same order however many cells there are.
        """
        whole = [np.floor(part) for part in coordinates]
        weights = [lagrange(part - low, CUBIC) for part, low in zip(coordinates, whole, strict=True)]
        theta, x, y = (low.astype(np.int64) for low in whole)
        axes = (slice(None), *(None,) * (values.ndim - 1))
        total: Any = 0.0
        for i, a in enumerate(CUBIC):
            for j, b in enumerate(CUBIC):
                for k, c in enumerate(CUBIC):
                    weight = weights[0][i] * weights[1][j] * weights[2][k]
                    total = total + weight[axes] * values[self.index(theta + a, x + b, y + c)]
        return total


def commensurate_headings(problem: Problem, least: int) -> int:
    """Number of headings, `least` or up to a third more, that all actions turn by in nearly whole steps."""
    pairs = zip(problem.curvatures, problem.speeds, problem.ticks, strict=True)
    turned = np.array([curvature * speed * ticks * problem.tick for curvature, speed, ticks in pairs])
    turns = turned / (2 * np.pi)
    choices = np.arange(least, max(least + 1, 4 * least // 3 + 1))
    steps = choices[:, None] * turns
    return int(choices[np.argmin(np.abs(steps - np.rint(steps)).max(axis=1))])


def backward(
    problem: Problem, grid: Grid, *, monotone: bool = False, progress: Progress | None = None
) -> Iterator[tuple[float, np.ndarray]]:
    """W at every time left, from the end of life to its start: its mean, and the rest (points,) in float32.

    With `monotone` no reading exceeds the values it lies between: less exact, but no steep front overshoots.
    """
    damp = _damping(grid)

    def kept(values: np.ndarray) -> tuple[float, np.ndarray]:
        mean = values.mean()
        rest = damp @ (values - mean).astype(np.float32)
        more = rest.mean(dtype=np.float64)
        return float(mean + more), rest - np.float32(more)

    last = 0.0, (-np.cos(grid.points[0]) / grid.curvature).astype(np.float32)
    return problem_backward(problem, partial(_Decision, problem, grid, monotone), last, kept, progress)


class _Decision:
    """What one decision does to a table: the readings along θ, Y and X, and how far the centre rises."""

    def __init__(self, problem: Problem, grid: Grid, monotone: bool, action: int, left: int) -> None:
        moved = partial(_moved, problem, grid, action, float(problem.duration(action, left)))
        starts = range(0, len(grid.points[0]), CHUNK)
        chunks = ([part[first : first + CHUNK] for part in grid.points] for first in starts)
        parts = [_offsets(moved, grid.spacing, *chunk) for chunk in chunks]
        theta, x, y, rise = (np.concatenate(part) for part in zip(*parts, strict=True))
        self.rise = rise.astype(np.float32)
        self.readings = [_reading(grid, axis, offset) for axis, offset in ((0, theta), (2, y), (1, x))]
        columns = [matrix.indices.reshape(-1, len(NODES))[:, 1:-1] for matrix in self.readings]
        self.between = [np.ascontiguousarray(part.T) for part in columns] if monotone else []

    def before(self, later: tuple[float, np.ndarray]) -> np.ndarray:
        """What is still to come (points,) before it, from mean and rest (points,) of what is after it."""
        mean, values = later
        for axis, matrix in enumerate(self.readings):
            read = matrix @ values
            if self.between and axis > 0:  # in place; headings carry no fronts
                near = [values[index] for index in self.between[axis]]
                np.clip(read, np.minimum.reduce(near), np.maximum.reduce(near), out=read)
            values = read
        return np.float64(mean) + (values + self.rise)


def _moved(
    problem: Problem, grid: Grid, action: int, duration: float, *places: np.ndarray
) -> tuple[np.ndarray, ...]:
    """How far θ [rad], X and Y [length] of cells there, their `places`, move."""
    theta, x, y = places
    curvature, speed = problem.curvatures[action], problem.speeds[action]
    end = problem.moved(grid.pose(*places), action, np.full(theta.shape, duration))
    centre = centre_of_curvature(end, np.asarray(grid.curvature))
    turn = curvature * speed * duration
    by_flow = (heading_angle(end) - theta - turn + np.pi) % (2 * np.pi) - np.pi
    return turn + by_flow, centre[..., 0] - x, centre[..., 1] - y


def _offsets(
    moved: Callable[..., tuple[np.ndarray, ...]],
    step: tuple[float, float, float],
    theta: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Where to read, in steps from each point: along θ, X and Y; and how far a cell there rises [length].

    X is read where a cell from the point ends; Y where one does that ends at the point's X; θ where one does
    that ends at the point's X and Y.
    """
    _, along_x, rise = moved(theta, x, y)
    from_x = x - along_x
    for _ in range(INVERSE_STEPS):
        before, (_, shift, along_y) = from_x, moved(theta, from_x, y)
        from_x = x - shift
        if np.abs(from_x - before).max() < SETTLED:
            break
    from_y = y - along_y
    for _ in range(INVERSE_STEPS):
        before, (turn, shift, rest) = (from_x, from_y), moved(theta, from_x, from_y)
        from_x, from_y = x - shift, y - rest
        if max(np.abs(from_x - before[0]).max(), np.abs(from_y - before[1]).max()) < SETTLED:
            break
    return turn / step[0], along_x / step[1], along_y / step[2], rise


def _reading(grid: Grid, axis: int, offset: np.ndarray) -> Any:
    """The matrix that reads a table along one axis at `offset` (points,) steps from each point."""
    nearest = np.rint(offset).astype(np.int64)
    weights = lagrange(offset - nearest, NODES)
    columns = []
    for node in NODES:
        steps = list(np.unravel_index(np.arange(len(offset)), grid.shape))
        steps[axis] = steps[axis] + nearest + node
        columns.append(grid.index(*steps))
    return _matrix(columns, list(weights))


def _damping(grid: Grid) -> Any:
    """The matrix that damps the shortest waves along X and Y."""
    steps = np.unravel_index(np.arange(math.prod(grid.shape)), grid.shape)
    theta, x, y = steps
    columns, weights = [grid.index(*steps)], [np.ones(len(theta))]
    for node in range(-DAMPING_ORDER, DAMPING_ORDER + 1):
        share = (-1) ** node * math.comb(2 * DAMPING_ORDER, node + DAMPING_ORDER) / 4**DAMPING_ORDER
        if node == 0:
            weights[0] -= 2 * DAMPING * share
            continue
        columns += [grid.index(theta, x + node, y), grid.index(theta, x, y + node)]
        weights += 2 * [np.full(len(theta), -DAMPING * share)]
    return _matrix(columns, weights)


def _matrix(columns: list[np.ndarray], weights: list[np.ndarray]) -> Any:
    from scipy.sparse import csr_array

    size, width = len(columns[0]), len(columns)
    data = np.stack(weights, axis=-1).astype(np.float32).reshape(-1)
    index = np.stack(columns, axis=-1).astype(np.int32).reshape(-1)
    return csr_array((data, index, np.arange(size + 1, dtype=np.int32) * width), shape=(size, size))
