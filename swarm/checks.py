"""Checks of parameters: an error names the thing, the rule and the value."""

from __future__ import annotations

import difflib
import math
import numbers
import operator
from collections.abc import Iterable, Sequence
from typing import Any


def check_number(name: str, value: Any, *, above: float | None = None, at_least: float | None = None) -> float:
    """Return `value` as a float; raises unless it is a finite real number within the bounds."""
    rule = "a finite number"
    if above is not None:
        rule += f" above {above:g}"
    if at_least is not None:
        rule += f" of at least {at_least:g}"
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise TypeError(f"{name} must be {rule}, got {value!r}")
    number = float(value)
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
    return number


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
    missing = [f"{method}(position)" for method in methods if not callable(getattr(value, method, None))]
    missing += [attribute for attribute in attributes if not hasattr(value, attribute)]
    if missing:
        raise TypeError(f"{name} must have {', '.join(missing)}, got {value!r}")
