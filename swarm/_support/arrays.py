"""What the world needs of any array library beyond the array API."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from array_api_compat import array_namespace

from swarm._support.compiler import Every, Functions, Pieces, compiling

Array = Any

_TORCH: list[Any] = []  # its functions, once they are asked for


def namespace(array: Array) -> Any:
    """The functions for `array`'s library, under the names of the array API.

    Quick for NumPy and torch, where looking them up takes longer than most of them do.
    """
    if isinstance(array, np.ndarray):
        return np
    if type(array).__module__ == "torch":
        if not _TORCH:
            from array_api_compat import torch

            _TORCH.append(torch)
        return _TORCH[0]
    if isinstance(array, Pieces):
        return Functions(namespace(array.pieces[0]))
    return array_namespace(array)


def is_torch(array: Array) -> bool:
    return type(array).__module__ == "torch"


def is_numpy_or_torch(array: Array) -> bool:
    """Whether how much is computed may depend on the data of `array`."""
    return isinstance(array, np.ndarray) or is_torch(array)


def as_array(values: np.ndarray, like: Array, *, dtype: Any = None) -> Array:
    """`values` in the array library, on the device and (floats) with the dtype of `like`."""
    xp = namespace(like)
    chosen = dtype if dtype is not None else like.dtype
    try:
        return xp.asarray(values, dtype=chosen, device=like.device)
    except (AttributeError, TypeError):  # a tracer has no device
        return xp.asarray(values, dtype=chosen)


def moment(time: Any, like: Array) -> Array:
    """A time (...) in the library and with the dtype of `like`; a number becomes an array ()."""
    if hasattr(time, "dtype") and not isinstance(time, np.generic):
        return namespace(like).astype(time, like.dtype, copy=False)
    return as_array(np.asarray(time), like)


def kept_for(like: Array, held: dict[Any, Any], make: Callable[[], Any]) -> Any:
    """What `make` makes in the library, dtype and device of `like`, made once and `held`.

    Of jax it is made anew: a tracer must not outlive its trace.
    """
    if not is_numpy_or_torch(like):
        return make()
    key = type(like).__module__, like.dtype, str(like.device)
    if key not in held:
        held[key] = make()
    return held[key]


def join(*parts: Array) -> Array:
    """Arrays (...) side by side along a new last axis (..., parts).

    Of torch tensors each part stays in one piece of memory: compiled loops crawl over interleaved ones.
    """
    first = parts[0]
    if isinstance(first, np.ndarray):
        if len(parts) == 2 and first.dtype == parts[1].dtype:
            joined = np.empty((*first.shape, 2), first.dtype)  # the quickest way for two
            joined[..., 0], joined[..., 1] = parts
            return joined
        if len(parts) < 5 and all(part.dtype == first.dtype for part in parts):  # and for few
            joined = np.empty((*first.shape, len(parts)), first.dtype)
            for number, part in enumerate(parts):
                joined[..., number] = part
            return joined
    xp = namespace(first)
    if is_torch(parts[0]):
        return xp.moveaxis(xp.stack(parts), 0, -1)
    return xp.concat([part[..., None] for part in parts], axis=-1)


def stacked(like: Any, arrays: Sequence[Array]) -> Any:
    """Arrays side by side along a new first axis, in pieces where `like` is."""
    return Pieces(tuple(arrays)) if isinstance(like, Pieces) else namespace(arrays[0]).stack(list(arrays))


def look_up(table: Array, index: Array) -> Array:
    """`table[..., index]` for whole-number arrays of any shape."""
    xp = namespace(table)
    if index.ndim == 1:
        return xp.take(table, index, axis=-1)
    taken = xp.take(table, xp.reshape(index, (-1,)), axis=-1)
    return xp.reshape(taken, (*table.shape[:-1], *index.shape))


def added_up(values: Array, index: Array, size: int) -> Array:
    """Sums (..., size) of the `values` (..., k) whose whole-number `index` (..., k) is the same.

    Values are added in their order, so that the same call gives the same bits (on a GPU it may not).
    """
    xp = namespace(values)
    if is_torch(values):
        sums = values.new_zeros((*values.shape[:-1], size))
        return sums.scatter_add(-1, index.broadcast_to(values.shape), values)
    if not isinstance(values, np.ndarray) and not hasattr(values, "at"):  # no library's own way is known
        chosen = index[..., None] == as_array(np.arange(size), index)
        return (values[..., None, :] @ xp.astype(chosen, values.dtype))[..., 0, :]
    rows = math.prod(values.shape[:-1])
    row = as_array(np.arange(rows).reshape(*values.shape[:-1], 1), index)
    flat, places = xp.reshape(values, (-1,)), xp.reshape(index + size * row, (-1,))
    if isinstance(values, np.ndarray):
        sums = np.bincount(places, flat, rows * size).astype(values.dtype, copy=False)
    else:  # jax
        sums = xp.zeros(rows * size, dtype=values.dtype).at[places].add(flat)
    return xp.reshape(sums, (*values.shape[:-1], size))


def outer(table: Array, array: Array) -> Array:
    """Products (rows, columns, ...) of the numbers of a table (rows, columns) with `array` (...)."""
    if isinstance(table, Pieces):
        return table * Every(array)
    return namespace(table).reshape(table, (*table.shape, *(1,) * array.ndim)) * array


def where_chosen(mask: Array, new: Array, old: Array) -> Array:
    """`new` (rows, ...) in the rows that a mask (rows,) chooses, `old` in the others."""
    return namespace(old).where(mask.reshape(-1, *(1,) * (old.ndim - 1)), new, old)


def replaced(array: Array, row: Array, values: Array) -> Array:
    """A copy of `array` (..., rows) with other `values` (..., n) in some rows (n,)."""
    if hasattr(array, "at"):  # jax
        return array.at[..., row].set(values)
    copy = array.copy() if isinstance(array, np.ndarray) else array.clone()
    copy[..., row] = values
    return copy


def polynomial(coefficients: Sequence[float], x: Array) -> Array:
    """Σ cᵢ xⁱ (...) by Horner's rule."""
    *lower, last, top = coefficients
    total = top * x + last
    for coefficient in reversed(lower):
        total = total * x + coefficient
    return total


def at_least(numbers: Array, bound: int) -> Array:
    """Whether int32 numbers reach a bound.

    Compiled by torch, it is the sign of a difference: the result of a comparison is written byte by byte
    there, which takes as long as half a decision.
    """
    if not isinstance(numbers, np.ndarray) and compiling(numbers):
        xp = namespace(numbers)
        return xp.astype(((bound - 1 - numbers) >> 31) & 1, xp.uint8).view(xp.bool)
    return numbers >= bound


def nowhere(flags: Array) -> Array:
    """False in the place of every flag."""
    if not isinstance(flags, np.ndarray) and is_torch(flags):
        return flags.new_zeros(()).expand(flags.shape)
    return flags & ~flags
