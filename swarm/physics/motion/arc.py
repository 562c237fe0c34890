"""The arc: what a cell swims in still water, exactly, and how near it comes to a point.

An arc is written in the cell's own frame as a *motion*: where it ends and where the cell heads then. Motions
depend on the action alone, so they are tabulated; laying one down at a pose takes no transcendental function.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, join, namespace
from swarm._support.compiler import alongside

Array = Any


class Pose(NamedTuple):
    """Where cells are and where they head."""

    position: Array  # (..., cells, 2) [length]; in space (..., cells, 3)
    # (..., cells, 2) unit vector (cos θ, sin θ), θ counter-clockwise from +x; in space (..., cells, 4), a
    # frame as unit quaternion, see `helix`
    heading: Array


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
    straight = xp.abs(half) < 1e-8  # there sin(h)/h is 1 to rounding
    chord = length * xp.where(
        straight, xp.ones_like(half), sine / xp.where(straight, xp.ones_like(half), half)
    )
    return Motion(
        xp.stack([chord * cosine, 1 - 2 * sine * sine]), xp.stack([chord * sine, 2 * sine * cosine])
    )


# Vectors are worked on by component: array libraries are slow on last axes of two.


def components(vector: Array) -> tuple[Array, ...]:
    """x, y, … (...) of vectors (..., k)."""
    x, y = vector[..., 0], vector[..., 1]
    return (x, y) if vector.shape[-1] == 2 else (x, y, *(vector[..., i] for i in range(2, vector.shape[-1])))


def left_of(vector: Array) -> Array:
    """The vector (..., 2) turned by +90°."""
    x, y = components(vector)
    return join(-y, x)


def turned(vector: tuple[Array, ...], cosine: Array, sine: Array) -> tuple[Array, Array]:
    """Components of a vector turned counter-clockwise by an angle; longer where cosine and sine are."""
    x, y = vector
    return cosine * x - sine * y, cosine * y + sine * x


def unit(x: Array, y: Array) -> Array:
    """Vectors (..., 2) of nearly unit length, scaled to it.

    One Newton step of 1/sqrt: rounding errors of the length do not pile up, in float32 either.
    """
    scale = 1.5 - 0.5 * (x * x + y * y)
    return join(x * scale, y * scale)


def along_arc(pose: Pose, motion: Motion) -> Pose:
    """The pose after a motion (..., cells) in still water."""
    x, y = turned(alongside(motion.ahead, *components(pose.heading)), *motion)
    return Pose(join(x[0, ...], y[0, ...]) + pose.position, unit(x[1, ...], y[1, ...]))


def centre_of_curvature(pose: Pose, curvature: Array) -> Array:
    """Centre (..., 2) of the circle a cell swims on: r + n/κ; NaN where it swims straight on."""
    xp = namespace(curvature)
    turning = curvature != 0
    radius = 1 / xp.where(turning, curvature, xp.full_like(curvature, math.nan))
    return pose.position + left_of(pose.heading) * radius[..., None]


def length_of(vector: Array) -> Array:
    """Length (...) of vectors (..., 2)."""
    return (vector[..., 0] ** 2 + vector[..., 1] ** 2) ** 0.5


def arrival(pose: Pose, curvature: Array, length: Array, point: Sequence[float], radius: float) -> Array:
    """The part (...) of an arc at which it first comes within a radius of `point`, in closed form; infinite
    where it does not. For any curvature and `length` >= 0; 0 where it starts there.
    """
    xp = namespace(pose.position)
    nearly = 1e-3 if xp.finfo(pose.position.dtype).eps < 1e-10 else 0.05  # where a circle is too large [rad]
    (x, y), (along, across) = components(pose.position), components(pose.heading)
    x, y = x - point[0], y - point[1]  # seen from the point
    ahead, aside = x * along + y * across, along * y - across * x
    squared, nothing = x**2 + y**2, xp.zeros_like(x)
    one, never = nothing + 1, nothing + math.inf
    inside, moves = squared <= radius**2, length > 0
    outside = squared - radius**2
    straight = xp.abs(curvature * length) < nearly
    kappa = xp.where(straight, one, curvature)
    # half of what distance² changes in a turn φ: rise sin φ + shift (1 − cos φ)
    rise, shift = ahead / kappa, (1 / kappa + aside) / kappa
    missing = -0.5 * outside - shift  # = rise sin φ − shift cos φ at the arrival
    swing = xp.sqrt(rise * rise + shift * shift)
    meets = (xp.abs(missing) <= swing) & (swing > 0)
    angle = xp.asin(xp.where(meets, missing, nothing) / xp.where(meets, swing, one))
    phase = xp.atan2(-shift, rise)  # rise sin φ − shift cos φ = swing sin(φ + phase)
    sense = xp.sign(kappa)
    turns = [xp.remainder(sense * (candidate - phase), 2 * math.pi) for candidate in (angle, math.pi - angle)]
    part = xp.minimum(*turns) / xp.where(moves, sense * kappa * length, one)
    if not isinstance(straight, np.ndarray) or straight.any():
        line, there = _along_line(ahead, aside, outside, curvature)
        part = xp.where(straight, line / xp.where(moves, length, one), part)
        meets = xp.where(straight, there, meets)
    reached = inside | (meets & (part <= 1) & moves)
    return xp.where(reached, xp.where(inside, nothing, part), never)


def _along_line(ahead: Array, aside: Array, outside: Array, curvature: Array) -> tuple[Array, Array]:
    """How far (...) a nearly straight arc goes to a circle, and whether it comes there at all. `ahead` and
    `aside` tell where it starts as seen from the centre, `outside` is distance² less radius².
    """
    xp = namespace(ahead)
    half = 0.5 * curvature  # u = 2 tan(φ/2)/κ solves a u² + 2 ahead u + outside = 0
    root = ahead * ahead - (1 + curvature * aside + half * half * outside) * outside
    denominator = xp.sqrt(xp.where(root > 0, root, xp.zeros_like(root))) - ahead
    there = (root >= 0) & (denominator > 0)
    line = outside / xp.where(there, denominator, xp.ones_like(root))
    bend = (half * line) ** 2  # length = 2 atan(κ u/2)/κ
    return line * (1 - bend / 3 + bend * bend / 5), there


def arrival_on(path: Array, start: Array, end: Array, point: Sequence[float], radius: float) -> Array:
    """The part (...) of an interval at which a path (places, ..., 2), evenly spaced in time from `start` on,
    first comes within a radius of `point`, linear between places; infinite where it does not.
    """
    xp = namespace(path)
    places = xp.concat([start[None, ...], path[1:, ...], end[None, ...]], axis=0)
    distance = length_of(places - as_array(np.asarray(point), path))
    near = distance <= radius
    first = xp.argmax(xp.astype(near, xp.int32), axis=0)
    count = distance.shape[0] - 1
    number = xp.reshape(as_array(np.arange(count + 1), first, dtype=first.dtype), (-1, *(1,) * first.ndim))
    chosen = xp.astype(number == first, path.dtype)
    before = xp.astype(number + 1 == first, path.dtype)
    after, ahead = xp.sum(chosen * distance, axis=0), xp.sum(before * distance, axis=0)
    fell = xp.where(ahead > after, ahead - after, xp.ones_like(after))
    part = (xp.astype(first, path.dtype) - (radius - after) / fell) / count
    part = xp.where(first == 0, xp.zeros_like(part), part)
    return xp.where(xp.any(near, axis=0), part, xp.full_like(part, math.inf))


def comes_within(path: Array, end: Array, point: Sequence[float], radius: float) -> Array:
    """Whether a place of a path (places, ..., k), or its end (..., k), lies within a radius of `point`."""
    xp = namespace(path)
    places = xp.concat([path, end[None, ...]], axis=0) - as_array(np.asarray(point), path)
    square = places[..., 0] ** 2 + places[..., 1] ** 2
    square = square if places.shape[-1] == 2 else square + places[..., 2] ** 2
    return xp.any(square <= radius**2, axis=0)
