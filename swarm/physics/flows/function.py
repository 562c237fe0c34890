"""Flows from plain functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass

import numpy as np

from swarm._support.arrays import Array, as_array, namespace
from swarm._support.checks import Box, Checked, check_box, check_function, check_number, optional, parameter


@dataclass(frozen=True)
class FunctionFlow(Checked):
    """A flow from plain functions of the position (..., 2) of any array library, in space (..., 3).

    Without a function for it the spin, in space the vorticity, is found from the velocity by central
    differences, which is right to about 1e-11 of its scale in float64 (1e-5 in float32) where the velocity is
    smooth. The scales cannot be guessed, so they
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
    # default start box ((x, x), (y, y)), in space of three sides [length]
    box: Box | None = parameter(None, optional(check_box))
    vorticity_function: Callable[[Array], Array] | None = parameter(
        None, optional(check_function)
    )  # (..., 3)

    def velocity(self, position: Array) -> Array:
        return self.function(position)

    def spin(self, position: Array) -> Array:
        """Angular velocity ω₀ (...) at `position` (..., 2): as given, else half the vorticity by central
        differences."""
        if self.spin_function is not None:
            return self.spin_function(position)
        return 0.5 * self._curl(position, 0, 1)

    def vorticity(self, position: Array) -> Array:
        """ω (..., 3), in space: as given, else by central differences."""
        if self.vorticity_function is not None:
            return self.vorticity_function(position)
        pairs = ((1, 2), (2, 0), (0, 1))
        return namespace(position).stack([self._curl(position, *pair) for pair in pairs], axis=-1)

    def _curl(self, position: Array, first: int, second: int) -> Array:
        """∂₁u₂ − ∂₂u₁ (...) of two coordinates."""
        xp = namespace(position)
        # The step balances the fourth-order formula's error against rounding.
        length = min(self.speed_scale / self.spin_scale, 1.0)
        step = float(xp.finfo(position.dtype).eps) ** 0.2 * length

        def difference(component: int, along: int, steps: int) -> Array:
            offset = as_array(steps * step * np.eye(position.shape[-1])[along], position)
            there, back = (self.function(position + way * offset) for way in (1, -1))
            return there[..., component] - back[..., component]

        near = difference(second, first, 1) - difference(first, second, 1)
        far = difference(second, first, 2) - difference(first, second, 2)
        return (8 * near - far) / (12 * step)
