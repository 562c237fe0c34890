"""Spread: cells that are not alike, each with a speed and a curvature of its own."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarm._support.arrays import Array, as_array, namespace
from swarm._support.checks import Checked, check_made, check_number, check_rule, parameter

MOST = 3.0  # standard deviations, at which normal numbers are cut off


def _check_part(name: str, value: Any) -> float:
    number = check_number(name, value, at_least=0.0)
    check_rule(
        number * MOST < 1, f"{name} must be below 1/{MOST:g}, so that no cell swims backwards", repr(value)
    )
    return number


@dataclass(frozen=True)
class Spread(Checked):
    """Standard deviations, relative to the mean, of the cells' speed and mean curvature.

    Each cell has a factor of its own for the speed, and one for all its curvatures, normally distributed up
    to three standard deviations. A record of curvature tells the action; the sensor `memory_with_traits`
    records both factors too. Decisions last as long for all: ΔT is that of the mean cell.
    """

    speed: float = parameter(0.0, _check_part)
    curvature: float = parameter(0.0, _check_part)

    def factors(self, normal: Array) -> Array:
        """Factors of speed and curvature (cells, 2) of standard normal numbers (cells, 2)."""
        part = as_array(np.array((self.speed, self.curvature)), normal)
        return 1 + namespace(normal).clip(normal, -MOST, MOST) * part

    @property
    def largest(self) -> tuple[float, float]:
        """The largest factors of speed and curvature."""
        return 1 + MOST * self.speed, 1 + MOST * self.curvature


check_spread = functools.partial(check_made, kind=Spread)  # of the spread that a value is or describes
