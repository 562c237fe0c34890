"""Pushes: how far contact displaces cells from the paths that they would swim without it.

The displacement δ obeys δ' = Σ μK (d − r) r̂ along given smooth paths. Contact is stiff, but few pairs touch
at a time: those that could touch within a substep are found from the paths, and these alone go through
Runge–Kutta steps of fourth order (second through the kink at r = d). What happens in a world depends on its
own cells alone. The loops are compiled where numba is installed.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from swarm._support.compiler import inlined, loops
from swarm.physics.crowd.interactions import Contact
from swarm.physics.motion.collocation import Collocation

SLACK = 0.5  # of what a cell swims between places of its path: so much nearer do two come than straight lines
FEW = 64  # cells of a world up to which all pairs are looked at
TINY = 1e-30  # [length²], so that concentric cells do not push


@dataclass(frozen=True)
class Pushes:
    """The contacts of a crowd whose smooth paths a scheme finds."""

    contacts: tuple[Contact, ...]
    scheme: Collocation
    step: float  # stiffness times the length of a Runge–Kutta step

    @cached_property
    def laws(self) -> np.ndarray:
        """Diameter and stiffness (contacts, 2)."""
        return np.array([(each.diameter, each.stiffness) for each in self.contacts])

    @cached_property
    def order(self) -> np.ndarray:
        """The scheme's targets, the nodes and outputs and the end, as time passes."""
        return np.argsort(self.scheme.targets)

    def __call__(self, alive: np.ndarray, *given: np.ndarray) -> np.ndarray:
        """δ_x and δ_y (2, targets, worlds, cells) [length] at the scheme's targets.

        `alive` (worlds, cells) bool; then of each cell (worlds, cells) the components of place and heading,
        curvature, speed and the length of the substep; the components of the rate of deviation at the nodes
        (nodes, worlds, cells); and those of the smooth path at the targets (targets, worlds, cells).
        """
        given = tuple(map(np.ascontiguousarray, given))
        longest = float(np.max(np.abs(given[6]), initial=0.0))
        steps = max(1, math.ceil(float(np.sum(self.laws[:, 1])) * longest / self.step))
        plan = halves(self.scheme, steps), self.laws, self.scheme.targets * steps, self.order
        return in_worlds(alive, given[:7], given[7:9], given[9:], *plan)


@functools.cache
def halves(scheme: Collocation, steps: int) -> np.ndarray:
    """Integrals (2 · steps + 1, nodes) of the nodes' polynomials from the start to every half step."""
    return scheme.integrals(np.arange(2 * steps + 1) / (2 * steps))


@loops
def in_worlds(alive, cells, rates, paths, weights, laws, targets, order):
    """δ (2, targets, worlds, cells)."""
    found = np.zeros((2, len(targets), *alive.shape), cells[0].dtype)
    diameter = np.max(laws[:, 0])
    for world in range(len(alive)):
        x, y, speed, step = cells[0][world], cells[1][world], cells[5][world], cells[6][world]
        far = farthest(alive[world], speed, step, rates[0][:, world], rates[1][:, world])
        pairs = near_pairs(alive[world], x, y, 3 * diameter + 4 * far)
        if len(pairs) > 0:
            gaps = nearest(pairs, x, y, paths[0][:, world], paths[1][:, world], order)
            gaps -= SLACK * far / len(rates[0])
            push(pairs, gaps, cells, rates, weights, laws, targets, world, far, found)
    return found


@loops
def farthest(alive, speed, step, u, v):
    """How far a living cell comes at most in a substep."""
    most = 0.0
    for cell in range(len(alive)):
        if alive[cell]:
            off = 0.0
            for node in range(len(u)):
                off = max(off, abs(u[node, cell]) + abs(v[node, cell]))
            most = max(most, (abs(speed[cell]) + off) * abs(step[cell]))
    return most


@loops
def near_pairs(alive, x, y, reach):
    """Pairs (pairs, 2) of living cells within reach."""
    return pairs_of_few(alive, x, y, reach) if len(x) <= FEW else pairs_of_many(alive, x, y, reach)


@loops
def pairs_of_few(alive, x, y, reach):
    """All pairs are looked at."""
    pairs, count = np.empty((len(x) * (len(x) - 1) // 2, 2), np.int64), 0
    squared = x.dtype.type(reach * reach)  # of single precision where places are
    for first in range(len(x)):
        for second in range(first + 1, len(x)):
            over, up = x[second] - x[first], y[second] - y[first]
            if over * over + up * up <= squared and alive[first] and alive[second]:
                pairs[count, 0], pairs[count, 1] = first, second
                count += 1
    return pairs[:count]


@loops
def pairs_of_many(alive, x, y, reach):
    """Strips as wide as `reach` lie one behind the other: near ones are in the same or the next."""
    order, upper = np.flatnonzero(alive & np.isfinite(x) & np.isfinite(y)), 0
    pairs, count = np.empty((2 * len(order), 2), np.int64), 0
    if len(order) < 2:
        return pairs[:0]
    length = np.max(x[order]) - np.min(x[order]) + 4 * reach
    key = np.floor((y - np.min(y[order])) / reach) * length + (x - np.min(x[order]))
    wide = reach + 1e-15 * np.max(key[order])
    order = order[np.argsort(key[order])]
    for at in range(len(order)):
        first = order[at]
        while upper < len(order) and key[order[upper]] < key[first] + length - wide:
            upper += 1
        for begin, strip in ((at + 1, 0.0), (upper, length)):
            for after in range(begin, len(order)):
                second = order[after]
                if key[second] > key[first] + strip + wide:
                    break
                over, up = x[second] - x[first], y[second] - y[first]
                if over * over + up * up <= reach * reach:
                    if count == len(pairs):
                        pairs = np.concatenate((pairs, np.empty_like(pairs)))
                    pairs[count, 0], pairs[count, 1] = first, second
                    count += 1
    return pairs[:count]


@loops
def nearest(pairs, x, y, path_x, path_y, order):
    """How near (pairs,) pairs come on paths (places, cells), straight from place to place in `order`."""
    found = np.empty(len(pairs))
    for number in range(len(pairs)):
        first, second = pairs[number, 0], pairs[number, 1]
        apart_x, apart_y = x[first] - x[second], y[first] - y[second]
        least = np.inf
        for place in order:
            to_x = path_x[place, first] - path_x[place, second]
            to_y = path_y[place, first] - path_y[place, second]
            over, up = to_x - apart_x, to_y - apart_y
            part = -(apart_x * over + apart_y * up) / (over * over + up * up + TINY)
            part = min(max(part, 0.0), 1.0)
            least = min(least, (apart_x + part * over) ** 2 + (apart_y + part * up) ** 2)
            apart_x, apart_y = to_x, to_y
        found[number] = math.sqrt(least)
    return found


@loops
def push(pairs, gaps, cells, rates, weights, laws, targets, world, far, found):
    """Fills `found` of a world with δ from the pairs (pairs, 2) that touch.

    `gaps` (pairs,) is how near these come if nobody is pushed: those that others push nearer take part in a
    further attempt.
    """
    diameter = np.max(laws[:, 0])
    taken = gaps < diameter
    more = np.any(taken)
    while more:
        rows = np.unique(pairs[taken])
        some = np.searchsorted(rows, pairs[taken])
        track, off = tracks(rows, cells, rates, len(weights) // 2, world)
        deltas = np.zeros((2, len(targets), len(rows)))
        pushed = np.zeros(found.shape[-1])
        clear = diameter + 4 * far / len(weights)  # who is so far apart does not touch in a step
        pushed[rows] = through(some, track, off, weights, laws, targets, clear, deltas)
        found[:, :, world][:, :, rows] = deltas
        more = False
        for number in range(len(pairs)):
            nearer = pushed[pairs[number, 0]] + pushed[pairs[number, 1]]
            if not taken[number] and gaps[number] - nearer < diameter:
                taken[number] = more = True


@loops
def tracks(rows, cells, rates, steps, world):
    """Of some cells place, heading, chord and turn of half a step, length of a step (9, cells), and rates of
    deviation (2, nodes, cells) [length].
    """
    track, off = np.empty((9, len(rows))), np.empty((2, len(rates[0]), len(rows)))
    for number in range(len(rows)):
        cell = rows[number]
        for part in range(4):
            track[part, number] = cells[part][world, cell]
        curvature, speed, step = cells[4][world, cell], cells[5][world, cell], cells[6][world, cell]
        length = speed * step / (2 * steps)
        half = 0.5 * curvature * length
        chord = length * (math.sin(half) / half if abs(half) > 1e-8 else 1.0)
        track[4, number], track[5, number] = chord * math.cos(half), chord * math.sin(half)
        track[6, number], track[7, number] = math.cos(2 * half), math.sin(2 * half)
        track[8, number] = step / steps
        for axis in range(2):
            off[axis, :, number] = rates[axis][:, world, cell] * step
    return track, off


@loops
def through(pairs, track, off, weights, laws, targets, clear, found):
    """Fills `found` (2, targets, cells) with δ, and returns how far cells (cells,) were pushed at most."""
    count = track.shape[1]
    most, delta, moved = np.zeros(count), np.zeros((2, count)), np.zeros((2, count))
    k, places = np.zeros((4, 2, count)), np.zeros((3, 2, count))
    places[0] = track[:2]
    for done in range(len(weights) // 2):
        advance(track, off, weights, 2 * done + 1, places, 1)
        advance(track, off, weights, 2 * done + 2, places, 2)
        moved[:] = 0.0
        if any_within(clear, pairs, places, delta):
            for stage in range(4):  # at the start, twice in the middle, at the end, each from the one before
                force(pairs, places, delta, stage, track, laws, k)
            for axis in range(2):
                for cell in range(count):
                    twice = k[1, axis, cell] + k[2, axis, cell]
                    moved[axis, cell] = (k[0, axis, cell] + 2 * twice + k[3, axis, cell]) / 6
        for number in range(len(targets)):
            if done < targets[number] <= done + 1.001:
                found[:, number] = delta + (targets[number] - done) * moved
        for cell in range(count):
            delta[0, cell] += moved[0, cell]
            delta[1, cell] += moved[1, cell]
            most[cell] = max(most[cell], delta[0, cell] ** 2 + delta[1, cell] ** 2)
            places[0, 0, cell], places[0, 1, cell] = places[2, 0, cell], places[2, 1, cell]
    return np.sqrt(most)


@inlined
def advance(track, off, weights, half, places, number):
    """Moves tracks by half a step along their arcs; places[number] (2, cells) are off them."""
    for cell in range(track.shape[1]):
        ahead, aside = track[2, cell], track[3, cell]
        chord, across = track[4, cell], track[5, cell]
        cosine, sine = track[6, cell], track[7, cell]
        track[0, cell] += ahead * chord - aside * across
        track[1, cell] += aside * chord + ahead * across
        track[2, cell] = ahead * cosine - aside * sine
        track[3, cell] = aside * cosine + ahead * sine
        x, y = track[0, cell], track[1, cell]
        for node in range(weights.shape[1]):
            x += weights[half, node] * off[0, node, cell]
            y += weights[half, node] * off[1, node, cell]
        places[number, 0, cell], places[number, 1, cell] = x, y


@inlined
def any_within(distance, pairs, places, delta):
    """Whether a pair is so near before a step."""
    for pair in range(len(pairs)):
        one, two = pairs[pair, 0], pairs[pair, 1]
        x = places[0, 0, one] - places[0, 0, two] + (delta[0, one] - delta[0, two])
        y = places[0, 1, one] - places[0, 1, two] + (delta[1, one] - delta[1, two])
        if x * x + y * y < distance * distance:
            return True
    return False


@inlined
def force(pairs, places, delta, stage, track, laws, k):
    """Fills k[stage] (2, cells) with what contact moves in a step."""
    number, part = (stage + 1) // 2, (0.0, 0.5, 0.5, 1.0)[stage]
    for cell in range(track.shape[1]):
        k[stage, 0, cell] = k[stage, 1, cell] = 0.0
    for pair in range(len(pairs)):
        one, two = pairs[pair, 0], pairs[pair, 1]
        x = places[number, 0, one] - places[number, 0, two] + (delta[0, one] - delta[0, two])
        y = places[number, 1, one] - places[number, 1, two] + (delta[1, one] - delta[1, two])
        if stage > 0:
            x += part * (k[stage - 1, 0, one] - k[stage - 1, 0, two])
            y += part * (k[stage - 1, 1, one] - k[stage - 1, 1, two])
        distance = math.sqrt(x * x + y * y + TINY)
        rate = 0.0
        for law in range(len(laws)):
            rate += laws[law, 1] * max(laws[law, 0] / distance - 1.0, 0.0)
        k[stage, 0, one] += track[8, one] * rate * x
        k[stage, 1, one] += track[8, one] * rate * y
        k[stage, 0, two] -= track[8, two] * rate * x
        k[stage, 1, two] -= track[8, two] * rate * y
