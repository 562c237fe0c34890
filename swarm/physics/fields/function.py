"""Fields from plain functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from swarm._support.arrays import Array
from swarm._support.checks import check_box, check_function, check_number, check_point, settle


@dataclass(frozen=True)
class FunctionField:
    """A field from a plain function `concentration = function(position)`, with position (..., 2) of any array
    library.

    c_k cannot be guessed from a function, so it must be given. With `max_gradient`, a bound of |∇c|, the
    observation space is bounded by it.
    """

    function: Callable[[Array], Array]
    gradient_scale: float  # c_k [concentration / length]
    max_gradient: float | None = None  # [concentration / length]
    egg_position: tuple[float, float] = (0.0, 0.0)  # [length]
    egg_radius: float | None = None  # a path that comes this close to it has arrived [length]
    # position (..., 2) -> bool (...); a cell that leaves is truncated
    inside: Callable[[Array], Array] | None = None
    box: tuple[tuple[float, float], tuple[float, float]] | None = None  # default start box ((x, x), (y, y))

    def __post_init__(self) -> None:
        settle(self, check_function, "function")
        settle(self, check_number, "gradient_scale", above=0.0)
        settle(self, check_number, "max_gradient", "egg_radius", above=0.0, optional=True)
        settle(self, check_point, "egg_position")
        settle(self, check_function, "inside", optional=True)
        settle(self, check_box, "box", optional=True)

    def concentration(self, position: Array) -> Array:
        return self.function(position)
