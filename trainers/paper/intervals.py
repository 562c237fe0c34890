"""Estimates over training seeds and test cells, with bootstrap intervals and the least favourable seed.

Both are resampled: seeds with replacement, separately for every sample, and cells with replacement, the same
for all samples, because every policy is tested on the same cells.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from swarm._support import streams
from swarm.population.statistics import RESAMPLES

LEVEL = 95.0  # [percent] of an interval

# a sample (seeds, cells), weights of its seeds (draws, seeds) and of its cells (draws, cells) -> (draws,)
Summary = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class Estimate(NamedTuple):
    """A number and how sure it is."""

    value: float
    interval: tuple[float, float] | None  # percentile bootstrap; None for one seed and one cell
    lowest: float  # over every choice of one seed from each sample
    highest: float


def mean(values: np.ndarray, seeds: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Mean over seeds and cells."""
    return np.sum((seeds @ values) * cells, axis=-1)


def spread(values: np.ndarray, seeds: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Standard deviation over the cells, averaged over seeds."""
    centred = values - values.mean(axis=1, keepdims=True)
    variance = cells @ (centred**2).T - (cells @ centred.T) ** 2
    return np.sum(seeds * np.sqrt(np.maximum(variance, 0.0)), axis=-1)


def off_gradient(drift: np.ndarray, seeds: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Angle between the cells' mean drift and the gradient, without its sign, averaged over seeds [degrees].

    `drift` is complex: its real part along the gradient, its imaginary part to the left of it.
    """
    return np.sum(seeds * np.abs(np.degrees(np.angle(cells @ drift.T))), axis=-1)


def estimate(
    combine: Callable[..., np.ndarray],
    *samples: np.ndarray,
    summary: Summary = mean,
    seed: int = 0,
) -> Estimate:
    """`combine` of each sample's summary; samples are (seeds, cells), with one number of cells."""
    cells = samples[0].shape[1]
    if any(sample.ndim != 2 or sample.shape[1] != cells for sample in samples):
        shapes = ", ".join(str(sample.shape) for sample in samples)
        raise ValueError(f"samples must be (seeds, cells) with the same cells, got the shapes {shapes}")

    def summed(sample: np.ndarray) -> np.ndarray:
        return summary(sample, *(np.full((1, length), 1 / length) for length in sample.shape))

    value = float(combine(*map(summed, samples))[0])
    each = [[summed(row[None]) for row in sample] for sample in samples]
    choices = [float(combine(*choice)[0]) for choice in itertools.product(*each)]
    interval = None
    if cells > 1 or any(len(sample) > 1 for sample in samples):
        drawn = [
            summary(sample, _weights(seed, place, len(sample)), _weights(seed, 0, cells))
            for place, sample in enumerate(samples, start=1)
        ]
        rest = (100 - LEVEL) / 2
        low, high = np.percentile(combine(*drawn), [rest, 100 - rest])
        interval = (float(low), float(high))
    return Estimate(value, interval, min(choices), max(choices))


@functools.lru_cache(maxsize=16)
def _weights(seed: int, place: int, length: int) -> np.ndarray:
    """Weights (draws, length) of `length` things drawn with replacement."""
    if length == 1:
        return np.ones((1, 1))
    generator = streams.generator("test", "bootstrap", seed, place)
    return generator.multinomial(length, np.full(length, 1 / length), size=RESAMPLES) / length


def median_place(values: Sequence[float]) -> int:
    """Place of the middle value; of two, the lower one."""
    return int(np.argsort(values, kind="stable")[(len(values) - 1) // 2])
