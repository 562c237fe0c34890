"""Statistics of population tests: spread, comparison with greedy and the limit, and confidence intervals.

Intervals are of means over training seeds and test cells, which are crossed: every seed's policy is tested on
the same cells, so a value is μ + a(seed) + b(cell) + e(seed, cell), and the mean of S × C of them has the
variance σ_a²/S + σ_b²/C + σ_e²/(S C). The variance of the seeds' means over S and that of the cells' means
over C both hold the last term, which is therefore taken off once. The sum has Student's t, with degrees of
freedom by Satterthwaite (1946). `tests/population/coverage.py` measures how often the intervals hold the
truth.

A population is summed up part by part in a tally, so that its statistics need no more memory than a part's.
Parts are merged in their order, which fixes every bit. Moments merge by the formulas of Chan, Golub & LeVeque
(1979, Stanford STAN-CS-79-773). Quantiles are read off `SAMPLE` gains of evenly spaced rank of each part,
which puts a quantile's rank off by at most half their spacing, 1/2048 of the cells, and 1 of each part's:
no coin is tossed as in a KLL sketch, and the bound is one of rank, as a t-digest has none.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm.optimal.physical_limit import Bounds, extrapolated
from swarm.population.results import RIVAL

if TYPE_CHECKING:
    import xarray as xr

LEVEL = 0.95  # of every interval
SAMPLE = 1024  # gains of each part and policy that are kept
QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)


def statistics(results: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Per policy: `mean`, `std`, `min`, `max` and `quantiles` of the cells' gains, `ci95` of the mean,
    `fraction_of_limit`, `difference_to_greedy` (`mean`, `ci95`; cell by cell), `wins`, the number of cells
    that beat greedy, `arrived`, of those that reached the egg, and `time_to_egg`, their mean time, or None.

    The intervals are Student's, 95%, over the cells of all worlds; over the worlds where the cells of one are
    coupled and so not independent; None with a single one. `std` is over the cells (divided by their number).
    `fraction_of_limit` is None without a limit or with none above 0. Results of a population that was tested
    in blocks hold theirs.
    """
    try:
        stored = json.loads(results.attrs["statistics"])
        cells = results["gain"][0].size if "gain" in results else stored["cells"]
        if (stored["cells"], [*stored["policies"]]) == (cells, results["policy"].values.tolist()):
            return stored["policies"]
    except (KeyError, TypeError, ValueError, RecursionError):  # there are none
        pass
    found = tally(results, None, coupled=bool(results.attrs.get("coupled")))
    return found.statistics(results["policy"].values.tolist(), results.attrs.get("limit"))


class Moments(NamedTuple):
    """Numbers of each policy, summed up."""

    number: int
    mean: np.ndarray  # (..., policies)
    squares: np.ndarray  # (..., policies) Σ (x − mean)²
    low: np.ndarray  # (..., policies)
    high: np.ndarray  # (..., policies)

    @classmethod
    def of(cls, values: np.ndarray) -> Moments:
        """Of numbers (..., policies, n)."""
        mean = values.mean(axis=-1)
        squares = ((values - mean[..., None]) ** 2).sum(axis=-1)
        return cls(values.shape[-1], mean, squares, values.min(axis=-1), values.max(axis=-1))

    def merged(self, other: Moments) -> Moments:
        number, step = self.number + other.number, other.mean - self.mean
        return Moments(
            number,
            self.mean + step * (other.number / number),
            self.squares + other.squares + step**2 * (self.number * other.number / number),
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
        )

    def interval(self, *policy: int) -> list[float] | None:
        """95% interval [low, high] of the mean of independent numbers; None of a single one."""
        if self.number < 2:
            return None
        freedom, mean = self.number - 1, float(self.mean[policy])
        half = float(half_width([(self.squares[policy] / freedom / self.number, freedom)], []))
        return [mean - half, mean + half]


class Tally(NamedTuple):
    """The lives of a part of a population, summed up."""

    cells: Moments  # (2, policies): gains of all cells, and their differences to greedy
    units: Moments  # the same of what is independent: cells, or the means of worlds
    wins: np.ndarray  # (policies,) cells that gain more than under greedy
    arrived: np.ndarray  # (policies,)
    time: np.ndarray  # (policies,) to the egg, of all that arrived together
    sample: np.ndarray  # (policies, n) gains of evenly spaced rank, rising
    weights: np.ndarray  # (n,) cells that each of them stands for
    limits: dict[str, float]  # mean largest gain by grid; empty where no limit is known

    def merged(self, other: Tally) -> Tally:
        """With the tally of the part that comes next."""
        part = other.cells.number / (self.cells.number + other.cells.number)
        return Tally(
            self.cells.merged(other.cells),
            self.units.merged(other.units),
            self.wins + other.wins,
            self.arrived + other.arrived,
            self.time + other.time,
            np.concatenate([self.sample, other.sample], axis=1),
            np.concatenate([self.weights, other.weights]),
            {name: mean + (other.limits[name] - mean) * part for name, mean in self.limits.items()},
        )

    @property
    def limit(self) -> float | None:
        """The physical limit of the cells; None where there is none."""
        return extrapolated(list(self.limits.values()))[0] if self.limits else None

    def statistics(self, policies: Sequence[str], limit: float | None) -> dict[str, dict[str, Any]]:
        """What [`statistics`][swarm.population.statistics.statistics] finds, by policy."""
        (mean, ahead), squares = self.cells.mean.tolist(), self.cells.squares[0]
        return {
            name: {
                "mean": mean[i],
                "std": float(np.sqrt(squares[i] / self.cells.number)),
                "min": float(self.cells.low[0, i]),
                "max": float(self.cells.high[0, i]),
                "ci95": self.units.interval(0, i),
                "fraction_of_limit": fraction_of_limit(mean[i], limit),
                "difference_to_greedy": {"mean": ahead[i], "ci95": self.units.interval(1, i)},
                "wins": int(self.wins[i]),
                "arrived": int(self.arrived[i]),
                "time_to_egg": float(self.time[i] / self.arrived[i]) if self.arrived[i] else None,
                "quantiles": _quantiles(self.sample[i], self.weights),
            }
            for i, name in enumerate(policies)
        }


def tally(results: xr.Dataset, bounds: Bounds | None, *, coupled: bool) -> Tally:
    gains = results["gain"].transpose("policy", ..., "cell").values  # (policies, [worlds,] cells)
    both = np.stack([gains, gains - gains[results["policy"].values.tolist().index(RIVAL)]])
    both = both.reshape(2, len(gains), -1, gains.shape[-1])
    cells = both.reshape(2, len(gains), -1)
    number, moments = cells.shape[-1], Moments.of(cells)
    kept = min(SAMPLE, number)
    ranks = ((np.arange(kept) + 0.5) * (number / kept)).astype(int)
    came = time = np.zeros(len(gains), int)
    if "arrived" in results and results["arrived"].values.any():
        times = times_to_egg(results).values.reshape(len(gains), -1)
        there = np.isfinite(times)
        came, time = (
            there.sum(axis=1),
            np.array([row[one].sum() for row, one in zip(times, there, strict=True)]),
        )
    starts = "start_position", "start_heading"
    return Tally(
        moments,
        Moments.of(both.mean(axis=-1)) if coupled else moments,
        (cells[1] > 0).sum(axis=1),
        came,
        time,
        np.sort(cells[0], axis=1)[:, ranks],
        np.full(kept, number / kept),
        {} if bounds is None else bounds.means(*(results[name].values for name in starts)),
    )


def _quantiles(sample: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    order = np.argsort(sample, kind="stable")
    ranks = np.cumsum(weights[order]) - 0.5 * weights[order]
    places = np.searchsorted(ranks, np.array(QUANTILES) * weights.sum())
    found = sample[order[np.minimum(places, len(order) - 1)]].tolist()
    return {f"{part:g}": value for part, value in zip(QUANTILES, found, strict=True)}


def times_to_egg(results: xr.Dataset) -> xr.DataArray:
    """The time (policy, [world,] cell) that each cell took to the egg, infinite where it never came."""
    times = results["arrival_time" if "arrival_time" in results else "lifetime"]
    return times.where(results["arrived"], np.inf).transpose("policy", ..., "cell")


def arrivals(results: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Per policy: `arrived`, the number of cells that reached the egg, and of those the `mean` and the
    `median` of the time it took; NaN where none did. Where cells were not kept the median is NaN.
    """
    found = {}
    for name, row in statistics(results).items():
        median, mean = np.nan, row["time_to_egg"]
        if "arrived" in results and row["arrived"]:
            times = times_to_egg(results).sel(policy=name).values
            median = float(np.median(times[np.isfinite(times)]))
        found[name] = {"arrived": row["arrived"], "mean": np.nan if mean is None else mean, "median": median}
    return found


def independent(values: np.ndarray, coupled: bool) -> np.ndarray:
    """Of values (worlds, cells) those that are independent: the worlds' means, or each."""
    return values.mean(axis=-1) if coupled else values.reshape(-1)


def fraction_of_limit(gain: float, limit: float | None) -> float | None:
    """The part of the limit that is gained; None where no limit is known, or none above 0 (short lives)."""
    return None if limit is None or limit <= 0 else gain / limit


def mean_interval(sample: np.ndarray) -> list[float] | None:
    """95% interval [low, high] of the mean of (seeds, cells) or of one policy's (cells,); see `margin`."""
    half = margin(sample)
    return None if half is None else [float(np.mean(sample) - half), float(np.mean(sample) + half)]


def margin(*samples: np.ndarray, weights: Sequence[float] = (1.0,)) -> Any:
    """Half the width (...) of the 95% interval of the weighted sum of the samples' means.

    Samples are (..., seeds, cells), or (cells,) of one policy. Each has seeds of its own; the cells are the
    same for all of them. With one seed only cells vary: that is all there is to a strategy, but says nothing
    of other trainings. None for a single number. Raises ValueError unless samples fit one another and the
    weights.
    """
    values = [np.atleast_2d(np.asarray(sample, np.float64)) for sample in samples]
    if len(weights) != len(values) or len({sample.shape[-1] for sample in values}) > 1:
        shapes = ", ".join(str(sample.shape) for sample in values)
        raise ValueError(f"samples must be {len(weights)}, with the same cells, got the shapes {shapes}")
    added, taken_off, by_cell = [], [], np.zeros(1)
    for weight, sample in zip(weights, values, strict=True):
        n_seeds, n_cells = sample.shape[-2:]
        of_seed, of_cell = weight * sample.mean(axis=-1), weight * sample.mean(axis=-2)
        by_cell = by_cell + of_cell
        if n_seeds > 1:
            added.append(_variance(of_seed))
        if n_seeds > 1 and n_cells > 1:
            mean = of_seed.mean(axis=-1)[..., None, None]
            rest = weight * sample - of_seed[..., None] - of_cell[..., None, :] + mean
            freedom = (n_seeds - 1) * (n_cells - 1)
            taken_off.append((np.sum(rest**2, axis=(-2, -1)) / (freedom * n_seeds * n_cells), freedom))
    added += [_variance(by_cell)] if by_cell.shape[-1] > 1 else []
    return half_width(added, taken_off) if added else None


def share_interval(part: np.ndarray, whole: np.ndarray) -> tuple[float, float, float]:
    """Share Σ part / Σ whole of counts (units,) of independent units, with its 95% interval (low, high).

    The variance is that of the ratio over the units, to first order; with the number of single counts that
    would have the same, and no more than there are, the interval is Clopper and Pearson's (Korn & Graubard
    1998, Survey Methodology 24, 193). So it lies within 0 and 1; where all units are alike, where one takes
    all for instance, each counts once. NaN where nothing is counted, and the interval of a single unit.
    """
    from scipy.special import betaincinv, stdtrit

    total, units = float(np.sum(whole)), len(whole)
    share = float(np.sum(part)) / total if total > 0 else np.nan
    if units < 2 or total == 0:
        return share, np.nan, np.nan
    variance = units / (units - 1) * float(np.sum((part - share * whole) ** 2)) / total**2
    beyond = (1 - LEVEL) / 2
    count = min(total, units)
    if variance > 0:
        wider = stdtrit(max(total - 1, 1), beyond) / stdtrit(units - 1, beyond)
        count = min(total, share * (1 - share) / variance * wider**2)
    ours, others = share * count, (1 - share) * count
    low = float(betaincinv(ours, others + 1, beyond)) if ours > 0 else 0.0
    high = float(betaincinv(ours + 1, others, 1 - beyond)) if others > 0 else 1.0
    return share, low, high


def _variance(means: np.ndarray) -> tuple[Any, int]:
    """Variance (...) of the mean of independent numbers (..., n), and its degrees of freedom."""
    length = means.shape[-1]
    return means.var(axis=-1, ddof=1) / length, length - 1


def half_width(added: list[tuple[Any, int]], taken_off: list[tuple[Any, int]]) -> Any:
    """Half the width of the 95% interval of a mean whose variance is a sum of parts, each with its degrees of
    freedom.
    """
    from scipy.special import stdtrit

    variance = sum(each for each, _ in added) - sum(each for each, _ in taken_off)
    largest = np.max(np.stack(np.broadcast_arrays(*(each for each, _ in added))), axis=0)
    variance = np.where(variance > 0, variance, largest)  # less than nothing is chance
    doubt = np.asarray(sum(each**2 / freedom for each, freedom in added + taken_off))
    freedom = np.divide(variance**2, doubt, out=np.ones_like(doubt), where=doubt > 0)
    return stdtrit(np.maximum(freedom, 1.0), (1 + LEVEL) / 2) * np.sqrt(variance)
