"""Pushes: how far contact displaces cells from the paths that they would swim without it.

The displacement δ obeys δ' = Σ μK (d − r) r̂ along given smooth paths. Contact is stiff, but few pairs touch
at a time: a substep is cut into windows, the pairs that could touch within one are found from the paths, and
these alone go through Runge–Kutta steps of fourth order (second through the kink at r = d).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from swarm._support.arrays import Array, added_up, as_array, namespace, replaced
from swarm.physics.crowd.interactions import Contact
from swarm.physics.crowd.neighbours import near_pairs
from swarm.physics.motion.arc import arc, turned
from swarm.physics.motion.collocation import Collocation

WINDOW = 0.5  # a cell swims at most this part of the diameter within a window
STEP = 0.65  # μK times the length of a Runge–Kutta step, of a pair; in a cluster less
MAX_STEPS = 4000  # of an interval
FEW = 4096  # cells × pairs up to which sums over pairs are products with a matrix
SLACK = 0.25  # of what a cell swims in a window: arcs of a radian bend off by less
TINY = 1e-30  # [length²], so that concentric cells do not push


class Track(NamedTuple):
    """The smooth paths of cells within a substep: arcs, and rates of deviation at the nodes."""

    x: Array  # (cells,) at the start
    y: Array
    ahead: Array  # (cells,) heading at the start
    aside: Array
    curvature: Array  # (cells,) [1 / length]
    speed: Array  # (cells,) [length / time]
    step: Array  # (cells,) length of the substep [time]
    rate_x: Array  # (nodes, cells) [length / time]
    rate_y: Array

    def of(self, rows: Array) -> Self:
        """The paths of some of the cells."""
        return type(self)(*(each[..., rows] for each in self))

    def at(self, scheme: Collocation, parts: np.ndarray) -> tuple[Array, Array]:
        """Places x and y (parts, cells) after these parts of the substep."""
        like = self.x
        duration = as_array(parts, like)[:, None] * self.step
        motion = arc(self.curvature + 0 * duration, self.speed, duration)
        x, y = turned((self.ahead, self.aside), motion.ahead[0, ...], motion.aside[0, ...])
        weights = as_array(scheme.integrals(parts), like)
        return self.x + x + self.step * (weights @ self.rate_x), self.y + y + self.step * (
            weights @ self.rate_y
        )


@dataclass(frozen=True)
class Pushes:
    """The contacts of a crowd whose smooth paths a scheme finds."""

    contacts: tuple[Contact, ...]
    scheme: Collocation
    step: float = STEP  # see there

    @cached_property
    def diameter(self) -> float:
        """The largest [length]."""
        return max(each.diameter for each in self.contacts)

    @cached_property
    def stiffness(self) -> float:
        """The sum [1 / time]."""
        return sum(each.stiffness for each in self.contacts)

    def __call__(self, alive: Array, position: Array, *smooth: Array) -> Array:
        """δ_x and δ_y (2, targets, worlds, cells) at the scheme's targets.

        `alive` (worlds, cells) bool, `position` (worlds, cells, 2); the others are as in a `Track`, from the
        heading on, whose two numbers are apart. NumPy and torch only.
        """
        xp = namespace(position)
        parts = (position[..., 0], position[..., 1], *smooth)
        track = Track(*(xp.reshape(each, (*each.shape[: each.ndim - 2], -1)) for each in parts))
        targets, count = self.scheme.targets, track.x.shape[0]
        still = xp.zeros((2, len(targets), count), dtype=position.dtype, device=position.device)
        if count:
            drift = float(xp.max(xp.abs(track.rate_x) + xp.abs(track.rate_y)))
            far = float(xp.max((xp.abs(track.speed) + drift) * xp.abs(track.step)))
            pairs = near_pairs(position, self.diameter + 2 * far, alive)
            if pairs[0].shape[0]:
                still = self._along(track, pairs, far, still)
        return xp.reshape(still, (2, len(targets), *alive.shape))

    def _along(self, track: Track, pairs: tuple[Array, Array], far: float, still: Array) -> Array:
        """δ of all cells: `still`, but for `pairs` that touch; `far` is what a cell swims at most."""
        xp = namespace(track.x)
        rows, (first, second) = _renumbered(pairs)
        track = track.of(rows)
        windows = max(1, math.ceil(far / (WINDOW * self.diameter)))
        x, y = track.at(self.scheme, np.arange(windows + 1) / windows)
        push = xp.zeros((2, rows.shape[0]), dtype=track.x.dtype, device=track.x.device)
        found = [push] * len(self.scheme.targets)
        path = xp.stack([x, y], axis=1)
        apart = path[..., first] - path[..., second]
        clear = xp.min(_nearest(apart[:-1, ...], apart[1:, ...]), axis=-1).tolist()  # without pushes
        pushed = 0.0  # the most of any cell
        for window in range(windows):
            moments = self.scheme.targets * windows - window  # of the targets, in this window from 0 to 1
            inside = [k for k in np.argsort(moments).tolist() if 0 < moments[k] <= 1]
            deltas = [push] * len(inside)
            if clear[window] < self.diameter + SLACK * far / windows + 2 * pushed:
                near = self._near(
                    path[window, ...] + push, path[window + 1, ...] + push, (first, second), far / windows
                )
                if near.shape[0]:
                    chosen = first[near], second[near]
                    *deltas, push = self._through(
                        track, chosen, push, (window, windows), moments[inside].tolist()
                    )
                    pushed = float(xp.max(xp.abs(push))) * 2**0.5
            for k, delta in zip(inside, deltas, strict=True):
                found[k] = delta
        return replaced(still, rows, xp.stack(found, axis=1))

    def _near(self, now: Array, later: Array, pairs: tuple[Array, Array], far: float) -> Array:
        """Which of the pairs may touch while their cells go from `now` to `later` (2, cells), nearly
        straight.
        """
        xp = namespace(now)
        first, second = pairs
        apart = now[:, first] - now[:, second]
        nearest = _nearest(apart, later[:, first] - later[:, second])
        slack = SLACK * far
        near = nearest < self.diameter + slack
        if not bool(xp.any(near)):
            return xp.nonzero(near)[0]
        overlap = float(xp.max(self.diameter - xp.sum(apart * apart, axis=0) ** 0.5))
        pushed = far + max(overlap, 0.0)  # how far a cell may be pushed meanwhile
        for _ in range(2):  # those that touch may be pushed into others
            touching = xp.astype(near, now.dtype)
            touched = added_up(xp.concat([touching, touching]), xp.concat(pairs), now.shape[1]) > 0
            reach = xp.astype(touched[first], now.dtype) + xp.astype(touched[second], now.dtype)
            near = nearest < self.diameter + slack + pushed * reach
        return xp.nonzero(near)[0]

    def _through(
        self,
        track: Track,
        pairs: tuple[Array, Array],
        push: Array,
        window: tuple[int, int],
        moments: list[float],
    ) -> list[Array]:
        """δ (2, cells) at rising moments of a window, its number and how many there are, and at its end."""
        number, windows = window
        xp = namespace(push)
        rows, (first, second) = _renumbered(pairs)
        ends = xp.concat([first, second])
        degree = added_up(xp.ones_like(ends, dtype=push.dtype), ends, rows.shape[0])
        crowding = max(1.0, 0.5 * float(xp.max(degree)))
        some = track.of(rows)
        longest = float(xp.max(xp.abs(some.step)))
        steps = max(1, math.ceil(self.stiffness * longest / windows * crowding / self.step))
        parts = (number + np.arange(2 * steps + 1) / (2 * steps)) / windows
        path = xp.stack(some.at(self.scheme, parts), axis=1)  # (halves, 2, cells)
        span = some.step / (steps * windows)
        force = self._force(first, second, rows.shape[0], span)
        at: Array = push[:, rows]
        found: list[Array] = []
        wanted = [moment * steps for moment in moments]
        for done in range(steps):
            start, middle, end = (path[2 * done + i, ...] for i in range(3))
            k1 = force(start + at)
            k2 = force(middle + (at + 0.5 * k1))
            k3 = force(middle + (at + 0.5 * k2))
            k4 = force(end + (at + k3))
            moved = (k1 + 2 * (k2 + k3) + k4) / 6
            while len(found) < len(wanted) and wanted[len(found)] <= done + 1:
                found.append(at + (wanted[len(found)] - done) * moved)
            at = at + moved
        found += [at] * (len(wanted) - len(found) + 1)  # rounding may leave out the last
        return [replaced(push, rows, each) for each in found]

    def _force(self, first: Array, second: Array, cells: int, span: Array) -> Callable[[Array], Array]:
        """How far pairs at places (2, cells) are parted (2, cells) in a time `span` (cells,)."""
        xp = namespace(span)
        if few := cells * first.shape[0] <= FEW:
            number = xp.arange(cells, device=first.device)[:, None]
            sides = xp.astype(number == first, span.dtype) - xp.astype(number == second, span.dtype)
            back = xp.permute_dims(sides, (1, 0)) * span
        rows = xp.concat([first, second])
        nothing = xp.zeros_like(first, dtype=span.dtype)

        def force(place: Array) -> Array:
            apart = place @ sides if few else place[:, first] - place[:, second]
            squared = apart * apart
            distance = xp.sqrt(squared[0, :] + squared[1, :] + TINY)
            rate = nothing
            for each in self.contacts:
                rate = rate + each.stiffness * xp.maximum(each.diameter / distance - 1, nothing)
            pull = apart * rate
            if few:
                return pull @ back
            return span * xp.stack(
                [added_up(xp.concat([pull[i, :], -pull[i, :]]), rows, cells) for i in range(2)]
            )

        return force


def _renumbered(pairs: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
    """The rows (cells,) that occur in pairs, and the pairs as places among these."""
    xp, count = namespace(pairs[0]), pairs[0].shape[0]
    rows, place = xp.unique_inverse(xp.concat(pairs))
    return rows, (place[:count], place[count:])


def _nearest(before: Array, after: Array) -> Array:
    """How near (..., pairs) two cells come whose separation (..., 2, pairs) changes evenly [length]."""
    xp = namespace(before)
    moved = after - before
    length = xp.sum(moved * moved, axis=-2)
    part = xp.clip(-xp.sum(before * moved, axis=-2) / (length + TINY), 0.0, 1.0)
    return xp.sum((before + part[..., None, :] * moved) ** 2, axis=-2) ** 0.5
