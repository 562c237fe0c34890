"""Checks of parameters: an error names the thing, the rule and the value."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import importlib.util
import math
import numbers
import operator
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from swarm._support.arrays import namespace

Array = Any
Box = tuple[tuple[float, float], ...]  # (low, high) of x and y, in space of z too


def check_installed(needs: str, *packages: str, extra: str) -> None:
    """Raises ModuleNotFoundError where one of the packages is missing, with the extra of this software that
    brings them; `needs` begins the line: "figures need".
    """
    for name in packages:
        if importlib.util.find_spec(name) is None:
            raise ModuleNotFoundError(f"{needs} {name}: pip install 'chemoswarm[{extra}]'", name=name)


def check_options(options: Any) -> dict[str, Any]:
    """What a reset is given, empty for None; raises TypeError where it is no dictionary."""
    if not isinstance(options, dict | None):
        raise TypeError(f"options must be a dictionary or None, got {options!r}")
    return options or {}


def check_rule(holds: bool, rule: str, value: Any) -> None:
    """Raises ValueError that tells the rule and the value unless it holds."""
    if not holds:
        raise ValueError(f"{rule}, got {value}")


def check_number(
    name: str, value: Any, *, above: float | None = None, at_least: float | None = None
) -> float:
    """Return `value` as a float; raises unless it is a finite real number within the bounds."""
    rule = "a finite number"
    if above is not None:
        rule += f" above {above:g}"
    if at_least is not None:
        rule += f" of at least {at_least:g}"
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise TypeError(f"{name} must be {rule}, got {value!r}")
    try:
        number = float(value)
    except OverflowError:  # an integer beyond the floats
        number = math.inf
    low = (above is not None and number <= above) or (at_least is not None and number < at_least)
    if not math.isfinite(number) or low:
        raise ValueError(f"{name} must be {rule}, got {value!r}")
    return number


def check_count(name: str, value: Any, *, at_least: int = 1) -> int:
    """Return `value` as an int; raises unless it is a whole number of at least `at_least`."""
    rule = f"a whole number of at least {at_least}"
    try:
        if isinstance(value, bool):
            raise TypeError
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} must be {rule}, got {value!r}") from None
    if number < at_least:
        raise ValueError(f"{name} must be {rule}, got {number}")
    if number > sys.maxsize:
        raise ValueError(f"{name} must be at most {sys.maxsize}, got {number}")
    return number


def check_memory(needed: float, rule: str) -> None:
    """Raises ValueError where this machine has less memory [bytes] than needed; `rule` says what helps."""
    try:
        there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # the operating system does not tell
        return
    if needed > there:
        raise ValueError(
            f"{rule}: {needed / 2**30:.3g} GiB of memory are needed, this machine has {there / 2**30:.3g}"
        )


def check_flag(name: str, value: Any) -> bool:
    """Return `value`; raises TypeError unless it is True or False."""
    if not isinstance(value, bool):
        raise TypeError(f"{name} must be True or False, got {value!r}")
    return value


def check_name(name: str, value: Any, known: Iterable[str]) -> str:
    """Return `value`; raises unless it is one of the `known` names, suggesting the nearest."""
    choices = sorted(known)
    listed = ", ".join(choices)
    if not isinstance(value, str):
        raise TypeError(f"{name} must be one of {listed}, got {value!r}")
    if value not in choices:
        near = difflib.get_close_matches(value, choices, n=1, cutoff=0.4)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"{name} must be one of {listed}, got {value!r}{hint}")
    return value


def check_methods(name: str, value: Any, methods: Sequence[str], attributes: Sequence[str]) -> None:
    """Raises TypeError unless `value` has the methods and the numeric attributes."""
    if isinstance(value, type):
        raise TypeError(
            f"{name} must be an object, not a class, got {value!r}; did you mean {value.__name__}()?"
        )
    missing = [f"{method}(position)" for method in methods if not callable(getattr(value, method, None))]
    missing += [attribute for attribute in attributes if not hasattr(value, attribute)]
    if missing:
        raise TypeError(f"{name} must have {', '.join(missing)}, got {value!r}")


def check_function(name: str, value: Any) -> Any:
    """Return `value`; raises TypeError unless it can be called."""
    if not callable(value) or isinstance(value, type):
        raise TypeError(f"{name} must be a function of positions (..., 2), got {value!r}")
    return value


def check_pair(
    name: str, value: Any, *, rule: str = "two finite numbers (x, y)", **bounds: float
) -> tuple[float, float]:
    """Return `value` as two floats; raises unless it is two finite numbers within the bounds."""
    x, y = _numbers(name, value, 2, rule, **bounds)
    return x, y


def check_triple(name: str, value: Any) -> tuple[float, ...]:
    """Return `value` as three floats; raises unless it is three finite numbers."""
    return _numbers(name, value, 3, "three finite numbers")


def _numbers(name: str, value: Any, count: int, rule: str, **bounds: float) -> tuple[float, ...]:
    try:
        numbers = tuple(check_number(name, number, **bounds) for number in value)
        if len(numbers) == count:
            return numbers
        kind: type[Exception] = ValueError
    except (TypeError, ValueError) as error:
        kind = TypeError if isinstance(error, TypeError) else ValueError
    raise kind(f"{name} must be {rule}, got {value!r}")


def check_point(name: str, value: Any) -> tuple[float, ...]:
    """Return `value` as two floats, or three of a place in space; raises where it is none."""
    if isinstance(value, Sequence) and len(value) == 3:
        return check_triple(name, value)
    return check_pair(name, value, rule="two finite numbers (x, y), or three in space")


def check_box(name: str, value: Any) -> Box:
    """Return `value` as ((x_low, x_high), (y_low, y_high)) of floats, in space with a third pair; raises
    ValueError where it is none.
    """
    try:
        sides = tuple(tuple(check_number(name, number) for number in side) for side in value)
    except (TypeError, ValueError):
        sides = ()
    if len(sides) not in (2, 3) or not all(len(side) == 2 and side[0] <= side[1] for side in sides):
        raise ValueError(f"{name} must be ((x_low, x_high), (y_low, y_high)) with low <= high, got {value!r}")
    return sides  # type: ignore[return-value]


def optional(check: Callable[..., Any]) -> Callable[..., Any]:
    """The check of what may be None."""
    return lambda name, value, **rules: None if value is None else check(name, value, **rules)


def parameter(default: Any, check: Callable[..., Any], **rules: Any) -> Any:
    """A field of a dataclass with its default and its rule: it holds what `check(name, value, **rules)`
    returns, see `Checked`."""
    return dataclasses.field(default=default, metadata={"check": functools.partial(check, **rules)})


class Checked:
    """A frozen dataclass of `parameter`s, which are checked in their order when it is made.

    It keeps what the checks return. Plain floats matter: a NumPy scalar would turn float32 arrays into
    float64 ones and torch tensors into NumPy arrays.
    """

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):  # type: ignore[arg-type]
            if check := item.metadata.get("check"):
                value = getattr(self, item.name)
                try:
                    object.__setattr__(self, item.name, check(item.name, value))
                except ArithmeticError:
                    raise ValueError(
                        f"{item.name} must be of numbers that do not overflow, got {value!r}"
                    ) from None


def check_made(name: str, value: Any, *, kind: type) -> Any:
    """The object of a dataclass `kind` that `value` is or describes, a mapping of its parameters."""
    if isinstance(value, kind):
        return value
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} must be a {kind.__name__} or a mapping of its parameters, got {value!r}")
    for key in value:
        check_name(f"parameter of {name}", key, [item.name for item in dataclasses.fields(kind)])
    try:
        return kind(**value)
    except (TypeError, ValueError) as error:
        raised = TypeError if isinstance(error, TypeError) else ValueError
        raise raised(f"{name}.{error}") from None


def check_cells(name: str, rule: str, value: Array, good: Array) -> None:
    """Raises ValueError that names the first cell whose `good` (..., cells) is False.

    `value` is (..., cells) or (..., cells, k). Inside a trace (jax.jit), where nothing is known yet, nothing
    is checked.
    """
    xp = namespace(good)
    try:
        if bool(xp.all(good)):
            return
    except (TypeError, RuntimeError):
        return
    cell = int(xp.argmax(xp.astype(xp.reshape(~good, (-1,)), xp.int32)))
    numbers_of_cell = xp.reshape(value, (*[math.prod(good.shape)], -1))[cell, ...]
    shown = ", ".join(f"{float(numbers_of_cell[i]):g}" for i in range(numbers_of_cell.shape[0]))
    raise ValueError(f"{name} must {rule}, got {shown} for cell {cell % good.shape[-1]}")
