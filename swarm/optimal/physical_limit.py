"""The physical limit of chemotaxis: the largest gain that full knowledge of the pose allows, as a bound and
as a policy.

No cell can gain more on average than the limit, so every gain is quoted against it. It exists for the
linear field without perturbations, in still water, in the plane and in space, and in the Taylor–Green flow,
with intervals that share a tick; elsewhere it is None. The gain is Δc = c(t_life) − c(0), in concentration.
"""

from __future__ import annotations

import sys
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, namespace
from swarm.optimal import still, store
from swarm.optimal.helical import POLICY_SPHERE, SPHERES, HelicalLimit, HelicalTables
from swarm.optimal.problem import Problem, largest, problem_of, why_no_limit
from swarm.optimal.tables import GRIDS, POLICY_GRID, VortexLimit, VortexTables
from swarm.physics.flows import TaylorGreen
from swarm.physics.motion.arc import Pose
from swarm.physics.starts import Starts
from swarm.physics.world import State, World

Array = Any


class LimitDetails(NamedTuple):
    """The limit for some starts, with what it was found from."""

    value: float  # mean of the largest gains over the starts, extrapolated over the grids [concentration]
    error: float  # about how far off that may be [concentration]
    by_grid: dict[str, float]  # the mean on each grid, the finest last [concentration]


def limit(world: World, starts: Starts) -> float | None:
    """The largest mean gain of cells with these starts [concentration], or None where there is no limit.

    In the Taylor–Green flow it is computed once, in a minute or two, and kept on the disk; for the paper's
    flow it is shipped.
    """
    details = limit_details(world, starts)
    return None if details is None else details.value


def limit_details(world: World, starts: Starts) -> LimitDetails | None:
    """The limit for these starts with its error and the values on each grid, or None where there is none."""
    bounds = bounds_of(world)
    if bounds is None:
        return None
    means = bounds.means(starts.position, starts.heading)
    return LimitDetails(*extrapolated(list(means.values())), means)


def bound(world: World, starts: Starts) -> np.ndarray | None:
    """The largest gain (cells,) of a life from each start [concentration], or None where there is none."""
    bounds = bounds_of(world)
    return None if bounds is None else list(bounds.by_grid(starts.position, starts.heading).values())[-1]


def extrapolated(values: list[float]) -> tuple[float, float]:
    """The value that ever finer grids tend to, and about its error.

    Where the last three approach it like a geometric series, that series is summed; otherwise the grids
    differ by no more than chance and the finest one's value is taken. The error is the larger of the last
    two steps, or what summing the series adds.
    """
    before, last = np.diff(values[-3:])
    error = max(abs(before), abs(last))
    ratio = last / before if before != 0 else 0.0
    if not 0.0 < ratio < 0.7:
        return values[-1], float(error)
    added = last * ratio / (1 - ratio)
    return float(values[-1] + added), float(max(abs(added), abs(last)))


class Optimal:
    """Takes the action that is best with full knowledge of the pose and the time left (dynamic programming).

    Raises ValueError for a world without a limit.
    """

    deterministic = True

    def __init__(self, world: World) -> None:
        self._world = world
        self._problem, self._tables = _policy(world)

    def scores(self, world: World, state: State) -> np.ndarray:
        """What lives (actions, ..., cells) can still gain that go on with each action, at best [length].

        A world other than the one it was made for is solved when it comes.
        """
        if world is not self._world:
            self._world = world
            self._problem, self._tables = _policy(world)
        problem, cells = self._problem, tuple(state.clock.shape)
        pose = Pose(*(_numpy(part).reshape(-1, part.shape[-1]) for part in state.pose))
        left = problem.life_ticks - _numpy(state.clock).reshape(-1).astype(np.int64)
        found = [_score(problem, self._tables, pose, left, action) for action in range(len(problem.ticks))]
        return np.reshape(found, (-1, *cells))

    def act(self, world: World, state: State, uniform: Array | None = None) -> Array:
        """Actions (..., cells); curvatures where they are continuous."""
        scores, problem = self.scores(world, state), self._problem
        action = largest(scores.reshape(len(scores), -1), problem.dense)[1].reshape(scores.shape[1:])
        if problem.dense:
            low, high = problem.curvatures[0], problem.curvatures[-1]
            return as_array(low + (high - low) / (len(problem.curvatures) - 1) * action, state.memory)
        return as_array(action, state.clock, dtype=namespace(state.clock).int32)


def _score(problem: Problem, tables: Any, pose: Pose, left: np.ndarray, action: int) -> np.ndarray:
    """What a life (cells,) can still gain when it goes on with `action` [length]."""
    end = problem.moved(pose, action, problem.duration(action, left))
    rise = end.position[..., -1] - pose.position[..., -1]
    return rise + tables.ahead(end, problem.after(action, left))


def _numpy(array: Array) -> np.ndarray:
    if hasattr(array, "detach"):  # torch: off its device
        array = array.detach().cpu().numpy()
    array = np.asarray(array)
    return array.astype(np.float64) if array.dtype.kind == "f" else array


_still = lru_cache(maxsize=8)(still.solve)
_helical = lru_cache(maxsize=8)(HelicalTables.compute)


def _policy(world: World) -> tuple[Problem, Any]:
    problem = problem_of(world)
    if problem is None:
        raise ValueError(f"Optimal needs {why_no_limit(world)}")
    if problem.torsions is not None:
        return problem, _helical(problem, POLICY_SPHERE)
    if problem.flow is None:
        return problem, _still(problem)
    return problem, store.tables(VortexTables, problem, (POLICY_GRID,))


class Bounds(NamedTuple):
    """What the largest gains are read from; it can go to other processes, and reads nothing from the disk."""

    scale: float  # c_k [concentration / length]
    tables: Any

    def by_grid(self, position: np.ndarray, heading: np.ndarray) -> dict[str, np.ndarray]:
        """The largest gain (cells,) from each start [concentration], by each grid, the finest last."""
        position = np.asarray(position, np.float64).reshape(-1, np.shape(position)[-1])
        heading = np.asarray(heading, np.float64).reshape(len(position), -1)
        if heading.shape[-1] == 1:  # an angle, in the plane
            heading = np.concatenate([np.cos(heading), np.sin(heading)], axis=-1)
        pose = Pose(position, heading)
        return {name: self.scale * values for name, values in self.tables.bounds(pose).items()}

    def means(self, position: np.ndarray, heading: np.ndarray) -> dict[str, float]:
        """The mean largest gain of these starts [concentration], by each grid."""
        return {name: float(values.mean()) for name, values in self.by_grid(position, heading).items()}


def bounds_of(world: World) -> Bounds | None:
    """What the limit of a world is read from, computed where it is not at hand; None where there is none."""
    problem = problem_of(world)
    if problem is None:
        return None
    if problem.torsions is not None:
        tables = store.tables(HelicalLimit, problem, SPHERES)
    else:
        tables = _still(problem) if problem.flow is None else store.tables(VortexLimit, problem, GRIDS)
    return Bounds(world.field.gradient_scale, tables)


def ship(folder: Path = store.SHIPPED) -> list[Path]:
    """Computes what is shipped, the tables for the paper's Taylor–Green flow, and writes them to `folder`."""
    problem = problem_of(World(flow=TaylorGreen(), life=400.0))
    assert problem is not None
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for kind, grids in ((VortexLimit, GRIDS), (VortexTables, (POLICY_GRID,))):
        key = store.key_of(kind, problem, grids)
        path = folder / store.file_name(key)
        with store.shown_progress(f"Optimal {key['kind']} in the Taylor–Green flow") as progress:
            tensors = kind.compute(problem, grids, progress).tensors
        store.write(path, key, tensors)
        written.append(path)
    return written


if __name__ == "__main__":
    for path in ship(*map(Path, sys.argv[1:])):
        print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")
