"""What parameters of a world must be, and how they are told as plain data."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from contextlib import suppress
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from swarm._support.checks import (
    check_box,
    check_function,
    check_methods,
    check_number,
    check_point,
    check_rule,
)
from swarm._support.registry import TYPE, Registry
from swarm.physics.crowd.interactions import INTERACTIONS
from swarm.physics.fields import FIELDS, Field, FunctionField
from swarm.physics.fields.field import warn_of_scale
from swarm.physics.flows import FLOWS, Flow
from swarm.physics.motion.clock import frozen
from swarm.physics.perception import SENSORS
from swarm.physics.rewards import REWARDS

PARTS = {"field": FIELDS, "flow": FLOWS, "sensor": SENSORS, "reward": REWARDS}  # one of each in a world


def check_field(name: str, value: Any) -> Field:
    _check_made_up(name, value, "concentration", "Field", "gradient_scale=…) with the typical |∇c|")
    field = FIELDS.make(value)
    check_methods(name, field, ["concentration"], ["gradient_scale"])
    check_number(f"{name}.gradient_scale", field.gradient_scale, above=0.0)
    _check_options(name, field)
    return field


def check_flow(name: str, value: Any) -> Flow:
    scales = "speed_scale=…, spin_scale=…) with about the largest speed and spin"
    _check_made_up(name, value, "velocity", "Flow", scales)
    flow = FLOWS.make(value)
    turning = "vorticity" if hasattr(flow, "vorticity") else "spin"  # in space, and in the plane
    check_methods(name, flow, ["velocity", turning], ["speed_scale", "spin_scale"])
    for scale in ("speed_scale", "spin_scale"):
        check_number(f"{name}.{scale}", getattr(flow, scale), at_least=0.0)
    _check_options(name, flow)
    return flow


def _check_made_up(name: str, value: Any, method: str, kind: str, scales: str) -> None:
    """Raises TypeError for a bare function, or bare data, with what makes a part of a world of it."""
    if hasattr(value, "shape") or hasattr(value, "data_vars"):
        made = f"swarm.Gridded{kind}(data, edges=…) of data on a grid"
        raise TypeError(f"{name} must be an object, {made}, got {type(value).__name__}")
    if callable(value) and not isinstance(value, type) and not hasattr(value, method):
        made = f"swarm.Function{kind}(function, {scales}"
        raise TypeError(f"{name} must be an object with its scale, {made}, got {value!r}")


def _check_options(name: str, part: Any) -> None:
    """Checks what a field or a flow need not have."""
    bounds = ("max_gradient", "max_rate", "max_speed", "max_spin", "max_shear", "max_frequency")
    for option in (*bounds, "period", "egg_radius"):
        if getattr(part, option, None) is not None:
            rule = {"at_least" if option in bounds else "above": 0.0}
            check_number(f"{name}.{option}", getattr(part, option), **rule)
    if getattr(part, "egg_radius", None) is not None:
        check_point(f"{name}.egg_position", getattr(part, "egg_position", (0.0, 0.0)))
    for option, check in (("box", check_box), ("inside", check_function)):
        if getattr(part, option, None) is not None:
            check(f"{name}.{option}", getattr(part, option))


NOT_IN_SPACE = {
    "medium": None,
    "interactions": (),
    "action": "discrete",
    "first_arrivals": None,
    "spread": None,
    "rotational_diffusion": 0.0,
}


def check_numbers(name: str, values: Any, *, rule: str) -> tuple[float, ...]:
    try:
        return tuple(check_number(name, value) for value in values)
    except TypeError:
        raise TypeError(f"{name} must be {rule}, got {values!r}") from None


def check_dimensions(world: Any) -> None:
    """Raises ValueError where parameters of a world do not go with the plane, or space, that it is."""
    space = world.torsions is not None
    rule = f"torsions must be a number for each of the {world.n_actions} curvatures"
    check_rule(not space or len(world.torsions) == world.n_actions, rule, world.torsions)
    for name, value in NOT_IN_SPACE.items() if space else ():
        found = getattr(world, name)
        check_rule(found == value, f"{name} must be {value!r} in space (with torsions)", repr(found))
    axes, where = world.dimensions, "in space (with torsions)" if space else "in the plane (without torsions)"
    for name in ("sensor", "field", "flow"):
        part = getattr(world, name)
        fits = getattr(part, "coordinates", None) in (None, axes)
        check_rule(fits, f"{name} must be one {where}", repr(part))
        box = getattr(part, "box", None)
        check_rule(box is None or len(box) == axes, f"{name}.box must have {axes} sides {where}", box)
    turning, start_box = "vorticity" if space else "spin", world.start_box
    turns = callable(getattr(world.flow, turning, None))
    check_rule(turns, f"flow must have {turning}(position) {where}", repr(world.flow))
    fits = start_box is None or len(start_box) == axes
    check_rule(fits, f"start_box must have {axes} sides {where}", start_box)
    egg = None if world.egg is None else world.egg[0]
    check_rule(egg is None or len(egg) == axes, f"egg_position must be {axes} numbers {where}", egg)
    if space:
        _check_probe(world.flow, [low for low, _ in world.box])


def _check_probe(flow: Flow, place: list[float]) -> None:
    """Raises ValueError where a flow of a user gives velocities of the plane in space."""
    try:
        with np.errstate(all="ignore"):
            found = np.shape(flow.velocity(np.array([place])))
    except Exception:  # a function may want other arrays than NumPy's
        return
    check_rule(found == (1, 3), "flow.velocity must be (..., 3) of positions (..., 3) in space", found)


def check_curvatures(name: str, values: Any) -> tuple[float, ...]:
    curvatures = check_numbers(name, values, rule="two or more numbers")
    check_rule(len(curvatures) >= 2, f"{name} must be two or more numbers", repr(values))
    steps = np.diff(curvatures)
    rises = curvatures[0] > 0 and bool(np.all(steps > 1e-9 * curvatures[-1]))
    check_rule(rises, f"{name} must rise and be positive", curvatures)
    check_rule(np.ptp(steps) <= 1e-9 * steps[0], f"{name} must be evenly spaced", curvatures)
    return curvatures


def check_units(name: str, value: Any) -> tuple[str, str]:
    """Return `value` as names of two units; raises ValueError where it is none."""
    units = () if isinstance(value, str) or not isinstance(value, Sequence) else tuple(value)
    known = len(units) == 2 and all(isinstance(unit, str) and unit.isprintable() and unit for unit in units)
    check_rule(known, f"{name} must be the units of length and time, as ('µm', 's')", repr(value))
    return units[0], units[1]


def check_length_units(units: tuple[str, str] | None, *parts: Any) -> None:
    """Raises ValueError unless the world and the data of its parts have positions in one unit."""
    found: set[Any] = {getattr(part, "length_unit", None) for part in parts} | {units and units[0]}
    found -= {None}
    check_rule(len(found) <= 1, "field and flow must have positions in the same unit", sorted(found))


def in_units(unit: str, units: Sequence[str] | None) -> str:
    """A unit told by "length" and "time", as "1/length", in a world's units."""
    for name, own in zip(("length", "time"), units or (), strict=False):
        unit = unit.replace(name, own)
    return unit


def as_data(name: str, part: Any) -> Any:
    """A parameter of a world as plain data."""

    def told(registry: Registry, part: Any) -> dict[str, Any]:
        return registry.describe(part) or {TYPE: type(part).__name__}

    if name in PARTS:
        return told(PARTS[name], part)
    if name == "interactions":
        return [told(INTERACTIONS, each) for each in part]
    return json.loads(json.dumps(dataclasses.asdict(part) if name in ("medium", "spread") and part else part))


def check_times(life: float, **parts: Any) -> None:
    """Raises ValueError where a part has data for a part of the life only."""
    for name, part in parts.items():
        times = getattr(part, "times", None)
        if times is not None:
            rule = f"{name} must have data for all times from 0 to the life {life:g}, or outside_time='held'"
            check_rule(times[0] <= 0.0 <= life <= times[1], rule, f"{times[0]:g} to {times[1]:g}")


# --- the scale of a field that users bring, beside the gradients that cells meet ----------------------------

POINTS = 12  # along each side of the start box
STEP = 0.01  # of differences, in mean radii of the paths
NEGLIGIBLE = 1e-9  # rise over a step, of the concentration

_seen: WeakValueDictionary[tuple[Any, ...], Any] = WeakValueDictionary()


def check_scale(world: Any) -> None:
    """Warns, once for a field, where its `gradient_scale` is off by more than twice from the gradients where
    lives start. Looked at are functions and classes of users; grids look at themselves.
    """
    field, box = world.field, world.box
    if type(field).__module__.startswith("swarm.") and not isinstance(field, FunctionField):
        return
    key = id(field), field.gradient_scale, box
    if _seen.get(key) is field:
        return
    with suppress(TypeError):  # of a field that nothing can refer to weakly
        _seen[key] = field
    if (typical := typical_gradient(world)) is not None:
        warn_of_scale(field.gradient_scale, typical, "sampled where lives start")


def typical_gradient(world: Any) -> float | None:
    """The root mean square of |∇c| in the start box [concentration / length], at the beginning, the middle
    and the end of a life; None where there is none, or the field cannot be asked.
    """
    step = STEP / world.mean_curvature
    sides = [np.linspace(low, high, POINTS) for low, high in world.box]
    axes = np.eye(len(sides))
    stencil = step * np.stack([axes, -axes], axis=1).reshape(-1, len(sides))
    places = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 1, len(sides)) + stencil
    field = world.field
    times = np.linspace(0.0, world.life, 3) if hasattr(field, "at") else [0.0]
    try:
        with np.errstate(all="ignore"):
            if getattr(field, "inside", None) is not None:
                places = places[np.asarray(field.inside(places), bool).all(axis=-1)]
            found = np.stack([np.asarray(frozen(field, time).concentration(places)) for time in times])
        slopes = (found[..., ::2] - found[..., 1::2]) / (2 * step)
        known = np.isfinite(slopes).all(axis=-1)
    except Exception:  # a function may want other arrays than NumPy's
        return None
    if not known.any():
        return None
    typical = float(np.sqrt(np.sum(slopes[known] ** 2, axis=-1).mean()))
    return typical if typical * step > NEGLIGIBLE * np.abs(found[known]).max() else None
