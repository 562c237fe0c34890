"""The state of a world's cells, what a decision led to, and what a start must be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Self

from swarm._support.arrays import Array, namespace
from swarm._support.checks import check_cells, check_rule
from swarm.physics.crowd.medium import MediumState
from swarm.physics.motion.arc import Pose
from swarm.physics.world.parameters import Parameters

OFF_UNIT = 1e-6  # by which the norm of a frame may be off 1
NOISE_CHANNELS = 3  # sensed concentration, curvature, heading


class State(NamedTuple):
    """Everything that changes; nothing is ever changed in place."""

    position: Array  # (..., cells, 2) [length]; in space (..., cells, 3)
    heading: (
        Array  # (..., cells, 2) unit vector; in space (..., cells, 4) unit quaternion, see `motion.helix`
    )
    memory: Array  # (..., cells, N_T, features), newest first, see `perception`
    clock: Array  # (..., cells) ticks lived; without a common tick (..., cells, actions): decisions by action
    start_concentration: Array  # (..., cells) c(0)
    finished: Array  # (..., cells) bool: arrived, left the domain or out of time
    factors: Array = None  # (..., cells, 2) of the cell's speed and curvature; None where all are alike
    arrival_time: Array = None  # (..., cells) at the egg, infinite before [time]; None where nobody races
    medium: Any = None  # `MediumState`, what cells have changed; None without a medium

    @property
    def pose(self) -> Pose:
        """Position and heading."""
        return pose_of(self)

    def each(self, function: Callable[..., Any], *others: State) -> Self:
        """The state of what `function` makes of each array, together with those of others."""

        def made(first: Any, *rest: Any) -> Any:
            if isinstance(first, tuple):
                return type(first)(*map(made, first, *rest))
            return None if first is None else function(first, *rest)

        state: Self = made(self, *others)
        return state

    def named(self, name: str) -> dict[str, Any]:
        """All arrays by name, "name.field" and "name.field.field"."""
        parts = {f"{name}.{field}": part for field, part in self._asdict().items() if part is not None}
        if medium := parts.pop(f"{name}.medium", None):
            parts |= {f"{name}.medium.{field}": part for field, part in medium._asdict().items()}
        return parts

    @classmethod
    def of_named(cls, arrays: Mapping[str, Any], name: str) -> Self:
        """The state whose arrays `named` gave."""
        parts = {field: arrays.get(f"{name}.{field}") for field in cls._fields}
        if f"{name}.medium.grid" in arrays:
            parts["medium"] = MediumState(*(arrays[f"{name}.medium.{f}"] for f in MediumState._fields))
        return cls(**parts)


def pose_of(state: State) -> Pose:
    """Position and heading, apart from `State.pose` because torch 2.9 compiles no property of a tuple."""
    return Pose(state.position, state.heading)


class Outcome(NamedTuple):
    """What one decision led to."""

    observation: Array  # (..., cells, N_T · features) float32
    reward: Array  # (..., cells) as the world's `reward` has it
    terminated: Array  # (..., cells) bool: reached the egg, or the race is over
    truncated: Array  # (..., cells) bool: out of time, or left the domain
    gain: Array  # (..., cells) c(t) − c(0) [concentration]


def check_arrivals(world: Parameters, cells: int) -> None:
    """Raises ValueError where more cells are to arrive than a world has."""
    wanted, rule = world.first_arrivals, f"first_arrivals must be at most the number of cells, {cells}"
    check_rule(wanted is None or wanted <= cells, rule, wanted)


def check_start(
    world: Parameters, position: Array, heading: Array, past: Array, factors: Array, noise: Array, medium: Any
) -> None:
    """Raises ValueError on what no life can begin with, see `World.start`."""
    xp, axes = namespace(position), world.dimensions
    shape, cells = tuple(position.shape), tuple(position.shape[:-1])
    floats = xp.isdtype(position.dtype, "real floating")
    rule = f"position must be floating numbers (..., cells, {axes})"
    check_rule(bool(cells) and shape[-1] == axes and floats, rule, f"{position.dtype} {shape}")
    frames, turned = cells if axes == 2 else (*cells, 4), tuple(heading.shape)
    check_rule(turned == frames, f"heading must be {frames} like the cells of position", turned)
    records, swum = (*cells, world.n_records), tuple(past.shape)
    whole = xp.isdtype(past.dtype, "integral")
    check_rule(whole and swum == records, f"past must be whole numbers {records}", f"{past.dtype} {swum}")
    if factors is not None:
        rule, made = f"factors must be {shape}, and go with a world that has a spread", tuple(factors.shape)
        check_rule(world.spread is not None and made == shape, rule, f"{made} and spread={world.spread}")
        check_cells("factors", "be positive", factors, xp.all((factors > 0) & xp.isfinite(factors), axis=-1))
    if noise is not None:
        drawn = tuple(noise.shape)
        check_rule(drawn == records, f"noise must be standard normal numbers {records}", drawn)
    rule = "medium must be a MediumState, and go with a world that has a medium"
    fits = medium is None or (world.medium is not None and isinstance(medium, MediumState))
    check_rule(fits, rule, f"{type(medium).__name__} and medium={world.medium}")
    check_arrivals(world, cells[-1])
    check_cells("position", "be finite", position, xp.all(xp.isfinite(position), axis=-1))
    if axes == 2:
        check_cells("heading", "be finite", heading, xp.isfinite(heading))
    else:
        off = xp.abs(xp.sum(heading * heading, axis=-1) - 1)
        check_cells("heading", "be a unit quaternion (w, x, y, z)", heading, off <= 2 * OFF_UNIT)
    known = xp.all((past >= 0) & (past < world.n_actions), axis=-1)
    check_cells("past", f"hold actions from 0 to {world.n_actions - 1}", past, known)
    for inside in world.domains:
        rule = "lie inside the domain of the field and the flow"
        check_cells("position", rule, position, inside(position))


def check_noise(world: Parameters, state: State, noise: Array | None) -> None:
    """Raises ValueError unless there is a number for every cell and channel."""
    needed = (*state.finished.shape, NOISE_CHANNELS + (world.binding_rate is not None))
    found = None if noise is None else tuple(noise.shape)
    rule = f"noise must be standard normal numbers {needed}, because the world has perturbations"
    check_rule(found == needed, rule, found)
