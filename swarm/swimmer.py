"""Kinematics of one decision interval: the exact arc in still water, and the deviation from it in a flow.

A cell moves as ṙ = v t + u(r), θ̇ = v κ + ω₀(r) with constant curvature κ and speed v (paper: equations of motion). An arc is
written in the cell's own frame as a *motion* (..., 4): how far forward, how far to the left, cosine and sine of the turn.
Motions depend on the action alone, so they are tabulated; laying one down at a pose takes no transcendental function.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from array_api_compat import array_namespace

from swarm.flows import Flow, StillWater

Array = Any

TOLERANCE = 1e-6  # error allowed to the pose after one interval in a flow, in float64 [length, rad]
MIN_SWEEPS = 2  # one would leave the turn to the path without flow
SUBSTEPS = (*range(1, 16), *(round(16 * 1.25**i) for i in range(19)))  # tried, in this order


class Pose(NamedTuple):
    """Where cells are and where they head."""

    position: Array  # (..., cells, 2) [length]
    heading: Array  # (..., cells, 2) unit vector (cos θ, sin θ), θ counter-clockwise from +x


def arc(curvature: Array, speed: Array, duration: Array) -> Array:
    """Motion (..., 4) along an arc: forward, left [length], cosine and sine of the turn; exact for any curvature.

    Shapes broadcast; a negative duration runs the path backwards.
    """
    xp = array_namespace(curvature, speed, duration)
    length = speed * duration
    half = 0.5 * (curvature * length)  # half of the turn [rad]
    sine, cosine = xp.sin(half), xp.cos(half)
    straight = xp.abs(half) < 1e-5  # there sin(h)/h is 1 to rounding
    chord = length * xp.where(
        straight, xp.ones_like(half), sine / xp.where(straight, xp.ones_like(half), half)
    )
    return xp.stack([chord * cosine, chord * sine, 1 - 2 * sine * sine, 2 * sine * cosine], axis=-1)


def left_of(vector: Array) -> Array:
    """The vector (..., 2) turned by +90°."""
    xp = array_namespace(vector)
    return xp.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def turned(heading: Array, left: Array, cosine: Array, sine: Array) -> Array:
    """Unit vectors (..., 2) turned by an angle, scaled back to unit length; `left` is `left_of(heading)`."""
    result = heading * cosine[..., None] + left * sine[..., None]
    x, y = result[..., 0], result[..., 1]
    # One Newton step of 1/sqrt: rounding errors of the length do not pile up, in float32 either.
    return result * (1.5 - 0.5 * (x * x + y * y))[..., None]


def along_arc(pose: Pose, motion: Array) -> Pose:
    """The pose after a motion (..., cells, 4) in still water."""
    position, heading = pose
    left = left_of(heading)
    return Pose(
        position + heading * motion[..., 0:1] + left * motion[..., 1:2],
        turned(heading, left, motion[..., 2], motion[..., 3]),
    )


@dataclass(frozen=True)
class Collocation:
    """Picard sweeps on the deviation from the exact arc, at all Gauss nodes of a substep at once.

    The deviation (d, φ) of position and heading obeys d' = v [t(θ + φ) − t(θ)] + u, φ' = ω₀ along the arc; both are
    integrated by the Gauss–Legendre collocation of `nodes` points. Exact without flow.
    """

    nodes: int
    sweeps: int
    substeps: int
    outputs: int = 0  # evenly spaced places within a substep where the path is wanted too

    @classmethod
    def for_interval(
        cls, flow: Flow, turn: float, length: float, duration: float, spacing: float | None = None
    ) -> Collocation:
        """The cheapest scheme that keeps `TOLERANCE` over an interval that turns by `turn` [rad] over `length`.

        Sweeps leave out less and less, nodes cost more with the angle they must follow, and what one of them cannot do
        is cut into substeps. With a `spacing` [time] the path is given at least that often. Raises ValueError where the
        flow's scales ask for more than a thousand substeps.
        """
        cheapest = None
        for substeps in SUBSTEPS:
            if cheapest is not None and substeps * 3 * MIN_SWEEPS > cheapest[0]:
                break
            for nodes, sweeps in itertools.product(range(3, 7), range(MIN_SWEEPS, 7)):
                cost = substeps * sweeps * (nodes + 3)  # three: what a sweep costs however few the nodes
                if cheapest is None or cost < cheapest[0]:
                    error = error_estimate(flow, turn, length, duration, nodes, sweeps, substeps)
                    cheapest = (cost, nodes, sweeps, substeps) if error <= TOLERANCE else cheapest
        if cheapest is None:
            raise ValueError(
                f"flow must vary slowly enough to be followed in {SUBSTEPS[-1]} substeps per interval of {duration:g}, "
                f"got speed_scale = {flow.speed_scale:g} and spin_scale = {flow.spin_scale:g}"
            )
        _, nodes, sweeps, substeps = cheapest
        outputs = 0 if spacing is None else math.ceil(duration / substeps / spacing - 1e-9)
        return cls(nodes, sweeps, substeps, outputs)

    @cached_property
    def fractions(self) -> np.ndarray:
        """Places of the nodes within a substep, in (0, 1)."""
        return (np.polynomial.legendre.leggauss(self.nodes)[0] + 1) / 2

    @cached_property
    def targets(self) -> np.ndarray:
        """Where the path is computed, as fractions of a substep: the nodes, the outputs, the end."""
        return np.concatenate([self.fractions, np.arange(self.outputs) / max(self.outputs, 1), [1.0]])

    @cached_property
    def weights(self) -> np.ndarray:
        """Integrals (targets, nodes) of the nodes' Lagrange polynomials from 0 to each target."""
        powers = np.arange(self.nodes)
        vandermonde = self.fractions[:, None] ** powers
        return (self.targets[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(vandermonde)

    def motions(self, curvature: Array, speed: Array, duration: Array) -> Array:
        """Motions (targets, ..., 4) along the arc from the start of a substep to each target."""
        xp = array_namespace(duration)
        step = duration / self.substeps
        return xp.stack([arc(curvature, speed, float(target) * step) for target in self.targets], axis=0)

    def swim(
        self, pose: Pose, motions: Array, speed: Array, duration: Array, weights: Array, flow: Flow
    ) -> tuple[Pose, Array]:
        """The pose after the interval and the path (substeps · outputs, ..., 2) on the way.

        `motions` comes from `self.motions`, `weights` is `self.weights` as an array of the pose's library.
        """
        xp = array_namespace(pose.position)
        step = (duration / self.substeps)[..., None]
        speed = speed[..., None]
        table = xp.reshape(weights, weights.shape + (1,) * pose.position.ndim)  # (targets, nodes, ..., 1)
        path = []
        for _ in range(self.substeps):
            pose, places = self._substep(pose, motions, speed, step, table, flow)
            path.append(places)
        return pose, path[0] if self.substeps == 1 else xp.concat(path, axis=0)

    def _substep(
        self, pose: Pose, motions: Array, speed: Array, step: Array, table: Array, flow: Flow
    ) -> tuple[Pose, Array]:
        position, heading = pose
        xp = array_namespace(position)
        n = self.nodes
        left = left_of(heading)
        on_arc = position + heading * motions[..., 0:1] + left * motions[..., 1:2]  # (targets, ..., 2)
        tangent = heading * motions[:n, ..., 2:3] + left * motions[:n, ..., 3:4]  # (nodes, ..., 2)
        normal = left_of(tangent)
        places = on_arc[:n, ...]
        for sweep in range(self.sweeps):
            last = sweep == self.sweeps - 1
            turn = step * xp.sum(table * flow.spin(places)[None, ..., None], axis=1)  # φ (targets, ..., 1)
            at_nodes = turn[:n, ...]
            rate = speed * ((xp.cos(at_nodes) - 1) * tangent + xp.sin(at_nodes) * normal) + flow.velocity(
                places
            )
            shift = step * xp.sum(
                (table if last else table[:n, ...]) * rate[None, ...], axis=1
            )  # d (targets, ..., 2)
            places = (on_arc if last else on_arc[:n, ...]) + shift
        end = turned(heading, left, motions[-1, ..., 2], motions[-1, ..., 3])
        turn = turn[-1, ..., 0]
        return Pose(places[-1, ...], turned(end, left_of(end), xp.cos(turn), xp.sin(turn))), places[n:-1, ...]


def error_estimate(
    flow: Flow, turn: float, length: float, duration: float, nodes: int, sweeps: int, substeps: int
) -> float:
    """About the largest error of the pose [length, rad] that a scheme leaves after an interval, from the flow's scales.

    Calibrated against DOP853 on Taylor–Green flows of wavenumbers 0.01 to 100 and speeds 1e-8 to 3.
    """
    fastest = max(flow.speed_scale, getattr(flow, "max_speed", None) or 0.0)
    spin = max(flow.spin_scale, getattr(flow, "max_spin", None) or 0.0)
    wavenumber = spin / fastest if fastest > 0 else 0.0  # a flow changes over a length of about speed/spin
    step, speed = duration / substeps, length / duration
    shift = (fastest + 0.5 * speed * spin * step) * step  # the deviation from the arc
    # Gauss quadrature of a wave with as many radians as the arc and the flow turn through
    radians = turn / substeps + math.sqrt(2) * wavenumber * (speed + fastest) * step
    gauss = math.factorial(nodes) ** 4 / ((2 * nodes + 1) * math.factorial(2 * nodes) ** 3)
    quadrature = 0.5 * max(shift, spin * step) * gauss * radians ** (2 * nodes)
    for _ in range(sweeps):  # Picard: what is left of the deviation after each sweep
        angle = 0.5 * step * wavenumber * spin * shift
        shift = 0.5 * step * (speed * angle + spin * shift)
    return substeps * max(quadrature, 0.4 * shift, 0.4 * angle)


def swim(pose: Pose, curvature: Array, speed: Array, duration: Array, flow: Flow | None = None) -> Pose:
    """The pose after `duration` (negative: before) with constant curvature and speed, all (..., cells).

    Exact to rounding without flow; within `TOLERANCE` per interval in a flow, in float64.
    """
    if flow is None or isinstance(flow, StillWater):
        return along_arc(pose, arc(curvature, speed, duration))
    xp = array_namespace(pose.position)
    length = float(xp.max(xp.abs(speed * duration)))
    scheme = Collocation.for_interval(
        flow, float(xp.max(xp.abs(curvature * speed * duration))), length, float(xp.max(xp.abs(duration)))
    )
    curvature, speed, duration = xp.broadcast_arrays(curvature, speed, duration)
    weights = as_array(scheme.weights, pose.position)
    motions = scheme.motions(curvature, speed, duration)
    return scheme.swim(pose, motions, speed, duration, weights, flow)[0]


def as_array(values: np.ndarray, like: Array, *, dtype: Any = None) -> Array:
    """`values` in the array library, on the device and (floats) with the dtype of `like`."""
    xp = array_namespace(like)
    chosen = dtype if dtype is not None else like.dtype
    try:
        return xp.asarray(values, dtype=chosen, device=like.device)
    except TypeError:  # a tracer has no device
        return xp.asarray(values, dtype=chosen)


def centre_of_curvature(pose: Pose, curvature: Array) -> Array:
    """Centre (..., 2) of the circle a cell swims on: r + n/κ."""
    return pose.position + left_of(pose.heading) / curvature[..., None]


def closest_approach(pose: Pose, curvature: Array, turn: Array, point: tuple[float, float]) -> Array:
    """Smallest distance (...) of the arc from `point`, in closed form; `turn` = κ v duration >= 0 and κ > 0."""
    xp = array_namespace(pose.position)
    centre = centre_of_curvature(pose, curvature) - as_array(
        np.asarray(point), pose.position
    )  # seen from the point
    outward = left_of(pose.heading) * (-1.0)  # from the centre to the cell, unit length
    distance = (centre[..., 0] ** 2 + centre[..., 1] ** 2) ** 0.5
    radius = 1 / curvature
    # angle from the cell's place on the circle to the place nearest to the point, counter-clockwise
    towards = -1.0 * centre
    cross = outward[..., 0] * towards[..., 1] - outward[..., 1] * towards[..., 0]
    dot = outward[..., 0] * towards[..., 0] + outward[..., 1] * towards[..., 1]
    angle = xp.atan2(cross, dot)
    angle = xp.where(angle < 0, angle + 2 * math.pi, angle)
    start = centre + outward * radius[..., None]
    cosine, sine = xp.cos(turn), xp.sin(turn)
    end = centre + (outward * cosine[..., None] + left_of(outward) * sine[..., None]) * radius[..., None]
    at_ends = xp.minimum(
        (start[..., 0] ** 2 + start[..., 1] ** 2) ** 0.5, (end[..., 0] ** 2 + end[..., 1] ** 2) ** 0.5
    )
    return xp.where(angle <= turn, xp.abs(distance - radius), at_ends)
