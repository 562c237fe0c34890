"""Kinematics of one decision interval: the exact arc in still water, and the deviation from it in a flow.

A cell moves as ṙ = v t + u(r), θ̇ = v κ + ω₀(r) with constant curvature κ and speed v (paper: equations of
motion). An arc is written in the cell's own frame as a *motion* (..., 4): how far forward, how far to the
left, cosine and sine of the turn. Motions depend on the action alone, so they are tabulated; laying one down
at a pose takes no transcendental function.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, join, namespace
from swarm._support.pieces import Functions, Pieces, in_pieces
from swarm.physics.flows import Flow, StillWater

Array = Any

TOLERANCE = 1e-6  # error allowed to the pose after one interval in a flow, in float64 [length, rad]
MIN_SWEEPS = 2  # one would leave the turn to the path without flow
SUBSTEPS = (*range(1, 16), *(round(16 * 1.25**i) for i in range(19)))  # tried, in this order


class Pose(NamedTuple):
    """Where cells are and where they head."""

    position: Array  # (..., cells, 2) [length]
    heading: Array  # (..., cells, 2) unit vector (cos θ, sin θ), θ counter-clockwise from +x


class Motion(NamedTuple):
    """An arc as its swimmer sees it: two vectors, the chord [length] and then the heading at the end."""

    ahead: Array  # (2, ...) their components along the heading at the start
    aside: Array  # (2, ...) their components to the left of it


def arc(curvature: Array, speed: Array, duration: Array) -> Motion:
    """Motion (...) along an arc; exact for any curvature.

    Shapes broadcast; a negative duration runs the path backwards.
    """
    xp = namespace(curvature)
    length = speed * duration
    half = 0.5 * (curvature * length)  # half of the turn [rad]
    sine, cosine = xp.sin(half), xp.cos(half)
    straight = xp.abs(half) < 1e-5  # there sin(h)/h is 1 to rounding
    chord = length * xp.where(
        straight, xp.ones_like(half), sine / xp.where(straight, xp.ones_like(half), half)
    )
    return Motion(
        xp.stack([chord * cosine, 1 - 2 * sine * sine]), xp.stack([chord * sine, 2 * sine * cosine])
    )


# Vectors are worked on by component: array libraries are slow on last axes of two.


def components(vector: Array) -> tuple[Array, Array]:
    """x and y (...) of vectors (..., 2)."""
    return vector[..., 0], vector[..., 1]


def left_of(vector: Array) -> Array:
    """The vector (..., 2) turned by +90°."""
    x, y = components(vector)
    return join(-y, x)


def turned(heading: Sequence[Array], cosine: Array, sine: Array) -> tuple[Array, Array]:
    """Components of unit vectors turned counter-clockwise by an angle."""
    x, y = heading
    return x * cosine - y * sine, y * cosine + x * sine


def unit(x: Array, y: Array) -> Array:
    """Vectors (..., 2) of nearly unit length, scaled to it.

    One Newton step of 1/sqrt: rounding errors of the length do not pile up, in float32 either.
    """
    scale = 1.5 - 0.5 * (x * x + y * y)
    return join(x * scale, y * scale)


def along_arc(pose: Pose, motion: Motion) -> Pose:
    """The pose after a motion (..., cells) in still water."""
    heading = components(pose.heading)
    if isinstance(motion.ahead, Pieces):
        x, y = turned(tuple(map(Pieces, heading)), *motion)
        position_x, position_y = components(pose.position)
        position = join(position_x + x[0, ...].content, position_y + y[0, ...].content)
        return Pose(position, unit(x[1, ...].content, y[1, ...].content))
    x, y = turned(heading, *motion)
    return Pose(join(x[0, ...], y[0, ...]) + pose.position, unit(x[1, ...], y[1, ...]))


@dataclass(frozen=True)
class Collocation:
    """Picard sweeps on the deviation from the exact arc, at all Gauss nodes of a substep at once.

    The deviation (d, φ) of position and heading obeys d' = v [t(θ + φ) − t(θ)] + u, φ' = ω₀ along the arc;
    both are integrated by the Gauss–Legendre collocation of `nodes` points. Exact without flow.
    """

    nodes: int
    sweeps: int
    substeps: int
    outputs: int = 0  # evenly spaced places within a substep where the path is wanted too

    @classmethod
    def for_interval(
        cls, flow: Flow, turn: float, length: float, duration: float, spacing: float | None = None
    ) -> Collocation:
        """The cheapest scheme that keeps `TOLERANCE` over an interval that turns by `turn` [rad] over
        `length`.

        Sweeps leave out less and less, nodes cost more with the angle they must follow, and what one of them
        cannot do is cut into substeps. With a `spacing` [time] the path is given at least that often. Raises
        ValueError where the flow's scales ask for more than a thousand substeps.
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
                f"flow must vary slowly enough to be followed in {SUBSTEPS[-1]} substeps per interval of "
                f"{duration:g}, got speed_scale = {flow.speed_scale:g} and spin_scale = {flow.spin_scale:g}"
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

    def motions(self, curvature: Array, speed: Array, duration: Array) -> Motion:
        """Motions (2, targets, ...) along the arc from the start of a substep to each target."""
        xp = namespace(duration)
        step = duration / self.substeps
        by_target = [arc(curvature, speed, float(target) * step) for target in self.targets]
        return Motion(*(xp.stack(parts, axis=1) for parts in zip(*by_target, strict=True)))

    def swim(
        self, pose: Pose, motions: Motion, speed: Array, duration: Array, weights: Array, flow: Flow
    ) -> tuple[Pose, Array | None]:
        """The pose after the interval and the path (substeps · outputs, ..., 2), if it has outputs.

        `motions` comes from `self.motions`, `weights` is `self.weights` as an array of the pose's library.
        """
        xp = namespace(pose.position)
        step = duration / self.substeps
        if isinstance(motions.ahead, Pieces):
            speed, table = Pieces(speed), in_pieces(weights, 2) * Pieces(step)
        else:
            table = xp.reshape(weights, (*weights.shape, *(1,) * step.ndim)) * step  # (targets, nodes, ...)
        path = []
        for _ in range(self.substeps):
            pose, places = self._substep(pose, motions, speed, table, flow)
            path.append(places)
        return pose, xp.concat(path, axis=0) if self.outputs else None

    def _substep(
        self, pose: Pose, motions: Motion, speed: Array, table: Array, flow: Flow
    ) -> tuple[Pose, Array | None]:
        xp = namespace(pose.position)
        start: Sequence[Array] = (*components(pose.position), *components(pose.heading))
        if cut := isinstance(motions.ahead, Pieces):
            xp, start = Functions(xp), tuple(map(Pieces, start))
        position_x, position_y, *heading = start
        n = self.nodes
        moved_x, moved_y = turned(heading, *motions)  # (2, targets, ...)
        arc_x, arc_y = position_x + moved_x[0, ...], position_y + moved_y[0, ...]  # (targets, ...)
        tangent_x, tangent_y = moved_x[1, ...], moved_y[1, ...]
        along_x, along_y = speed * tangent_x[:n, ...], speed * tangent_y[:n, ...]
        x, y = arc_x[:n, ...], arc_y[:n, ...]
        for sweep in range(self.sweeps):
            last = sweep == self.sweeps - 1
            flow_x, flow_y, spin = velocity_and_spin(flow, x, y)
            turn = _integral(table if last else table[:n, ...], spin)  # φ (targets, ...)
            sine, cosine = xp.sin(turn), xp.cos(turn)
            rise, fall = sine[:n, ...], cosine[:n, ...] - 1
            rate_x = fall * along_x - rise * along_y + flow_x
            rate_y = fall * along_y + rise * along_x + flow_y
            wanted = (
                slice(n, None) if last else slice(n)
            )  # in the end the outputs and the end, else the nodes
            x = arc_x[wanted, ...] + _integral(table[wanted, ...], rate_x)
            y = arc_y[wanted, ...] + _integral(table[wanted, ...], rate_y)
        end = turned((tangent_x[-1, ...], tangent_y[-1, ...]), cosine[-1, ...], sine[-1, ...])
        place = x[-1, ...], y[-1, ...]
        if cut:
            place, end = (tuple(part.content for part in vector) for vector in (place, end))
        path = join(x[:-1, ...], y[:-1, ...]) if self.outputs else None
        return Pose(join(*place), unit(*end)), path


def _integral(weights: Array, rate: Array) -> Array:
    """Σ weights (targets, nodes, ...) · rate (nodes, ...), in the same order however many cells there are."""
    total = weights[:, 0, ...] * rate[0, ...]
    for node in range(1, rate.shape[0]):
        total = total + weights[:, node, ...] * rate[node, ...]
    return total


def velocity_and_spin(flow: Flow, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """u_x, u_y and ω₀ (...) at the places (x, y); at one go where the flow knows how."""
    if isinstance(x, Pieces):
        if isinstance(x.content, tuple):
            by_piece = (velocity_and_spin(flow, *place) for place in zip(x.content, y.content, strict=True))
            u, v, spin = (Pieces(column) for column in zip(*by_piece, strict=True))
        else:
            u, v, spin = map(Pieces, velocity_and_spin(flow, x.content, y.content))
        return u, v, spin
    both = getattr(flow, "velocity_and_spin", None)
    if both is not None:
        return both(x, y)
    position = join(x, y)
    return (*components(flow.velocity(position)), flow.spin(position))


def error_estimate(
    flow: Flow, turn: float, length: float, duration: float, nodes: int, sweeps: int, substeps: int
) -> float:
    """About the largest error of the pose [length, rad] that a scheme leaves after an interval, from the
    flow's scales.

    Calibrated against DOP853 on Taylor–Green flows of wavenumbers 0.01 to 100 and speeds 1e-8 to 3, chaotic
    ones among them, in which neighbouring paths part within an interval.
    """
    fastest, spin = getattr(flow, "max_speed", None), getattr(flow, "max_spin", None)
    fastest = flow.speed_scale if fastest is None else fastest
    spin = flow.spin_scale if spin is None else spin
    spin = max(spin, getattr(flow, "max_shear", None) or 0.0)  # a flow may strain without spinning
    wavenumber = spin / fastest if fastest > 0 else 0.0  # it changes over a length of about speed/spin
    step, speed = duration / substeps, length / duration
    shift = (fastest + 0.5 * speed * spin * step) * step  # the deviation from the arc
    # Gauss quadrature of a wave with as many radians as the arc and the flow turn through
    radians = turn / substeps + math.sqrt(2) * wavenumber * (speed + fastest) * step
    gauss = math.factorial(nodes) ** 4 / ((2 * nodes + 1) * math.factorial(2 * nodes) ** 3)
    quadrature = 0.5 * max(shift, spin * step) * gauss * radians ** (2 * nodes)
    for _ in range(sweeps):  # Picard: what is left of the deviation after each sweep
        angle = 0.5 * step * wavenumber * spin * shift
        shift = 0.5 * step * (speed * angle + spin * shift)
    # Neighbouring paths part, and an early error grows with them; the bound is for what no number can hold.
    growth = math.exp(min(0.45 * spin * duration, 700.0))
    return growth * substeps * max(quadrature, 0.4 * shift, 0.4 * angle)


def swim(pose: Pose, curvature: Array, speed: Array, duration: Array, flow: Flow | None = None) -> Pose:
    """The pose after `duration` (negative: before) with constant curvature and speed, all (..., cells).

    Exact to rounding without flow; within `TOLERANCE` per interval in a flow, in float64.
    """
    if flow is None or isinstance(flow, StillWater):
        return along_arc(pose, arc(curvature, speed, duration))
    xp = namespace(pose.position)
    length = float(xp.max(xp.abs(speed * duration)))
    scheme = Collocation.for_interval(
        flow, float(xp.max(xp.abs(curvature * speed * duration))), length, float(xp.max(xp.abs(duration)))
    )
    curvature, speed, duration = xp.broadcast_arrays(curvature, speed, duration)
    weights = as_array(scheme.weights, pose.position)
    motions = scheme.motions(curvature, speed, duration)
    return scheme.swim(pose, motions, speed, duration, weights, flow)[0]


def centre_of_curvature(pose: Pose, curvature: Array) -> Array:
    """Centre (..., 2) of the circle a cell swims on: r + n/κ."""
    return pose.position + left_of(pose.heading) / curvature[..., None]


def closest_approach(pose: Pose, curvature: Array, length: Array, point: tuple[float, float]) -> Array:
    """Smallest distance (...) of an arc from `point`, in closed form, for any curvature and `length` >= 0."""
    xp = namespace(pose.position)
    start = pose.position - as_array(np.asarray(point), pose.position)  # seen from the point
    turn = xp.abs(curvature * length)
    # Where the arc is too straight for its centre to be told apart from infinity, it is a line to rounding.
    straight = turn < (8 * float(xp.finfo(turn.dtype).eps)) ** 0.5
    forward = -(start[..., 0] * pose.heading[..., 0] + start[..., 1] * pose.heading[..., 1])
    reach = xp.where(forward < 0, xp.zeros_like(forward), xp.where(forward > length, length, forward))
    to_line = length_of(start + reach[..., None] * pose.heading)
    curvature = xp.where(straight, xp.ones_like(curvature), curvature)
    side, radius = xp.sign(curvature), 1 / xp.abs(curvature)
    outward = -left_of(pose.heading) * side[..., None]  # from the centre to the cell, unit length
    centre = start - outward * radius[..., None]
    # angle from the cell's place on the circle to the place nearest to the point, in the sense of swimming
    cross = side * (outward[..., 1] * centre[..., 0] - outward[..., 0] * centre[..., 1])
    dot = outward[..., 0] * centre[..., 0] + outward[..., 1] * centre[..., 1]
    angle = xp.atan2(cross, -dot)
    angle = xp.where(angle < 0, angle + 2 * math.pi, angle)
    cosine, sine = xp.cos(turn)[..., None], xp.sin(turn)[..., None]
    end = centre + (outward * cosine + pose.heading * sine) * radius[..., None]
    at_ends = xp.minimum(length_of(start), length_of(end))
    to_arc = xp.where(angle <= turn, xp.abs(length_of(centre) - radius), at_ends)
    return xp.where(straight, to_line, to_arc)


def length_of(vector: Array) -> Array:
    """Length (...) of vectors (..., 2)."""
    return (vector[..., 0] ** 2 + vector[..., 1] ** 2) ** 0.5
