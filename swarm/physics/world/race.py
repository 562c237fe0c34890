"""A race: the egg closes when enough have arrived."""

from __future__ import annotations

import math
from dataclasses import dataclass

from swarm._support.arrays import Array, namespace


@dataclass(frozen=True)
class Race:
    """The first `arrivals` cells of a world win, and those who come until `delay` after the last of them.

    Times of arrival are (..., cells), infinite for who has not arrived.
    """

    arrivals: int
    delay: float = 0.0  # [time]

    def closes(self, arrival_time: Array) -> Array:
        """When the egg closes (..., 1), infinite while too few have arrived [time]."""
        xp = namespace(arrival_time)
        ordered = xp.sort(arrival_time, axis=-1)
        return ordered[..., self.arrivals - 1 : self.arrivals] + self.delay

    def won(self, arrival_time: Array) -> Array:
        """Who has arrived in time (..., cells) bool."""
        return (arrival_time < math.inf) & (arrival_time <= self.closes(arrival_time))

    def ends(self, arrival_time: Array, time: Array) -> Array:
        """Whose life an arrival, its own or the last that counts, has ended by a `time` (..., cells)."""
        return (arrival_time < math.inf) | (self.closes(arrival_time) <= time)
