"""Exchange: what cells eat of a medium and secrete into it while nothing else happens."""

from __future__ import annotations

from typing import Any, NamedTuple

from swarm._support.arrays import added_up, namespace
from swarm.physics.crowd.medium.mesh import Footprint, Mesh

Array = Any


class Exchange(NamedTuple):
    """What cells do at the k nodes that each sees, known before it is known what they find there.

    Half is secreted at first, half at the end; in between c ← c exp(−k Δt Σⱼ δ_h/H) at every node, of which
    each cell has the share of its weight. It does not matter in which order cells come.
    """

    seen: Footprint
    share: Array  # (..., cells · k) that each takes of what is there
    besides: Array  # (..., cells · k) what is there besides the grid's: background, what was just secreted
    given: Array  # (..., cells · k) secreted [concentration]

    def at(self, substep: int) -> Exchange:
        """That of one substep, of arrays with a leading axis of them."""
        index, weight, place = (array[substep, ...] for array in self.seen[:3])
        share, besides, given = (array[substep, ...] for array in self[1:])
        return Exchange(Footprint(index, weight, place, self.seen.cells), share, besides, given)

    def of(self, grid: Array) -> tuple[Array, Array]:
        """The grid (..., nx, ny) afterwards, and what each cell took (..., cells), nodes added up."""
        taken = self.share * (self.seen.read(grid) + self.besides)
        lost = added_up(taken - self.given, self.seen.index, grid.shape[-2] * grid.shape[-1])
        return grid - namespace(grid).reshape(lost, grid.shape), self.seen.by_cell(taken)


def exchange(
    mesh: Mesh, places: Array, origin: Array, acting: Array, cleared: Array, secreted: Array, field: Any
) -> Exchange:
    """What cells at `places` (substeps, ..., cells, 2) do, if they are `acting` (substeps, ..., cells).

    Of every substep `cleared` (...) is k Δt/H [length²] and `secreted` (...) q Δt/H [concentration × area];
    `field` is what the grid holds the deviation from, None where it holds all.
    """
    xp = namespace(places)
    seen = mesh.footprint(places, origin)
    weight = xp.reshape(seen.weight, (*acting.shape, -1)) * acting[..., None]
    density = xp.reshape(weight, seen.weight.shape) / (mesh.spacing[0] * mesh.spacing[1])  # δ_h
    nodes = mesh.shape[0] * mesh.shape[1]
    crowd = []  # all cells' δ_h at the nodes of each
    for i in range(places.shape[0]):  # one grid after the other is in memory
        total = added_up(density[i, ...], seen.index[i, ...], nodes)
        crowd.append(xp.take_along_axis(total, seen.index[i, ...], axis=-1))
    density_of_all = xp.stack(crowd)
    given, cleared = density * secreted[..., None], cleared[..., None]
    besides = 0.5 * secreted[..., None] * density_of_all
    if field is not None:
        background = field.concentration(seen.place)
        besides = besides + xp.where(density > 0, background, xp.zeros_like(background))
    share = density * cleared * _mean_of_decay(cleared * density_of_all)
    return Exchange(seen, share, besides, given)


def _mean_of_decay(exponent: Array) -> Array:
    """The mean (1 − e^{−x})/x of e^{−x} on the way from 0 to x."""
    xp = namespace(exponent)
    some = exponent > 0
    one = xp.ones_like(exponent)
    return xp.where(some, -xp.expm1(-exponent) / xp.where(some, exponent, one), one)
