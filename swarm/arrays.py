"""What the world needs of any array library beyond the array API."""

from __future__ import annotations

from typing import Any

import numpy as np
from array_api_compat import array_namespace

Array = Any


def namespace(array: Array) -> Any:
    """The functions for `array`'s library, under the names of the array API.

    Quick for NumPy and torch, where looking them up takes longer than most of them do.
    """
    if isinstance(array, np.ndarray):
        return np
    if type(array).__module__ == "torch":
        from array_api_compat import torch as torch_namespace

        return torch_namespace
    return array_namespace(array)


def as_array(values: np.ndarray, like: Array, *, dtype: Any = None) -> Array:
    """`values` in the array library, on the device and (floats) with the dtype of `like`."""
    xp = namespace(like)
    chosen = dtype if dtype is not None else like.dtype
    try:
        return xp.asarray(values, dtype=chosen, device=like.device)
    except (AttributeError, TypeError):  # a tracer has no device
        return xp.asarray(values, dtype=chosen)


def join(*parts: Array) -> Array:
    """Arrays (...) side by side along a new last axis (..., parts)."""
    return namespace(parts[0]).concat([part[..., None] for part in parts], axis=-1)
