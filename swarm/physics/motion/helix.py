"""The helix: what a cell swims in still water in space, exactly, and how near it comes to a point.

A cell's frame is a unit quaternion q = (w, x, y, z) that takes body to lab: t = q e_x q*, n = q e_y q*,
b = q e_z q*. By Frenet–Serret, t' = v κ n, n' = v (τ b − κ t), b' = −v τ n, it turns about the Darboux axis
(τ t + κ b)/w at the rate v w, w = √(κ² + τ²), both of which the cell sees unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm._support.arrays import as_array, join, namespace, polynomial
from swarm.physics.motion.arc import Pose, components

Array = Any
Parts = Sequence[Array]  # the components of a vector (3) or a quaternion (4), each (...)

LAG = [(-1) ** k / math.factorial(2 * k + 3) for k in range(8)]  # of (φ − sin φ)/φ³ in powers of φ²
CELL = 0.4  # [rad] of a helix in which one nearest place is looked for
NEWTON_STEPS = 3


def helix(curvature: Array, torsion: Array, length: Array) -> tuple[Array, ...]:
    """The screw along a helix in the frame at its start, by its seven components (...): displacement x, y, z
    [length] and rotation w, x, y, z, a unit quaternion.

    Exact for any curvature and torsion, both 0 too [1 / length]; a negative `length` runs the path backwards.
    With both constant it has the radius κ/w² and the pitch 2πτ/w².
    """
    xp = namespace(length)
    turn = length * (curvature * curvature + torsion * torsion) ** 0.5
    half, square = 0.5 * turn, turn * turn
    cosine, one = xp.cos(half), xp.ones_like(half)
    straight = xp.abs(half) < 1e-8  # there sin(h)/h is 1 to rounding
    sinc = xp.where(straight, one, xp.sin(half) / xp.where(straight, one, half))
    short = square < 1.0
    series = polynomial(LAG, xp.where(short, square, one))
    lag = xp.where(short, series, (turn - xp.sin(turn)) / xp.where(short, one, turn * square)) * length**3
    chord = 0.5 * length * sinc
    return (
        length - curvature * curvature * lag,
        2 * curvature * chord * chord,
        curvature * torsion * lag,
        cosine,
        torsion * chord,
        xp.zeros_like(chord),
        curvature * chord,
    )


def along_helix(pose: Pose, screw: Parts) -> Pose:
    """The pose (..., cells) after a screw in still water."""
    frame = components(pose.heading)
    moved = rotated_parts(frame, screw[:3])
    place = (start + by for start, by in zip(components(pose.position), moved, strict=True))
    return Pose(join(*place), unit_quaternion(product_parts(frame, screw[3:])))


def frame(quaternion: Array) -> tuple[Array, Array, Array]:
    """Tangent t, normal n and binormal b (..., 3) of a frame (..., 4)."""
    w, x, y, z = components(quaternion)
    normal = 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
    binormal = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    return tangent(quaternion), join(*normal), join(*binormal)


def tangent(quaternion: Array) -> Array:
    """Unit vector (..., 3) in which a cell with the frame (..., 4) swims."""
    return join(*tangent_parts(components(quaternion)))


def product(first: Array, second: Array) -> Array:
    """Hamilton's product (..., 4): the rotation by the second quaternion, then by the first."""
    return join(*product_parts(components(first), components(second)))


def conjugate(quaternion: Array) -> Array:
    """The rotation (..., 4) the other way round."""
    w, x, y, z = components(quaternion)
    return join(w, -x, -y, -z)


def rotated(quaternion: Array, vector: Array) -> Array:
    """A vector (..., 3), turned."""
    return join(*rotated_parts(components(quaternion), components(vector)))


# By component: array libraries are slow on last axes of three and four.


def product_parts(first: Parts, second: Parts) -> tuple[Array, ...]:
    """Components of Hamilton's product."""
    a, b, c, d = first
    w, x, y, z = second
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y + c * w + d * x - b * z,
        a * z + d * w + b * y - c * x,
    )


def tangent_parts(quaternion: Parts) -> tuple[Array, ...]:
    """Components of the tangent."""
    w, x, y, z = quaternion
    return 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)


def rotated_parts(quaternion: Parts, vector: Parts) -> tuple[Array, ...]:
    """Components of a vector, turned."""
    return tuple(v + off for v, off in zip(vector, led_off(quaternion, vector), strict=True))


def led_off(quaternion: Parts, vector: Parts) -> tuple[Array, ...]:
    """Components by which a vector differs when turned: 2 (w + u ×)(u × v) with u = (x, y, z)."""
    w, *axis = quaternion
    twice = tuple(part + part for part in cross(axis, vector))
    return tuple(w * t + further for t, further in zip(twice, cross(axis, twice), strict=True))


def unit_quaternion(parts: Parts) -> Array:
    """The quaternion (..., 4) of components of nearly unit length, scaled to it by a Newton step, see
    `arc.unit`."""
    scale = 1.5 - 0.5 * dot(parts, parts)
    return join(*(part * scale for part in parts))


def cross(first: Parts, second: Parts) -> tuple[Array, ...]:
    """Components of a × b."""
    (a, b, c), (x, y, z) = first, second
    return b * z - c * y, c * x - a * z, a * y - b * x


def dot(first: Parts, second: Parts) -> Array:
    """a · b (...)."""
    total, *rest = (a * b for a, b in zip(first, second, strict=True))
    for term in rest:
        total = total + term
    return total


def closest_approach(
    pose: Pose, curvature: Array, torsion: Array, length: Array, point: Sequence[float], cells: int
) -> Array:
    """Smallest distance (...) of a helix from `point`: at an end, or in one of so many `cells` of its length,
    in each of which distance² is led to its minimum by Newton's method.

    Never too small; at most 1e-9 of the distance too large, in float64, where a cell is no longer than `CELL`
    rad.
    """
    xp = namespace(length)
    away = pose.position - as_array(np.asarray(point), pose.position)
    seen = rotated_parts(components(conjugate(pose.heading)), components(away))  # in the cell's frame
    steps = as_array((np.arange(cells) + 0.5) / cells, length)
    middle = xp.reshape(steps, (-1, *(1,) * length.ndim)) * length
    half = 0.5 * length / cells
    place = middle
    for _ in range(NEWTON_STEPS):
        *moved, w, x, _, z = helix(curvature, torsion, place)
        to = [start + by for start, by in zip(seen, moved, strict=True)]
        ahead = 1 - 2 * z * z, 2 * w * z, 2 * x * z  # the tangent there; y = 0
        bend = -2 * w * z, 1 - 2 * (x * x + z * z), 2 * w * x  # and the normal
        slope = dot(to, ahead)  # half of d(distance²)/ds
        rise = 1 + curvature * dot(to, bend)
        convex = rise > 0
        newton = slope / xp.where(convex, rise, xp.ones_like(rise))
        change = -xp.where(convex, newton, xp.sign(slope) * length)
        place = xp.minimum(xp.maximum(place + change, middle - half), middle + half)
    ends = xp.stack([xp.zeros_like(length), length])
    places = xp.concat([place, xp.broadcast_to(ends, (2, *place.shape[1:]))], axis=0)
    ends_to = [start + by for start, by in zip(seen, helix(curvature, torsion, places), strict=False)]
    return xp.min(dot(ends_to, ends_to), axis=0) ** 0.5
