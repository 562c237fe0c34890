"""Loops over numbers, which numba compiles where it is installed (`pip install "chemoswarm[loops]"`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

try:
    import numba
except ImportError:
    numba = None


def loops(function: F) -> F:
    """`function`, compiled when it is first called, for later processes too; as it is without numba.

    It sees NumPy arrays alone, and calls nothing but such functions and NumPy's.
    """
    if numba is None:
        return function
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
