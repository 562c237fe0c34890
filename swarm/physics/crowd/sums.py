"""Sums: the flow of all dipoles at all cells, pair by pair, by loops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarm._support.compiler import loops
from swarm.physics.crowd import interactions
from swarm.physics.crowd.interactions import Dipole

film, bulk = loops(interactions.film), loops(interactions.bulk)


@dataclass(frozen=True)
class Sums:
    """What the others' dipoles do to every cell, as `Dipole.drift` finds it."""

    dipole: Dipole

    def __call__(self, alive: np.ndarray, *poses: np.ndarray) -> np.ndarray:
        """u_x, u_y and spin (3, rows, cells); `alive` (worlds, cells) bool, `poses` the components of place
        and heading, each (rows, cells), whose rows are those worlds over and over.
        """
        law, strength, core = self.dipole.law
        number = poses[0].dtype.type
        return sums(law is interactions.film, alive, *poses, number(strength), number(core))


@loops
def sums(in_film, alive, x, y, ahead, aside, strength, core):
    """See `Sums`."""
    found = np.zeros((3, *x.shape), x.dtype)
    for row in range(len(x)):
        acts, pose = alive[row % len(alive)], (x[row], y[row], ahead[row], aside[row])
        if in_film:
            add_films(acts, *pose, strength, core, found[0, row], found[1, row], found[2, row])
        else:
            add_bulks(acts, *pose, strength, core, found[0, row], found[1, row], found[2, row])
    return found


@loops
def add_films(acts, x, y, ahead, aside, strength, core, u, v, spin):
    """Adds to u, v and spin (cells,) what all dipoles make in a film."""
    for maker in range(len(x)):
        if acts[maker]:
            at, up, along, across = x[maker], y[maker], ahead[maker], aside[maker]
            for cell in range(len(x)):
                du, dv, turning = film(x[cell] - at, y[cell] - up, along, across, strength, core)
                u[cell] += du
                v[cell] += dv
                spin[cell] += turning


@loops
def add_bulks(acts, x, y, ahead, aside, strength, core, u, v, spin):
    """As `add_films`, in bulk fluid."""
    for maker in range(len(x)):
        if acts[maker]:
            at, up, along, across = x[maker], y[maker], ahead[maker], aside[maker]
            for cell in range(len(x)):
                du, dv, turning = bulk(x[cell] - at, y[cell] - up, along, across, strength, core)
                u[cell] += du
                v[cell] += dv
                spin[cell] += turning
