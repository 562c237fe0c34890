"""Random numbers by counter: every draw is named by its population, purpose, seed, episode and cell.

Row i of a draw belongs to cell i and is the same however many rows are drawn (NumPy fills them in order from
one Philox generator for each `BLOCK` cells), so a cell's life depends neither on how many others there are
nor on what is drawn elsewhere, and a part of a large population is drawn without the rest.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

Population = Literal["training", "validation", "test"]
Purpose = Literal[
    "start",
    "past",
    "noise",
    "policy",
    "exploration",
    "replay",
    "network",
    "bootstrap",
    "spread",
    "bindings",
    "records",
]

BLOCK = 2**16  # cells that share a generator

_POPULATIONS = {name: number for number, name in enumerate(get_args(Population))}
_PURPOSES = {name: number for number, name in enumerate(get_args(Purpose))}


def check_seed(seed: int) -> int:
    """Return `seed` as a Python int; raises TypeError or ValueError unless it is whole and in [0, 2**64), so
    that results can store it.
    """
    try:
        number = operator.index(seed)
    except TypeError:
        raise TypeError(f"seed must be a whole number, got {seed!r}") from None
    if isinstance(seed, bool):
        raise TypeError(f"seed must be a whole number, got {seed!r}")
    if number < 0:
        raise ValueError(f"seed must not be negative, got {number}")
    if number >= 2**64:
        raise ValueError(f"seed must be below 2**64, got {number}")
    return number


def entropy() -> int:
    """A seed from the operating system; the global generators stay as they are."""
    return int(np.random.SeedSequence().generate_state(1, np.uint64)[0])


def generator(population: Population, purpose: Purpose, seed: int, *index: int) -> np.random.Generator:
    """The generator of one draw; `index` (episode, attempt, block, …) separates draws of one purpose."""
    key = (_POPULATIONS[population], _PURPOSES[purpose], *index)
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=key)))


def by_cell(
    draw: Callable[[np.random.Generator, int], np.ndarray],
    cells: int,
    population: Population,
    purpose: Purpose,
    seed: int,
    *index: int,
    first: int = 0,
) -> np.ndarray:
    """Rows (cells, ...) of the cells from the `first` on, of each block by `draw(generator, rows)`.

    The first block has the `generator` of the same name; block b of the cells that follow adds (0, b).
    """
    parts = []
    for block in range(first // BLOCK, -(-(first + cells) // BLOCK)):
        begin, rows = max(first - block * BLOCK, 0), min(first + cells - block * BLOCK, BLOCK)
        key = (*index, 0, block) if block else index
        parts.append(draw(generator(population, purpose, seed, *key), rows)[begin:])
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def integer_seed(population: Population, purpose: Purpose, seed: int, *index: int) -> int:
    """A 63-bit seed of one purpose, for generators of other libraries."""
    return int(generator(population, purpose, seed, *index).integers(2**63 - 1))


def divided(uniform: np.ndarray, number: int) -> np.ndarray:
    """The number (...) in [0, 1) that stands at a place of the sequence to which a number (...) in [0, 1)
    leads: SplitMix64 (Steele, Lea and Flood, OOPSLA 2014) of its 53 bits.
    """
    step = (number + 1) * 0x9E3779B97F4A7C15 % 2**64
    bits = (np.asarray(uniform, np.float64) * 2.0**53).astype(np.uint64) + np.uint64(step)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        bits = (bits ^ (bits >> np.uint64(shift))) * np.uint64(factor)
    return ((bits ^ (bits >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53
