"""Tallies: a population summed up part by part, so that its statistics need no more memory than a part's.

Parts are merged in their order, which fixes every bit. Moments merge by the formulas of Chan, Golub & LeVeque
(1979, Stanford STAN-CS-79-773). Quantiles are read off `SAMPLE` gains of evenly spaced rank of each part,
which puts a quantile's rank off by at most half their spacing, 1/2048 of the cells, and 1 of each part's:
no coin is tossed as in a KLL sketch, and the bound is one of rank, as a t-digest has none.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm.optimal.physical_limit import Bounds, extrapolated
from swarm.population.results import RIVAL
from swarm.population.statistics import fraction_of_limit, half_width, independent, times_to_egg

if TYPE_CHECKING:
    import xarray as xr

SAMPLE = 1024  # gains of each part and policy that are kept
QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)


class Moments(NamedTuple):
    """Numbers of each policy, summed up."""

    number: int
    mean: np.ndarray  # (policies,)
    squares: np.ndarray  # (policies,) Σ (x − mean)²
    low: np.ndarray  # (policies,)
    high: np.ndarray  # (policies,)

    @classmethod
    def of(cls, values: np.ndarray) -> Moments:
        """Of numbers (policies, n)."""
        mean = values.mean(axis=1)
        squares = ((values - mean[:, None]) ** 2).sum(axis=1)
        return cls(values.shape[1], mean, squares, values.min(axis=1), values.max(axis=1))

    def merged(self, other: Moments) -> Moments:
        """With those of further numbers."""
        number, step = self.number + other.number, other.mean - self.mean
        return Moments(
            number,
            self.mean + step * (other.number / number),
            self.squares + other.squares + step**2 * (self.number * other.number / number),
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
        )

    def interval(self, policy: int) -> list[float] | None:
        """95% interval [low, high] of the mean of independent numbers; None of a single one."""
        if self.number < 2:
            return None
        freedom, mean = self.number - 1, float(self.mean[policy])
        half = float(half_width([(self.squares[policy] / freedom / self.number, freedom)], []))
        return [mean - half, mean + half]


class Tally(NamedTuple):
    """The lives of a part of a population, summed up."""

    gain: Moments  # of all cells
    ahead: Moments  # of their differences to greedy
    units: Moments  # of the gains of what is independent: cells, or worlds
    units_ahead: Moments
    wins: np.ndarray  # (policies,) cells that gain more than under greedy
    arrived: np.ndarray  # (policies,)
    time_to_egg: np.ndarray  # (policies,) mean of those that arrived; NaN where none did
    sample: np.ndarray  # (policies, n) gains of evenly spaced rank, rising
    weights: np.ndarray  # (n,) cells that each of them stands for
    limits: dict[str, float]  # mean largest gain by grid; empty where no limit is known

    def merged(self, other: Tally) -> Tally:
        """With the tally of the part that comes next."""
        part = other.gain.number / (self.gain.number + other.gain.number)
        return Tally(
            self.gain.merged(other.gain),
            self.ahead.merged(other.ahead),
            self.units.merged(other.units),
            self.units_ahead.merged(other.units_ahead),
            self.wins + other.wins,
            self.arrived + other.arrived,
            _mean_of(self.arrived, self.time_to_egg, other.arrived, other.time_to_egg),
            np.concatenate([self.sample, other.sample], axis=1),
            np.concatenate([self.weights, other.weights]),
            {name: mean + (other.limits[name] - mean) * part for name, mean in self.limits.items()},
        )


def tally(results: xr.Dataset, bounds: Bounds | None, *, coupled: bool) -> Tally:
    """The tally of a part's results."""
    gains = results["gain"].transpose("policy", ..., "cell").values  # (policies, [worlds,] cells)
    gains = gains.reshape(len(gains), -1, gains.shape[-1])
    ahead = gains - gains[results["policy"].values.tolist().index(RIVAL)]
    of_units = [
        Moments.of(np.stack([independent(each, coupled) for each in values]))
        for values in (gains, ahead)
        if coupled
    ]
    gains, ahead = (each.reshape(len(each), -1) for each in (gains, ahead))
    of_all = [Moments.of(gains), Moments.of(ahead)]
    of_units = of_units or of_all
    kept = min(SAMPLE, gains.shape[1])
    ranks = ((np.arange(kept) + 0.5) * (gains.shape[1] / kept)).astype(int)
    return Tally(
        of_all[0],
        of_all[1],
        of_units[0],
        of_units[1],
        (ahead > 0).sum(axis=1),
        *_arrivals(results),
        np.sort(gains, axis=1)[:, ranks],
        np.full(kept, gains.shape[1] / kept),
        {}
        if bounds is None
        else bounds.means(results["start_position"].values, results["start_heading"].values),
    )


def _arrivals(results: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """How many cells (policies,) came to the egg, and the mean time (policies,) that these took."""
    if not results["arrived"].values.any():
        return np.zeros(results.sizes["policy"], int), np.full(results.sizes["policy"], np.nan)
    times = times_to_egg(results).values.reshape(results.sizes["policy"], -1)
    came = np.isfinite(times)
    means = [row[there].mean() if there.any() else np.nan for row, there in zip(times, came, strict=True)]
    return came.sum(axis=1), np.array(means)


def _mean_of(number: np.ndarray, mean: np.ndarray, further: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The mean of both parts, which is NaN where there are none."""
    weighed = np.where(number > 0, number * mean, 0.0) + np.where(further > 0, further * other, 0.0)
    total = number + further
    return np.divide(weighed, total, out=np.full(len(mean), np.nan), where=total > 0)


def merged(tallies: Sequence[Tally]) -> Tally:
    """The tally of all parts, in their order."""
    return functools.reduce(Tally.merged, tallies)


def limit_of(found: Tally) -> float | None:
    """The physical limit of the cells that were tallied; None where there is none."""
    return extrapolated(list(found.limits.values()))[0] if found.limits else None


def statistics_of(found: Tally, policies: Sequence[str]) -> dict[str, dict[str, Any]]:
    """What `statistics` finds, by policy, and `quantiles` of the gains."""
    limit = limit_of(found)
    return {
        name: {
            "mean": float(found.gain.mean[i]),
            "std": float(np.sqrt(found.gain.squares[i] / found.gain.number)),
            "min": float(found.gain.low[i]),
            "max": float(found.gain.high[i]),
            "ci95": found.units.interval(i),
            "fraction_of_limit": fraction_of_limit(float(found.gain.mean[i]), limit),
            "difference_to_greedy": {
                "mean": float(found.ahead.mean[i]),
                "ci95": found.units_ahead.interval(i),
            },
            "wins": int(found.wins[i]),
            "arrived": int(found.arrived[i]),
            "time_to_egg": float(found.time_to_egg[i]) if found.arrived[i] else None,
            "quantiles": _quantiles(found.sample[i], found.weights),
        }
        for i, name in enumerate(policies)
    }


def _quantiles(sample: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    order = np.argsort(sample, kind="stable")
    ranks = np.cumsum(weights[order]) - 0.5 * weights[order]
    places = np.searchsorted(ranks, np.array(QUANTILES) * weights.sum())
    return {
        f"{part:g}": float(sample[order[min(place, len(order) - 1)]])
        for part, place in zip(QUANTILES, places.tolist(), strict=True)
    }
