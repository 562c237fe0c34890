"""Random numbers by counter: every draw is named by its population, purpose, seed, episode and cell.

Row i of a draw belongs to cell i and is the same however many rows are drawn (NumPy fills them in order from
one Philox generator), so a cell's life depends neither on how many others there are nor on what is drawn
elsewhere.
"""

from __future__ import annotations

import operator
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
