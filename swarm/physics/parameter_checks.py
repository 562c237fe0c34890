"""What the parameters of a world must be; errors name the parameter, the rule and the value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from swarm._support.checks import (
    check_box,
    check_count,
    check_flag,
    check_function,
    check_methods,
    check_name,
    check_number,
    check_point,
)

if TYPE_CHECKING:
    from swarm.physics.parameters import Parameters

INTERVAL_RULES = ("truncated", "exact")
MAX_TICKS = 10_000  # of one decision: the tables have a row for each


def checked(given: Parameters) -> dict[str, Any]:
    """The parameters, each by itself, as they are to be held: whole numbers as `int`, pairs as tuples."""
    check_methods("field", given.field, ["concentration"], ["gradient_scale"])
    check_methods("flow", given.flow, ["velocity", "spin"], ["speed_scale", "spin_scale"])
    check_number("field.gradient_scale", given.field.gradient_scale, above=0.0)
    for name in ("speed_scale", "spin_scale"):
        check_number(f"flow.{name}", getattr(given.flow, name), at_least=0.0)
    values: dict[str, Any] = {"n_records": check_count("n_records", given.n_records, at_least=2)}
    for name in ("sense_flow", "varying_speed"):
        values[name] = check_flag(name, getattr(given, name))
    for name in ("life", "speed", "time_step"):
        values[name] = check_number(name, getattr(given, name), above=0.0)
    for name in ("concentration_noise", "curvature_noise", "rotational_diffusion"):
        values[name] = check_number(name, getattr(given, name), at_least=0.0)
    check_name("interval_rule", given.interval_rule, INTERVAL_RULES)
    values["curvatures"] = _check_curvatures(given.curvatures)
    values["speeds"] = _check_speeds(given.speeds)
    if given.start_box is not None:
        values["start_box"] = check_box("start_box", given.start_box)
    for item in ("field", "flow"):
        _check_options(item, getattr(given, item))
    return values


def check_together(given: Parameters) -> None:
    """Raises ValueError unless the field, the flow and what is sensed of it go together."""
    units: set[Any] = {getattr(part, "length_unit", None) for part in (given.field, given.flow)} - {None}
    if len(units) > 1:
        raise ValueError(f"field and flow must have positions in the same unit, got {sorted(units)}")
    if given.sense_flow and not (given.flow.speed_scale > 0 and given.flow.spin_scale > 0):
        raise ValueError(
            "sense_flow needs a flow with speed_scale and spin_scale above 0 to normalise by, "
            f"got speed_scale {given.flow.speed_scale:g} and spin_scale {given.flow.spin_scale:g}"
        )


def check_times(given: Parameters) -> None:
    """Raises ValueError unless periods, decisions and the life can be counted in ticks."""
    rates = tuple(given.mean_curvature * speed for speed in given.action_speeds)
    if not all(1e-9 < rate < 1e9 for rate in rates):
        raise ValueError(f"mean curvature × speed must lie between 1e-9 and 1e9 rad per time, got {rates}")
    steps = max(given.periods) / (given.n_records * given.time_step)
    if given.interval_rule == "truncated" and steps > MAX_TICKS:
        raise ValueError(
            f"time_step must leave at most {MAX_TICKS} steps per decision, got time_step = "
            f"{given.time_step:g} with period 2π/(κ̄ speed) = {max(given.periods):g} and "
            f"n_records = {given.n_records}"
        )
    if given.life / given.tick > 2**30:
        raise ValueError(f"life must be at most 2^30 ticks of {given.tick:g}, got {given.life:g}")
    if min(given.interval_ticks) < 1:
        raise ValueError(
            "n_records must leave at least one time_step per decision: T/(N_T Δt) must reach 1, got "
            f"n_records = {given.n_records} with period 2π/(κ̄ speed) = {min(given.periods):g} and "
            f"time_step = {given.time_step:g}"
        )


def _check_curvatures(values: Any) -> tuple[float, ...]:
    try:
        curvatures = tuple(check_number("curvatures", value) for value in values)
    except TypeError:
        raise TypeError(f"curvatures must be two or more numbers, got {values!r}") from None
    if len(curvatures) < 2:
        raise ValueError(f"curvatures must be two or more numbers, got {values!r}")
    steps = np.diff(curvatures)
    if curvatures[0] <= 0 or np.any(steps <= 1e-9 * curvatures[-1]):
        raise ValueError(f"curvatures must rise and be positive, got {curvatures}")
    if np.ptp(steps) > 1e-9 * steps[0]:
        raise ValueError(f"curvatures must be evenly spaced, got {curvatures}")
    return curvatures


def _check_speeds(values: Any) -> tuple[float, float]:
    try:
        first, last = (check_number("speeds", value, above=0.0) for value in values)
    except TypeError:
        raise TypeError(f"speeds must be two positive numbers, got {values!r}") from None
    except ValueError:
        raise ValueError(f"speeds must be two positive numbers, got {values!r}") from None
    return first, last


def _check_options(name: str, part: Any) -> None:
    """Checks what a field or a flow need not have."""
    for option in ("max_gradient", "max_speed", "max_spin", "max_shear"):
        if getattr(part, option, None) is not None:
            check_number(f"{name}.{option}", getattr(part, option), at_least=0.0)
    for option in ("period", "egg_radius"):
        if getattr(part, option, None) is not None:
            check_number(f"{name}.{option}", getattr(part, option), above=0.0)
    if getattr(part, "egg_radius", None) is not None:
        check_point(f"{name}.egg_position", getattr(part, "egg_position", (0.0, 0.0)))
    if getattr(part, "box", None) is not None:
        check_box(f"{name}.box", part.box)
    if getattr(part, "inside", None) is not None:
        check_function(f"{name}.inside", part.inside)
