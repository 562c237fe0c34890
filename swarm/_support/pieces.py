"""Arrays in pieces along their first axis, with which torch's compiler does a decision in one pass.

Its loops over (nodes, cells) write every intermediate result to memory; over one node after the other they
keep it in a register, which is several times as fast.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from typing import Any

Array = Any


class Pieces:
    """An array, or the pieces of one along its first axis; what is not in pieces goes with every piece."""

    def __init__(self, content: Array | tuple[Pieces, ...]) -> None:
        self.content = content

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of pieces."""
        return (len(self.content),)

    def __getitem__(self, key: tuple[Any, ...]) -> Pieces:
        """As of the array; a key must end in `...`."""
        first, *rest = key
        if first is Ellipsis:
            return self
        chosen = self.content[first]
        if isinstance(first, slice):
            return Pieces(tuple(piece[tuple(rest)] for piece in chosen))
        return chosen[tuple(rest)]

    def __add__(self, other: Pieces) -> Pieces:
        return _piece_by_piece(operator.add, self, other)

    def __sub__(self, other: Pieces | float) -> Pieces:
        return _piece_by_piece(operator.sub, self, other)

    def __mul__(self, other: Pieces) -> Pieces:
        return _piece_by_piece(operator.mul, self, other)

    def each(self, function: Callable[[Array], Array]) -> Pieces:
        """`function` of each array."""
        if isinstance(self.content, tuple):
            return Pieces(tuple(piece.each(function) for piece in self.content))
        return Pieces(function(self.content))


class Functions:
    """Functions of an array library for arrays in pieces."""

    def __init__(self, namespace: Any) -> None:
        self.namespace = namespace

    def sin(self, angle: Pieces) -> Pieces:
        """Sine."""
        return angle.each(self.namespace.sin)

    def cos(self, angle: Pieces) -> Pieces:
        """Cosine."""
        return angle.each(self.namespace.cos)


def in_pieces(array: Array, axes: int) -> Pieces:
    """`array` in pieces along its first `axes` axes."""
    if axes == 0:
        return Pieces(array)
    return Pieces(tuple(in_pieces(array[i, ...], axes - 1) for i in range(array.shape[0])))


def _piece_by_piece(function: Callable[[Any, Any], Any], one: Pieces, other: Pieces | float) -> Pieces:
    left, right = one.content, other.content if isinstance(other, Pieces) else other
    pairs: Iterable[tuple[Any, Any]]
    if isinstance(left, tuple) and isinstance(right, tuple):
        pairs = zip(left, right, strict=True)
    elif isinstance(left, tuple):
        pairs = ((piece, other) for piece in left)
    elif isinstance(right, tuple):
        pairs = ((one, piece) for piece in right)
    else:
        return Pieces(function(left, right))
    return Pieces(tuple(_piece_by_piece(function, *pair) for pair in pairs))
