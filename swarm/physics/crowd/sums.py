"""Sums: the flow of all dipoles at all cells, pair by pair, for the processor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from swarm._support.loops import loops
from swarm.physics.crowd import interactions
from swarm.physics.crowd.interactions import Dipole

film, bulk = loops(interactions.film), loops(interactions.bulk)


@dataclass(frozen=True)
class Sums:
    """What the others' dipoles do to every cell, as `Dipole.drift` finds it."""

    dipole: Dipole

    def __call__(self, alive: np.ndarray, *poses: np.ndarray) -> np.ndarray:
        """u_x, u_y and spin (3, rows, cells); `alive` (worlds, cells) bool, `poses` x, y and the components of
        the heading, (rows, cells), whose rows are those worlds over and over.
        """
        law, strength, core = self.dipole.law
        number = poses[0].dtype.type
        return sums_of_rows(law is interactions.film, alive, *poses, number(strength), number(core))


@loops
def sums_of_rows(film, alive, x, y, ahead, aside, strength, core):
    """u_x, u_y and spin (3, rows, cells)."""
    found = np.zeros((3, *x.shape), x.dtype)
    for row in range(len(x)):
        given = alive[row % len(alive)], x[row], y[row], ahead[row], aside[row], strength, core
        if film:
            films(*given, found[0, row], found[1, row], found[2, row])
        else:
            bulks(*given, found[0, row], found[1, row], found[2, row])
    return found


@loops
def films(alive, x, y, ahead, aside, strength, core, u, v, spin):
    """Adds to u, v and spin (cells,) what all cells make in a film."""
    for maker in range(len(x)):
        if alive[maker]:
            at, up, along, across = x[maker], y[maker], ahead[maker], aside[maker]
            for cell in range(len(x)):
                du, dv, turning = film(x[cell] - at, y[cell] - up, along, across, strength, core)
                u[cell] += du
                v[cell] += dv
                spin[cell] += turning


@loops
def bulks(alive, x, y, ahead, aside, strength, core, u, v, spin):
    """As `films`, in bulk fluid."""
    for maker in range(len(x)):
        if alive[maker]:
            at, up, along, across = x[maker], y[maker], ahead[maker], aside[maker]
            for cell in range(len(x)):
                du, dv, turning = bulk(x[cell] - at, y[cell] - up, along, across, strength, core)
                u[cell] += du
                v[cell] += dv
                spin[cell] += turning
