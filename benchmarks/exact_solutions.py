"""What the physics is off from exact solutions: a table of measured errors, each with its bound.

A law is a function that returns the error it measures; `tests/physics/test_exact.py` holds each to its bound.
`python -m benchmarks exact_solutions --out docs/benchmarks` writes the table.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any, NamedTuple

SUBJECTS = ("exact_drift", "exact_medium", "exact_pairs", "exact_crowds")  # modules here that state laws


class Law(NamedTuple):
    """An exact solution, and how far from it we are."""

    name: str
    unit: str  # what errors are relative to, or measured in
    bound: float
    error: Callable[[], float]


LAWS: list[Law] = []


def law(name: str, unit: str, bound: float) -> Callable[[Callable[[], float]], Callable[[], float]]:
    """Decorator of a function that measures an error which must not pass a bound."""

    def keep(error: Callable[[], float]) -> Callable[[], float]:
        LAWS.append(Law(name, unit, bound, error))
        return error

    return keep


def laws() -> list[Law]:
    """Every law of every subject."""
    for subject in SUBJECTS:
        importlib.import_module(f"benchmarks.{subject}")
    return LAWS


def run() -> list[dict[str, Any]]:
    """Rows of the table."""
    return [{"law": law.name, "error": law.error(), "at most": law.bound, "of": law.unit} for law in laws()]
