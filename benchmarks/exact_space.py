"""What lives in space are off from closed forms and from an adaptive integrator: a table of measured errors.

`tests/physics/test_space.py` holds each row to its bound. `python -m benchmarks exact_space --out
docs/benchmarks` writes the table.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.exact_solutions import Law
from swarm.physics.flows import ABCFlow, FunctionFlow, ShearAroundSphere, ShearFlow, UniformFlow
from swarm.physics.motion import arc, helix
from swarm.physics.motion.arc import Pose
from swarm.physics.starts import draw_starts
from swarm.physics.world import World

LAWS: list[Law] = []
PAIRS = np.array([(5.5, 7.7), (7.5, -5.7), (-4.0, 3.0), (3.0, 0.0), (0.0, 4.0), (1e-9, 1e-9), (0.0, 0.0)])
CELLS = 12


def law(name: str, bound: float) -> Callable[[Callable[[], float]], Callable[[], float]]:
    """Decorator of a function that measures the largest error of places [length] and frames."""

    def keep(error: Callable[[], float]) -> Callable[[], float]:
        LAWS.append(Law(name, "length, axes", bound, error))
        return error

    return keep


def run() -> list[dict[str, Any]]:
    """Rows of the table."""
    return [{"law": law.name, "error": law.error(), "at most": law.bound} for law in LAWS]


def rotations(cells: int, seed: int = 0) -> np.ndarray:
    """Random frames (cells, 4)."""
    frames = np.random.default_rng(seed).normal(size=(cells, 4))
    return frames / np.linalg.norm(frames, axis=-1, keepdims=True)


def matrix(quaternion: Any) -> np.ndarray:
    """Rows t, n, b (..., 3, 3) of frames (..., 4), without the functions that are measured."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion), -1, 0)
    t = w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)
    n = 2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)
    return np.stack(
        [np.stack(t, axis=-1), np.stack(n, axis=-1), np.cross(*(np.stack(each, axis=-1) for each in (t, n)))],
        axis=-2,
    )


def place_and_frame(pose: Any) -> np.ndarray:
    """Position, t, n and b (..., 12)."""
    rows = matrix(pose.heading)
    return np.concatenate([np.asarray(pose.position), rows.reshape(*rows.shape[:-2], 9)], axis=-1)


def reference(
    pose: Pose, curvature: Any, torsion: Any, speed: Any, duration: Any, flow: Any = None
) -> np.ndarray:
    """Position, t, n and b (cells, 12) after `duration` by Frenet–Serret's equations, by DOP853 at 1e-12."""
    here, cells = place_and_frame(pose), len(pose.position)
    given = (np.broadcast_to(each, cells)[:, None] for each in (curvature, torsion, speed, duration))
    curvature, torsion, speed, duration = given

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        place, t, n, b = np.moveaxis(y.reshape(cells, 4, 3), 1, 0)
        moved, turning = speed * t, speed * (torsion * t + curvature * b)
        if flow is not None:
            moved, turning = moved + flow.velocity(place), turning + 0.5 * flow.vorticity(place)
        rates = [moved, *(np.cross(turning, axis) for axis in (t, n, b))]
        return (duration[:, None] * np.stack(rates, axis=1)).ravel()

    end = solve_ivp(rate, (0, 1), here.ravel(), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return end.reshape(cells, 12)


@law("Helices in still water after up to 17 rad, forwards and backwards: DOP853", 1e-11)
def _helices() -> float:
    pose, errors = Pose(np.zeros((len(PAIRS), 3)), rotations(len(PAIRS))), []
    for duration in (0.08, 0.9, -0.3):
        given = *PAIRS.T, 2.0, duration
        after = helix.along_helix(pose, helix.helix(*PAIRS.T, np.full(len(PAIRS), 2.0 * duration)))
        errors.append(np.abs(place_and_frame(after) - reference(pose, *given)).max())
    return float(max(errors))


@law("A full turn: 2πτ/w² along the Darboux axis; half a turn: 2κ/w² across", 1e-14)
def _turns() -> float:
    (curvature, torsion), frames = np.array([(5.5, 7.7), (7.5, -5.7), (0.3, 0.4)]).T, rotations(3)
    w, pose = np.hypot(curvature, torsion), Pose(np.zeros((3, 3)), frames)
    t, n, b = np.moveaxis(matrix(frames), -2, 0)
    pitch = (2 * np.pi * torsion / w**3)[:, None] * (torsion[:, None] * t + curvature[:, None] * b)
    full, half = (
        helix.along_helix(pose, helix.helix(curvature, torsion, turn / w)) for turn in (2 * np.pi, np.pi)
    )
    errors = (
        full.position - pitch,
        matrix(full.heading) - matrix(frames),
        half.position - 0.5 * pitch - (2 * curvature / w**2)[:, None] * n,
    )
    return float(max(np.abs(each).max() for each in errors))


@law("Without torsion: the arc of the plane", 1e-15)
def _arcs() -> float:
    curvature, length = np.meshgrid([5.0, -3.0, 1e-6, 0.0], [0.08, 1.0, -0.5])
    parts = helix.helix(curvature, 0 * curvature, length)
    (x, ahead), (y, aside) = arc.arc(curvature, np.ones_like(length), length)
    tangent = helix.tangent_parts(parts[3:])
    errors = zip([*parts[:3], *tangent], [x, y, 0 * x, ahead, aside, 0 * x], strict=True)
    return float(max(np.abs(found - wanted).max() for found, wanted in errors))


@law("Closest approach of helices of 4 rad to a point: places in ever smaller steps", 1e-9)
def _approach() -> float:
    curvature, torsion, length = np.full(200, 5.5), np.full(200, 7.7), np.full(200, 4.0 / np.hypot(5.5, 7.7))
    pose = Pose(np.random.default_rng(2).normal(0, 0.3, (200, 3)), rotations(200, 3))
    found = helix.closest_approach(pose, curvature, torsion, length, (0.0, 0.0, 0.0), 10)
    low, high = np.zeros(200), length
    for _ in range(9):
        steps = low + np.linspace(0, 1, 101)[:, None] * (high - low)
        places = helix.along_helix(pose, helix.helix(curvature, torsion, steps)).position
        distance = np.linalg.norm(places, axis=-1)
        nearest = steps[distance.argmin(axis=0), np.arange(200)]
        low, high = (
            np.maximum(nearest - (high - low) / 50, 0),
            np.minimum(nearest + (high - low) / 50, length),
        )
    return float(np.abs(found - distance.min(axis=0)).max())


@law("Swings κ′, τ′ in phase with the signal turn the axis up at ½ v (κ₀τ′ − τ₀κ′)/w, per amplitude", 1e-5)
def _steering() -> float:
    (curvature, torsion), small, steps = (5.5, 7.7), 1e-6, 400
    w, errors = np.hypot(curvature, torsion), []
    for swing in ((1.0, 0.0), (0.0, 1.0), (0.3, -0.8)):
        pose = Pose(np.zeros((1, 3)), rotations(1))
        phases = 2 * np.pi * (np.arange(steps) + 0.5) / steps
        before = matrix(pose.heading)[0]
        for wave in small * np.cos(phases):  # the signal is highest where n points down the gradient
            arcs = np.array([curvature + swing[0] * wave]), np.array([torsion + swing[1] * wave])
            pose = helix.along_helix(pose, helix.helix(*arcs, np.array([2 * np.pi / w / steps])))
        axes = [(torsion * t + curvature * b) / w for t, _, b in (before, matrix(pose.heading)[0])]
        rate = 0.5 * (curvature * swing[1] - torsion * swing[0]) / w * 2 * np.pi / w
        errors.append(np.abs((axes[1] - axes[0]) / small + rate * before[1]).max())
    return float(max(errors))


def flow_error(flow: Any, records: int) -> float:
    """Largest error of cells after a decision of each action of the default world in a flow."""
    world = World.in_space(n_records=records, flow=flow, start_box=((0.0, 20.0),) * 3)
    starts = draw_starts(world, CELLS, 1)
    if isinstance(flow, ShearAroundSphere):  # as near as cells come without reaching it
        away = starts.position - np.array(flow.centre)
        distance = flow.radius + world.speed * world.intervals[0] * np.linspace(1, 1.5, CELLS)
        starts = starts._replace(
            position=np.array(flow.centre) + away / np.linalg.norm(away, axis=-1)[:, None] * distance[:, None]
        )
    state, errors = world.start(*starts), []
    for action in range(2):
        after, _ = world.step(state, np.full(CELLS, action))
        given = world.curvatures[action], world.torsions[action], world.speed, world.intervals[action]
        errors.append(np.abs(place_and_frame(after) - reference(state.pose, *given, flow)).max())
    return float(max(errors))


def wave(position: Any) -> Any:
    """A velocity of a user."""
    return 0.3 * np.sin(position[..., [1, 2, 0]])


FLOWS = {
    "uniform": UniformFlow((0.3, -0.4, 0.2)),
    "shear, 0.01 per time": ShearFlow(),
    "shear, 1 per time": ShearFlow(3.0, 3.0),
    "ABC, as by default": ABCFlow(),
    "ABC, half as fast as cells, k = 1": ABCFlow((0.5, 0.7, 0.4), 1.0),
    "ABC, k = 10": ABCFlow((0.01, 0.0, 0.02), 10.0),
    "around a free sphere, as by default": ShearAroundSphere(),
    "around a held sphere of radius ½, 0.1 per time": ShearAroundSphere(
        1.0, rotates=False, radius=0.5, centre=(3.0, 4.0, 5.0)
    ),
    "a function, its curl by differences": FunctionFlow(wave, 0.3, 0.3),
}
for name, flow in FLOWS.items():
    for records in (2, 4):

        @law(f"A decision in a flow, N_T = {records}, {name}: DOP853", 1e-6)
        def _flow(flow: Any = flow, records: int = records) -> float:
            return flow_error(flow, records)
