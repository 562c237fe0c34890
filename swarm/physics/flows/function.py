"""Flows from plain functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass

from swarm._support.arrays import Array, namespace
from swarm._support.checks import Checked, check_box, check_function, check_number, optional, parameter


@dataclass(frozen=True)
class FunctionFlow(Checked):
    """A flow from plain functions of the position (..., 2) of any array library.

    Without `spin` it is found from the velocity by central differences, which is right to about 1e-11 of its
    scale in float64 (1e-5 in float32) where the velocity is smooth. The scales cannot be guessed, so they
    must be given: about the largest speed and spin, for they also set how finely paths are integrated.
    """

    function: Callable[[Array], Array] = parameter(MISSING, check_function)  # velocity (..., 2)
    speed_scale: float = parameter(MISSING, check_number, above=0.0)  # [length / time]
    # [rad / time]; where nothing spins, about the largest velocity gradient
    spin_scale: float = parameter(MISSING, check_number, above=0.0)
    spin_function: Callable[[Array], Array] | None = parameter(None, optional(check_function))  # spin (...)
    max_speed: float | None = parameter(None, optional(check_number), at_least=0.0)  # a bound of |u|
    max_spin: float | None = parameter(None, optional(check_number), at_least=0.0)  # a bound of |ω₀|
    # length after which the flow repeats in x and y
    period: float | None = parameter(None, optional(check_number), above=0.0)
    # position (..., 2) -> bool (...); a cell that leaves is truncated
    inside: Callable[[Array], Array] | None = parameter(None, optional(check_function))
    # default start box ((x, x), (y, y)) [length]
    box: tuple[tuple[float, float], tuple[float, float]] | None = parameter(None, optional(check_box))

    def velocity(self, position: Array) -> Array:
        return self.function(position)

    def spin(self, position: Array) -> Array:
        """Angular velocity ω₀ (...) at `position` (..., 2): as given, else half the vorticity by central
        differences."""
        if self.spin_function is not None:
            return self.spin_function(position)
        xp = namespace(position)
        # The step balances the fourth-order formula's error against rounding.
        length = min(self.speed_scale / self.spin_scale, 1.0)
        step = float(xp.finfo(position.dtype).eps) ** 0.2 * length
        x, y = position[..., 0], position[..., 1]

        def difference(component: int, along_x: float, along_y: float) -> Array:
            place = xp.stack([x + along_x * step, y + along_y * step], axis=-1)
            back = xp.stack([x - along_x * step, y - along_y * step], axis=-1)
            return self.function(place)[..., component] - self.function(back)[..., component]

        vorticity = (
            8 * (difference(1, 1, 0) - difference(0, 0, 1)) - difference(1, 2, 0) + difference(0, 0, 2)
        ) / (12 * step)
        return 0.5 * vorticity
