"""Steered swimming: a cell whose curvature follows a state of its own, continuously.

The equations are integrated together by Gauss–Legendre collocation in small steps. Where the curvature has a
kink or a jump, because an inner variable crosses a level, a step is cut there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from swarm.physics.motion.collocation import Collocation

Array = Any
Rates = Callable[[Array, Array, Array], Array]

SCHEME = Collocation(nodes=4, sweeps=8, substeps=1)
MOST_PARTS = 6  # that a step may be cut into


def advanced(
    rates: Rates, values: Array, length: Array, levels: tuple[Array, ...] = (), watched: int = 0
) -> Array:
    """Values (variables, ..., cells) of ordinary differential equations after steps of `length` (..., cells).

    `rates(values, part, region)` gives their rates of change for values (nodes, variables, ..., cells) after
    a part (nodes, ..., cells) of the time; region (..., cells) counts the rising `levels` (..., cells) that
    lie below the variable number `watched`, and rates are smooth within each. In NumPy.
    """
    region = _region(values[watched], levels)
    begun, left = np.zeros_like(length), length
    for _ in range(MOST_PARTS):
        points, parts = _step(rates, values, begun, left, region)
        found = _region(points[:, watched], levels)
        other = found != region
        other[0] = False  # a part begins on a level
        crossed = other.any(axis=0)
        if not crossed.any():
            return points[-1]
        place = np.where(crossed, other.argmax(axis=0), len(points) - 1)  # the crossing lies before it
        step = np.where(crossed, np.sign(_at(found, place) - region), 0)
        level = np.choose(region + np.minimum(step, 0), levels, mode="clip")
        slopes = rates(points, parts, region)[:, watched]
        ends = [
            _at(each, at) for each in (points[:, watched] - level, slopes, parts) for at in (place - 1, place)
        ]
        when = np.where(crossed, _crossing(*ends), begun + left)
        points, _ = _step(rates, values, begun, when - begun, region)
        values, left, begun, region = points[-1], left + begun - when, when, region + step
    return _step(rates, values, begun, left, region)[0][-1]


def _region(value: Array, levels: tuple[Array, ...]) -> Array:
    return sum((value > level for level in levels), start=np.zeros(value.shape, int))


def _at(points: Array, place: Array) -> Array:
    return np.take_along_axis(points, place[None], axis=0)[0]


def _step(rates: Rates, values: Array, begun: Array, length: Array, region: Array) -> tuple[Array, Array]:
    """One step without a kink, by Picard sweeps: values (points, variables, ..., cells) and times at its
    start, its nodes and its end.
    """
    weights, shape = SCHEME.weights, (SCHEME.nodes, *values.shape)
    parts = begun + np.multiply.outer(SCHEME.fractions, length)
    nodes = np.broadcast_to(values, shape)
    for _ in range(SCHEME.sweeps):
        change = rates(nodes, parts, region).reshape(SCHEME.nodes, -1)
        nodes = values + length * (weights[:-1] @ change).reshape(shape)
    change = rates(nodes, parts, region).reshape(SCHEME.nodes, -1)
    end = values + length * (weights[-1] @ change).reshape(values.shape)
    return np.concatenate([values[None], nodes, end[None]]), np.stack([begun, *parts, begun + length])


def _crossing(
    start: Array, end: Array, slope: Array, slope_after: Array, begun: Array, ended: Array
) -> Array:
    """When the cubic with these values and slopes at two times is 0, by Newton's method."""
    length = ended - begun
    change, rise, rise_after = end - start, slope * length, slope_after * length
    part = np.clip(-start / np.where(change == 0, 1.0, change), 0.0, 1.0)
    second, third = 3 * change - 2 * rise - rise_after, rise + rise_after - 2 * change
    for _ in range(4):
        value = start + part * (rise + part * (second + part * third))
        fall = rise + part * (2 * second + 3 * part * third)
        part = np.clip(part - value / np.where(fall == 0, 1.0, fall), 0.0, 1.0)
    return begun + part * length
