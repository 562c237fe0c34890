"""The medium: the attractant that all cells of a world share, on a grid that they eat from and secrete into.

    ∂c/∂t = D∇²c − u·∇c − λ c − (k/H) Σⱼ δ_h(x − xⱼ) c + (q/H) Σⱼ δ_h(x − xⱼ)

Amounts are concentration × area × H. All functions are pure and written against the Python array API, for any
leading batch axes.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, kept_for, namespace
from swarm._support.checks import (
    Checked,
    check_box,
    check_count,
    check_flag,
    check_made,
    check_name,
    check_number,
    optional,
    parameter,
)
from swarm.physics.crowd.medium import suitability, transport
from swarm.physics.crowd.medium.exchange import Exchange, exchange
from swarm.physics.crowd.medium.mesh import WIDTHS, Box, Mesh
from swarm.physics.crowd.medium.transport import Waves
from swarm.physics.fields import Field
from swarm.physics.flows import Flow, StillWater
from swarm.physics.motion.clock import frozen

Array = Any


def _check_room(name: str, value: Any) -> Box:
    box: Any = check_box(name, value)
    if len(box) != 2 or not all(0 < high - low < math.inf for low, high in box):
        raise ValueError(f"{name} must have two sides, of lengths above 0 that are finite, got {value!r}")
    return box


def _check_shape(name: str, value: Any) -> tuple[int, int]:
    try:
        rows, columns = (check_count(name, number) for number in value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be two whole numbers of nodes (nx, ny), got {value!r}") from None
    return rows, columns


class MediumState(NamedTuple):
    """What the medium holds, and the account of where it went; nothing is ever changed in place."""

    grid: Array  # (..., nx, ny) deviation from the field, or what is carried, at the nodes [concentration]
    origin: Array  # (..., 2) low corner of the grid [length]
    eaten: Array  # (..., cells) by each cell so far [amount]
    secreted: Array  # (..., cells) by each cell so far [amount]
    decayed: Array  # (...) so far; of deviations signed [amount]
    outflow: Array  # (...) what a following grid left behind, less what it met [amount]


@dataclass(frozen=True)
class Medium(Checked):
    """A medium on a grid of `shape` nodes, the centres of the meshes of a `box`.

    The grid holds the deviation from the world's field, which stays exact where nobody eats: it diffuses,
    relaxes by −λ(c − c_field) and is not carried. Or it holds the whole field, which starts as `field` is at
    t = 0, and the flow carries it (`carried=True`). Raises TypeError or ValueError that names the parameter,
    the rule and the value.
    """

    box: Box = parameter(((0.0, 10.0), (0.0, 10.0)), _check_room)  # [length]
    shape: tuple[int, int] = parameter((128, 128), _check_shape)  # nodes (nx, ny)
    edges: str = parameter("periodic", check_name, known=("periodic", "noflux"))
    diffusivity: float = parameter(0.024, check_number, at_least=0.0)  # D [length² / time]
    uptake: float = parameter(0.0, check_number, at_least=0.0)  # k of a cell [length³ / time]
    secretion: float = parameter(0.0, check_number, at_least=0.0)  # q of a cell [amount / time]
    decay: float = parameter(0.0, check_number, at_least=0.0)  # λ [1 / time]
    thickness: float = parameter(1.0, check_number, above=0.0)  # H of the film [length]
    carried: bool = parameter(False, check_flag)
    # a cell that leaves the box comes back on the other side, or ends; or the grid follows the cells' mean
    leaving: str = parameter("truncate", check_name, known=("wrap", "truncate", "follow"))
    kernel: str = parameter("cubic", check_name, known=tuple(WIDTHS))  # δ_h: a B-spline of 2 or 4 nodes
    # of a decision; None: as many as keep a cell's step within a mesh and advection stable
    substeps: int | None = parameter(None, optional(check_count))

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.shape) < WIDTHS[self.kernel]:
            rule = f"shape must be at least {WIDTHS[self.kernel]} nodes along each axis for the kernel"
            raise ValueError(f"{rule} {self.kernel!r}, got {self.shape}")
        if self.leaving == "wrap" and self.edges != "periodic":
            raise ValueError(f"leaving='wrap' must go with edges='periodic', got edges={self.edges!r}")

    # --- the grid -----------------------------------------------------------------------------------------

    @cached_property
    def mesh(self) -> Mesh:
        """The nodes, and how cells see them."""
        periodic, endless = self.edges == "periodic", self.leaving == "wrap"
        return Mesh(self.box, self.shape, periodic, endless, self.kernel)

    @cached_property
    def volume(self) -> float:
        """h² H of a node, by which a concentration becomes an amount [length³]."""
        return self.mesh.spacing[0] * self.mesh.spacing[1] * self.thickness

    def inside(self, position: Array, origin: Array = None) -> Array:
        """Whether `position` (..., cells, 2) lies in the box; a cell that does not ends, unless it wraps.

        `origin` (..., 2) is the state's; None: where the box is at first.
        """
        return self.mesh.inside(position, self.mesh.corner(position) if origin is None else origin)

    def substeps_for(self, flow: Flow, speed: float, interval: float) -> int:
        """Substeps of a decision of length `interval` of cells that swim at most at `speed`."""
        return suitability.substeps(self, flow, speed, interval)

    def check(self, field: Field, flow: Flow, **cells: Any) -> None:
        """Raises ValueError where the medium does not suit a world: see
        [`suitability.check`][swarm.physics.crowd.medium.suitability.check]."""
        suitability.check(self, field, flow, **cells)

    @cached_property
    def _waves(self) -> dict[Any, tuple[Waves, Waves]]:
        return {}

    def waves(self, like: Array) -> tuple[Waves, Waves]:
        """Waves along x and y in the array library, precision and device of `like`."""

        def along(n: int, length: float) -> Waves:
            parts = transport.waves(n, length, periodic=self.mesh.periodic)
            return Waves(*(as_array(part, like) for part in parts))

        x, y = kept_for(like, self._waves, lambda: tuple(map(along, self.shape, self.mesh.size)))
        return x, y

    # --- life ---------------------------------------------------------------------------------------------

    def start(self, field: Field, position: Array) -> MediumState:
        """The medium at t = 0 with cells at `position` (..., cells, 2)."""
        xp = namespace(position)
        batch = tuple(position.shape[:-2])
        origin = xp.broadcast_to(self.mesh.corner(position), (*batch, 2))
        if self.leaving == "follow":
            everyone = position[..., 0] == position[..., 0]
            origin = self.mesh.centred(origin, position, everyone)[0]
        grid = as_array(np.zeros((*batch, *self.shape)), position)
        if self.carried:
            grid = xp.reshape(frozen(field, 0.0).concentration(self.mesh.places(origin)), grid.shape)
        nothing = xp.zeros_like(position[..., 0])
        return MediumState(grid, origin, nothing, nothing, xp.sum(nothing, axis=-1), xp.sum(nothing, axis=-1))

    def sense(self, state: MediumState, position: Array, background: Array) -> Array:
        """Concentration (..., cells) at `position` (..., cells, 2), through the kernel by which cells eat.

        `background` (..., cells) is the field's there; what is carried needs none.
        """
        seen = self.mesh.footprint(position, state.origin)
        found = seen.by_cell(seen.weight * seen.read(state.grid))
        return found if self.carried else background + found

    def step(
        self,
        state: MediumState,
        field_at: Callable[[Array], Field],
        flow_at: Callable[[Array], Flow],
        places: Array,
        duration: Array,
        alive: Array,
        time: Array = 0.0,
    ) -> MediumState:
        """The medium after a decision, by Strang's splitting: of second order in the substeps.

        `places` (substeps, ..., cells, 2) are the cells' positions in the middle of each substep, `duration`
        and the `time` at its start are () or (...), and `alive` (..., cells) says who eats and secretes; who
        is outside the box does not. `field_at(time)` and `flow_at(time)` give both as they are at a time that
        broadcasts with positions' (..., places).
        """
        xp, count = namespace(state.grid), places.shape[0]
        part = xp.asarray(duration, dtype=state.grid.dtype) / count
        middles = as_array(np.arange(count) + 0.5, state.grid)
        times = time + xp.reshape(middles, (count, *(1,) * part.ndim)) * part
        times = times[..., None]  # one number for all places
        meals = self._meals(state, None if self.carried else field_at(times), places, alive, part)
        half, whole = self._propagators(state.grid, 0.5 * part), self._propagators(state.grid, part)
        state, flow, velocity = self._diffused(state, half, 0.5 * part), None, None
        for i in range(count):
            if i > 0:
                state = self._diffused(state, whole, part)
            meal = None if meals is None else meals.at(i)
            state = self._fed_on(state, meal)
            if self.carried:
                now = flow_at(times[i, ...])
                if now is not flow:
                    flow, velocity = now, self._velocity(now, state)
                if velocity is not None:
                    x, y = self.waves(state.grid)
                    moved = transport.advected(state.grid, velocity, x.slope, y.slope, part)
                    state = state._replace(grid=moved)
                state = self._fed_on(state, meal)
        state = self._diffused(state, half, 0.5 * part)
        if self.leaving != "follow":
            return state
        return self._followed(state, field_at, places[-1, ...], alive, time + duration)

    def _meals(
        self, state: MediumState, field: Field | None, places: Array, alive: Array, part: Array
    ) -> Exchange | None:
        """What cells do in each substep; to what is carried in each half, before and after the flow."""
        if self.uptake == 0 and self.secretion == 0:
            return None
        part = 0.5 * part if self.carried else part
        acting = namespace(places).astype(alive & self.mesh.inside(places, state.origin), state.grid.dtype)
        cleared, secreted = part * (self.uptake / self.thickness), part * (self.secretion / self.thickness)
        return exchange(self.mesh, places, state.origin, acting, cleared, secreted, field)

    def _fed_on(self, state: MediumState, meal: Exchange | None) -> MediumState:
        if meal is None:
            return state
        grid, taken = meal.of(state.grid)
        state = state._replace(grid=grid, eaten=state.eaten + taken * self.volume)
        if self.secretion == 0:
            return state
        given = meal.seen.by_cell(meal.given) * self.volume
        return state._replace(secreted=state.secreted + given)

    def _velocity(self, flow: Flow, state: MediumState) -> Array | None:
        """The flow (2, ..., nx, ny) at the nodes; None where it is still."""
        if isinstance(flow, StillWater):
            return None
        xp = namespace(state.grid)
        follows = self.leaving == "follow"  # else the nodes are where they were, in all batches
        places = self.mesh.places(state.origin if follows else self.mesh.corner(state.origin))
        velocity = flow.velocity(places)
        return xp.moveaxis(xp.reshape(velocity, (*velocity.shape[:-2], *self.shape, 2)), -1, 0)

    def _propagators(self, like: Array, part: Array) -> tuple[Array, Array]:
        if isinstance(like, np.ndarray) and part.size and part.min() == part.max():  # one for all worlds
            return _propagators_of(self, float(part.min()), part.dtype.name)
        return self._propagators_for(like, part)

    def _propagators_for(self, like: Array, part: Array) -> tuple[Array, Array]:
        along = self.waves(like)
        x = transport.propagator(along[0], self.diffusivity, part)
        if self.shape[0] == self.shape[1] and self.mesh.size[0] == self.mesh.size[1]:
            return x, x
        return x, transport.propagator(along[1], self.diffusivity, part)

    def _diffused(self, state: MediumState, spread: tuple[Array, Array], part: Array) -> MediumState:
        xp, grid = namespace(state.grid), state.grid
        if self.carried or grid.dtype == xp.float32:  # the rounding of a large mean would add up
            mean = xp.mean(grid, axis=(-2, -1), keepdims=True)
            grid = transport.diffused(grid - mean, spread) + mean
        else:
            grid = transport.diffused(grid, spread)
        if self.decay == 0:
            return state._replace(grid=grid)
        lost = -xp.expm1(-self.decay * part)
        decayed = state.decayed + self.amount(grid) * lost
        return state._replace(grid=grid - grid * lost[..., None, None], decayed=decayed)

    def _followed(
        self,
        state: MediumState,
        field_at: Callable[[Array], Field],
        position: Array,
        alive: Array,
        time: Array,
    ) -> MediumState:
        xp, grid = namespace(state.grid), state.grid
        origin, moves = self.mesh.centred(state.origin, position, alive)
        keep = []  # matrices (..., n, n) that pick each node's predecessor, if it has one
        for move, n in zip(moves, self.shape, strict=True):
            number = as_array(np.arange(n), grid)
            keep.append(xp.astype(number[:, None] + move[..., None, None] == number, grid.dtype))
        moved = transport.diffused(grid, (keep[0], keep[1]))
        if self.carried:
            kept = xp.sum(keep[0], axis=-1)[..., :, None] * xp.sum(keep[1], axis=-1)[..., None, :]
            time = xp.asarray(time, dtype=grid.dtype)
            field = field_at(time[..., None] if time.ndim else time)
            met = xp.reshape(field.concentration(self.mesh.places(origin)), grid.shape)
            moved = moved + (1 - kept) * met
        outflow = state.outflow + self.amount(grid) - self.amount(moved)
        return state._replace(grid=moved, origin=origin, outflow=outflow)

    # --- the account --------------------------------------------------------------------------------------

    def amount(self, grid: Array) -> Array:
        """What a grid (..., nx, ny) holds (...) [amount]."""
        return namespace(grid).sum(grid, axis=(-2, -1)) * self.volume

    def balance(self, state: MediumState) -> Array:
        """grid + eaten + decayed − secreted + outflow (...), which never changes [amount]."""
        by_cells = namespace(state.grid).sum(state.eaten - state.secreted, axis=-1)
        return self.amount(state.grid) + by_cells + state.decayed + state.outflow


@functools.lru_cache(maxsize=16)  # few intervals differ; a quarter of a decision's time in NumPy
def _propagators_of(medium: Medium, part: float, dtype: str) -> tuple[Array, Array]:
    like = np.empty(0, dtype)
    return medium._propagators_for(like, np.asarray(part, dtype))


check_medium = functools.partial(check_made, kind=Medium)  # of the medium that a value is or describes
