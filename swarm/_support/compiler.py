"""What compilers need: arrays in pieces, loops for numba, and code that goes on where there is no compiler.

Compiled loops over (nodes, cells) write every intermediate result to memory; over one node after the other
they keep it in a register, which is several times as fast. So arrays are taken apart while torch compiles.
"""

from __future__ import annotations

import functools
import importlib.util
import operator
import types
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, TypeVar, cast

import numpy as np

Array = Any
F = TypeVar("F", bound=Callable[..., Any])


class Every:
    """An array that goes with every piece of others: the compiler follows no operator of both kinds."""

    def __init__(self, array: Array) -> None:
        self.array = array


class Pieces:
    """An array in pieces along its first axis: arrays, or further pieces."""

    def __init__(self, pieces: tuple[Any, ...]) -> None:
        self.pieces = pieces

    @property
    def shape(self) -> tuple[int, ...]:
        return (len(self.pieces),)

    def __getitem__(self, key: tuple[Any, ...]) -> Any:
        """As of the array; a key must end in `...`."""
        first, *rest = key
        if first is Ellipsis:
            return self
        if isinstance(first, slice):
            return Pieces(tuple(piece[tuple(rest)] for piece in self.pieces[first]))
        return self.pieces[first][tuple(rest)]

    def __add__(self, other: Pieces | Every | float) -> Pieces:
        return _each(operator.add, self, other)

    def __sub__(self, other: Pieces | Every | float) -> Pieces:
        return _each(operator.sub, self, other)

    def __mul__(self, other: Pieces | Every | float) -> Pieces:
        return _each(operator.mul, self, other)


class Functions:
    """Functions of an array library for arrays in pieces."""

    def __init__(self, namespace: Any) -> None:
        self.sin: Callable[[Pieces], Pieces] = lambda angle: _each(namespace.sin, angle)
        self.cos: Callable[[Pieces], Pieces] = lambda angle: _each(namespace.cos, angle)


def unrolled(arrays: tuple[Array, ...], axes: int) -> tuple[Any, ...]:
    """The arrays as they are, or while torch compiles in pieces along their first `axes` axes."""
    return tuple(in_pieces(array, axes) for array in arrays) if compiling(arrays[0]) else arrays


def in_pieces(array: Array, axes: int) -> Any:
    """`array` in pieces along its first `axes` axes."""
    if axes == 0:
        return array
    return Pieces(tuple(in_pieces(array[i, ...], axes - 1) for i in range(array.shape[0])))


def alongside(like: Any, *arrays: Array) -> tuple[Any, ...]:
    """Arrays as they can be computed with `like`, which stands on the left, be it in pieces or not."""
    return tuple(map(Every, arrays)) if isinstance(like, Pieces) else arrays


def by_piece(function: Callable[..., tuple[Array, ...]], *arrays: Any) -> tuple[Any, ...]:
    """What a function of arrays returns, found piece by piece where they are in pieces."""
    if not isinstance(arrays[0], Pieces):
        return function(*arrays)
    columns = zip(*map(function, *(array.pieces for array in arrays)), strict=True)
    return tuple(Pieces(column) for column in columns)


def _each(function: Callable[..., Array], *operands: Any) -> Any:
    count = next((len(each.pieces) for each in operands if isinstance(each, Pieces)), None)
    if count is None:
        return function(*(each.array if isinstance(each, Every) else each for each in operands))
    columns = (each.pieces if isinstance(each, Pieces) else (each,) * count for each in operands)
    return Pieces(tuple(_each(function, *parts) for parts in zip(*columns, strict=True)))


def compiling(array: Array) -> bool:
    """Whether torch is compiling what is done to `array`."""
    if isinstance(array, np.ndarray) or type(array).__module__ != "torch":
        return False
    import torch

    return torch.compiler.is_compiling()


NUMBA = importlib.util.find_spec("numba") is not None
_OUTSIDE: list[Callable[..., Array]] = []  # functions that are called from compiled code as they are


def loops(function: F, **options: Any) -> F:
    """`function`, which numba compiles when it is first called, and keeps for later processes where a folder
    can be written; as it is where numba is not installed. Options are numba's.

    It sees NumPy arrays and numbers alone, and calls nothing but such functions and NumPy's. A module with
    such functions is imported when they are needed: numba takes half a second.
    """
    if not NUMBA:
        return function
    import numba

    compiled = numba.njit(nogil=True, error_model="numpy", **options)(function)
    if hasattr(compiled, "enable_caching"):  # not where NUMBA_DISABLE_JIT leaves it as it is
        with suppress(RuntimeError):  # neither the package nor the user's cache can be written
            compiled.enable_caching()
    return cast(F, compiled)


def inlined(function: F) -> F:
    """As `loops`, but written out where it is called, for what is called often and does little."""
    return loops(function, inline="always")


def loops_on(array: Array) -> bool:
    """Whether `loops` may go over an array: one of NumPy, or a tensor in the processor's memory."""
    module = type(array).__module__
    return isinstance(array, np.ndarray) or (module == "torch" and array.device.type == "cpu")


def outside(function: Callable[..., Array]) -> int:
    """The number by which `call_outside` calls a function whose work depends on data; equal ones share it."""
    if function not in _OUTSIDE:
        _OUTSIDE.append(function)
    return _OUTSIDE.index(function)


def call_outside(number: int, shape: tuple[int, ...], like: Array, *arrays: Array) -> Array:
    """What the function of that `number` returns of the arrays: an array of a shape, with the dtype of
    `like`. While torch compiles, the call alone is compiled; jax calls back to NumPy.
    """
    if type(like).__module__.startswith("jax"):
        return _called_by_jax(number, shape, like, *arrays)
    if isinstance(like, np.ndarray):
        return _OUTSIDE[number](*arrays).astype(like.dtype, copy=False)
    if not compiling(like):
        return _in_numpy(number, like, arrays)
    import torch

    found: Array = torch.ops.chemoswarm.call_outside(number, list(shape), like, list(arrays))
    return found


def _in_numpy(number: int, like: Array, arrays: Sequence[Array]) -> Array:
    """Tensors of the processor are handed on in the same memory, others as copies."""
    import torch

    found = torch.from_numpy(_OUTSIDE[number](*(each.detach().cpu().numpy() for each in arrays)))
    return found.to(like.device, like.dtype)


def _called_by_jax(number: int, shape: tuple[int, ...], like: Array, *arrays: Array) -> Array:
    import jax

    def call(*given: Array) -> np.ndarray:
        return np.asarray(_OUTSIDE[number](*map(np.asarray, given)), like.dtype)

    wanted = jax.ShapeDtypeStruct(shape, like.dtype)
    return jax.pure_callback(call, wanted, *arrays, vmap_method="sequential")


@functools.cache
def _declare_outside() -> None:
    import torch
    from torch import Tensor

    def call(number: int, shape: list[int], like: Tensor, arrays: list[Tensor]) -> Tensor:
        return _in_numpy(number, like, arrays)

    call.__annotations__ = {
        "number": int,
        "shape": list[int],
        "like": Tensor,
        "arrays": list[Tensor],
        "return": Tensor,
    }
    declared = torch.library.custom_op("chemoswarm::call_outside", call, mutates_args=())
    declared.register_fake(lambda number, shape, like, arrays: like.new_empty(shape))


def compiled(function: Callable[..., Any], *first: Any) -> Callable[..., Any]:
    """`function` with its first arguments, compiled by torch; as it is, with one line said, where that fails.

    Every call gives what the same code gives: compiled and plain code may round differently.
    """
    import torch

    _declare_outside()
    # A copy with code of its own: torch counts how often it compiles a code, and gives up after some times.
    own = types.FunctionType(function.__code__.replace(), function.__globals__, function.__name__)
    fast = torch.compile(own, fullgraph=True, dynamic=False)
    chosen: list[Callable[..., Any]] = []

    def call(*further: Any) -> Any:
        arguments = (*first, *further)
        if chosen:
            return chosen[0](*arguments)
        result = function(*arguments)  # fills the tables that the compiled code takes as given
        try:
            result = fast(*arguments)
            chosen.append(fast)
        except Exception as error:  # no compiler, no headers, an unsupported platform: all end here
            reason = (str(error).splitlines() or [""])[0][:120]
            from swarm._support.terminal import tell

            tell(f"torch.compile does not work here, going on without: {type(error).__name__}: {reason}")
            chosen.append(function)
        return result

    return call
