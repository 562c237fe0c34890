"""The physical limit in space, in still water: dynamic programming over the gradient as a cell sees it and
time left.

A screw with the displacement Δ and the rotation R, as the cell sees them, raises it by g·Δ, where g is the
unit gradient in its frame (t, n, b), and leaves it with Rᵀg, whatever its place. So the largest gain still
to come is a function of g, on the sphere, and of time left alone,

    V(g; t) = max over actions of  g·Δ + V(Rᵀg; t − interval),     V(g; 0) = 0,

held on evenly spaced angles from an axis and around it, and read between them by cubic splines that run on
over the poles. What the spacing leaves out is judged from fewer angles.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from swarm.optimal.problem import CUBIC, Problem, Progress, backward, part_of
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.helix import conjugate, frame, product, rotated

SPHERES = (32, 64, 96)  # angles from the pole: for the limit
SEQUENCES = 16  # of actions that are looked over at once: values are read the more seldom, and blur less
POLICY_SPHERE = 48  # for the tables that the policy looks ahead in
KEPT_NUMBERS = 2**24  # of all these tables together, about

Spheres = tuple[int, ...]


@dataclass(frozen=True)
class Sphere:
    """Directions as a cell sees them: `angles` from a pole × twice as many around it, in this order."""

    angles: int
    tilt: float  # of the pole from the tangent towards the binormal [rad]

    @property
    def size(self) -> int:
        return 2 * self.angles**2

    @cached_property
    def directions(self) -> np.ndarray:
        """Unit vectors (size, 3): components along t, n and b. None is a pole."""
        step = math.pi / self.angles
        from_pole, around = np.meshgrid(
            step * (np.arange(self.angles) + 0.5), step * np.arange(2 * self.angles), indexing="ij"
        )
        sine = np.sin(from_pole)
        parts = np.cos(from_pole), sine * np.cos(around), sine * np.sin(around)
        return np.stack(parts, axis=-1).reshape(-1, 3) @ self._axes

    @cached_property
    def _axes(self) -> np.ndarray:
        """Unit vectors (3, 3) in the cell's frame: the pole, n and the third."""
        cosine, sine = math.cos(self.tilt), math.sin(self.tilt)
        return np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])

    def spline(self, values: np.ndarray) -> np.ndarray:
        """Coefficients (size,) of the cubic spline through `values` (size,)."""
        from scipy.ndimage import spline_filter1d

        n = self.angles
        table = values.reshape(n, 2 * n)
        circles = np.concatenate([table[:, :n], table[::-1, n:]])  # through both poles
        circles = spline_filter1d(circles, axis=0, mode="grid-wrap")
        table = np.concatenate([circles[:n], circles[: n - 1 : -1]], axis=1)
        return spline_filter1d(table, axis=1, mode="grid-wrap").reshape(-1)

    def nodes(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The coefficients that a spline at directions (cells, 3) is read from, and weights (cells, 16)."""
        n = self.angles
        x, y, z = (direction @ self._axes.T).T
        steps = np.arctan2(np.hypot(y, z), x) * (n / math.pi) - 0.5, np.arctan2(z, y) * (n / math.pi)
        low = [np.floor(part) for part in steps]
        along, across = (_b_spline(part - whole) for part, whole in zip(steps, low, strict=True))
        row, column = (whole.astype(np.int32)[:, None] + CUBIC.astype(np.int32) for whole in low)
        beyond = (row < 0) | (row >= n)  # on the other side of a pole
        row = np.where(beyond, (2 * n - 1 - row) % (2 * n), row)
        columns = (each[:, None, :] % (2 * n) for each in (column + n, column))
        index = row[:, :, None] * (2 * n) + np.where(beyond[:, :, None], *columns)
        weights = along[:, :, None] * across[:, None, :]
        return index.reshape(len(x), -1), weights.reshape(len(x), -1)

    def read(self, coefficients: np.ndarray, direction: np.ndarray, row: Any = ...) -> np.ndarray:
        """The spline of (size,), or of (rows, size) that in `row` (cells,), at directions (cells, 3)."""
        total: Any = 0.0
        for index, weight in zip(*(part.T for part in self.nodes(direction)), strict=True):
            total = total + weight * coefficients[row, index]
        return total


def _b_spline(offset: np.ndarray) -> np.ndarray:
    """Weights (..., 4) of a cubic spline's coefficients, read `offset` (...) steps beyond the second."""
    rest = 1 - offset
    inner = [4 - 3 * part * part * (2 - part) for part in (offset, rest)]
    return np.stack([rest**3, *inner, offset**3], axis=-1) / 6


def sphere_of(problem: Problem, angles: int) -> Sphere:
    """The sphere whose pole is the axis of the helix that climbs most: on its way, nothing is read between
    angles from the pole, so that nothing blurs where long lives end up.
    """
    assert problem.torsions is not None
    pairs = zip(problem.curvatures, problem.torsions, problem.speeds, strict=True)
    _, tilt = max(
        (speed * abs(tau) / math.hypot(kappa, tau), math.atan2(kappa, tau)) for kappa, tau, speed in pairs
    )
    return Sphere(angles, tilt)


class _Decisions:
    """What a sequence of decisions does to a spline over a sphere."""

    def __init__(
        self, problem: Problem, sphere: Sphere, sequences: list[tuple[int, ...]], number: int, left: int
    ) -> None:
        from scipy.sparse import csr_array

        moved, turned = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        for action in sequences[number]:
            screw = problem.screw(action, problem.duration(action, left))
            moved = moved + rotated(turned, np.stack(screw[:3]))
            turned = product(turned, np.stack(screw[3:]))
            left = int(problem.after(action, left))
        self.gain = sphere.directions @ moved
        index, weights = sphere.nodes(rotated(conjugate(turned), sphere.directions))
        rows = np.arange(sphere.size + 1, dtype=np.int32) * index.shape[1]
        parts = weights.astype(np.float32).reshape(-1), index.reshape(-1), rows
        self.matrix = csr_array(parts, shape=(sphere.size, sphere.size))

    def before(self, spline: np.ndarray) -> np.ndarray:
        """The largest gain still to come (size,) before them, from the spline of that after them."""
        mean = spline.mean()
        return self.gain + mean + self.matrix @ (spline - mean).astype(np.float32)


def _sequences(problem: Problem, most: int) -> list[tuple[int, ...]]:
    """Sequences of actions as long as there are at most so many of them, of one action where intervals
    differ.
    """
    actions, length = len(problem.ticks), 1
    while len(set(problem.ticks)) == 1 < actions ** (length + 1) <= most:
        length += 1
    return list(itertools.product(range(actions), repeat=length))


def _splines(
    problem: Problem, sphere: Sphere, most: int = 1, progress: Progress | None = None
) -> Iterator[np.ndarray]:
    """The spline (size,) of the largest gain still to come, from the end of life to its start: after each
    decision, or after as many at once as have `most` sequences.
    """
    sequences = _sequences(problem, most)
    ticks = tuple(sum(problem.ticks[action] for action in each) for each in sequences)
    blocks = dataclasses.replace(problem, ticks=ticks)
    decisions = functools.partial(_Decisions, problem, sphere, sequences)
    return backward(blocks, decisions, np.zeros(sphere.size), sphere.spline, progress)


def seen_gradient(pose: Pose) -> np.ndarray:
    """The upward unit vector (cells, 3) in the cells' frames: components along t, n and b."""
    return np.stack([vector[..., 2] for vector in frame(pose.heading)], axis=-1)


@dataclass(frozen=True)
class HelicalLimit:
    """The largest gain of a life in space, per unit of c_k [length], on ever finer spheres."""

    problem: Problem
    spheres: Spheres
    tensors: dict[str, np.ndarray]  # see `shapes`

    name = "limit"

    @classmethod
    def shapes(cls, problem: Problem, spheres: Spheres) -> dict[str, tuple[type, tuple[int, ...]]]:
        return {f"{n} angles": (np.float64, (sphere_of(problem, n).size,)) for n in spheres}

    @classmethod
    def compute(cls, problem: Problem, spheres: Spheres, progress: Progress | None = None) -> HelicalLimit:
        tensors, sizes = {}, [sphere_of(problem, n).size for n in spheres]
        for i, (n, name) in enumerate(zip(spheres, cls.shapes(problem, spheres), strict=True)):
            low, high = (sum(sizes[:end]) / sum(sizes) for end in (i, i + 1))
            *_, tensors[name] = _splines(
                problem, sphere_of(problem, n), SEQUENCES, part_of(progress, low, high)
            )
        return cls(problem, spheres, tensors)

    def bounds(self, pose: Pose) -> dict[str, np.ndarray]:
        """The largest gain of a life (cells,) that starts with `pose`, by ever finer spheres."""
        seen = seen_gradient(pose)
        spheres = zip(self.spheres, self.tensors.items(), strict=True)
        return {name: sphere_of(self.problem, n).read(spline, seen) for n, (name, spline) in spheres}


@dataclass(frozen=True)
class HelicalTables:
    """The largest gain still to come in space, per unit of c_k [length]."""

    sphere: Sphere
    left: np.ndarray  # (rows,) ticks left of each row; linear in between
    splines: np.ndarray  # (rows, size) float32

    @classmethod
    def compute(cls, problem: Problem, angles: int) -> HelicalTables:
        """The tables on one sphere, of all times left that there is room for."""
        sphere, times = sphere_of(problem, angles), problem.times
        stride = math.ceil(len(times) * sphere.size / KEPT_NUMBERS)
        kept = np.unique([*range(0, len(times), stride), len(times) - 1])
        splines = np.zeros((len(kept), sphere.size), np.float32)
        for row, spline in enumerate(_splines(problem, sphere)):
            splines[np.searchsorted(kept, row)] = spline  # the last that is written to a row is its own
        return cls(sphere, times[kept], splines)

    def ahead(self, pose: Pose, left: np.ndarray) -> np.ndarray:
        """The largest gain still to come (cells,) from `pose` with `left` (cells,) ticks to live."""
        above = np.clip(np.searchsorted(self.left, left), 1, len(self.left) - 1)
        low, high = self.left[above - 1], self.left[above]
        seen, part = seen_gradient(pose), (left - low) / (high - low)
        later = self.sphere.read(self.splines, seen, above)
        if (part == 1).all():
            return later
        return part * later + (1 - part) * self.sphere.read(self.splines, seen, above - 1)
