"""Fields from plain functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass

from swarm._support.arrays import Array
from swarm._support.checks import (
    Box,
    Checked,
    check_box,
    check_function,
    check_number,
    check_point,
    optional,
    parameter,
)


@dataclass(frozen=True)
class FunctionField(Checked):
    """A field from a plain function `concentration = function(position)`, with position (..., 2) of any array
    library, in space (..., 3).

    c_k cannot be guessed from a function, so it must be given: about the root mean square of |∇c| where
    lives start, and a world warns of one that is off by more than twice. With `max_gradient`, a bound of
    |∇c|, the observation space is bounded by it.
    """

    function: Callable[[Array], Array] = parameter(MISSING, check_function)
    gradient_scale: float = parameter(MISSING, check_number, above=0.0)  # c_k [concentration / length]
    max_gradient: float | None = parameter(None, optional(check_number), above=0.0)
    egg_position: tuple[float, ...] = parameter((0.0, 0.0), check_point)  # [length]
    # a path that comes this close to the egg has arrived [length]
    egg_radius: float | None = parameter(None, optional(check_number), above=0.0)
    # position (..., 2) -> bool (...); a cell that leaves is truncated
    inside: Callable[[Array], Array] | None = parameter(None, optional(check_function))
    # default start box ((x, x), (y, y)), in space of three sides [length]
    box: Box | None = parameter(None, optional(check_box))

    def concentration(self, position: Array) -> Array:
        return self.function(position)
