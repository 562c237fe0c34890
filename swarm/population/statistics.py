"""Statistics of population tests: spread, comparison with greedy and the limit, and confidence intervals.

Intervals are of means over training seeds and test cells, which are crossed: every seed's policy is tested on
the same cells, so a value is μ + a(seed) + b(cell) + e(seed, cell), and the mean of S × C of them has the
variance σ_a²/S + σ_b²/C + σ_e²/(S C). The variance of the seeds' means over S and that of the cells' means
over C both hold the last term, which is therefore taken off once. The sum has Student's t, with degrees of
freedom by Satterthwaite (1946). `tests/population/coverage.py` measures how often the intervals hold the
truth.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm.population.results import RIVAL

if TYPE_CHECKING:
    import xarray as xr

LEVEL = 0.95  # of every interval


def statistics(results: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Per policy: `mean`, `std`, `min`, `max` of the cells' gains, `ci95` of the mean, `fraction_of_limit`,
    `difference_to_greedy` (`mean`, `ci95`; cell by cell), `wins`, the number of cells that beat greedy, and
    `arrived`, of those that reached the egg.

    The intervals are Student's, 95%, over the cells of all worlds; over the worlds where the cells of one are
    coupled and so not independent; None with a single one. `std` is over the cells (divided by their number).
    `fraction_of_limit` is None without a limit or with none above 0. Results of a population that was tested
    in blocks hold theirs, with `quantiles` of the gain.
    """
    if (known := _stored(results)) is not None:
        return known
    gains = results["gain"].transpose("policy", ..., "cell").values  # (policies, [worlds,] cells)
    ahead = gains - results["gain"].sel(policy=RIVAL).values
    coupled = bool(results.attrs.get("coupled"))
    gains, ahead = (each.reshape(len(each), -1, each.shape[-1]) for each in (gains, ahead))
    limit, arrived = results.attrs.get("limit"), np.zeros(len(gains), int)
    if "arrived" in results:
        arrived = results["arrived"].transpose("policy", ...).values.reshape(len(gains), -1).sum(axis=1)
    return {
        str(name): {
            "mean": float(gains[i].mean()),
            "std": float(gains[i].std()),
            "min": float(gains[i].min()),
            "max": float(gains[i].max()),
            "ci95": mean_interval(independent(gains[i], coupled)),
            "fraction_of_limit": fraction_of_limit(float(gains[i].mean()), limit),
            "difference_to_greedy": {
                "mean": float(ahead[i].mean()),
                "ci95": mean_interval(independent(ahead[i], coupled)),
            },
            "wins": int(np.sum(ahead[i] > 0)),
            "arrived": int(arrived[i]),
        }
        for i, name in enumerate(results["policy"].values)
    }


def _stored(results: xr.Dataset) -> dict[str, dict[str, Any]] | None:
    """The statistics that results hold of themselves; None where there are none, or of other cells."""
    try:
        stored = json.loads(results.attrs["statistics"])
        cells = results["gain"][0].size if "gain" in results else stored["cells"]
        whole = (stored["cells"], [*stored["policies"]]) == (cells, results["policy"].values.tolist())
        return stored["policies"] if whole else None
    except (KeyError, TypeError, ValueError, RecursionError):
        return None


def times_to_egg(results: xr.Dataset) -> xr.DataArray:
    """The time (policy, [world,] cell) that each cell took to the egg, infinite where it never came."""
    times = results["arrival_time" if "arrival_time" in results else "lifetime"].where(
        results["arrived"], np.inf
    )
    return times.transpose("policy", ..., "cell")


def arrivals(results: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Per policy: `arrived`, the number of cells that reached the egg, and of those the `mean` and the
    `median` of the time it took; NaN where none did. Where cells were not kept the median is NaN.
    """
    if "arrived" not in results:
        stored = _stored(results) or {}
        return {
            name: {"arrived": row["arrived"], "mean": row["time_to_egg"] or np.nan, "median": np.nan}
            for name, row in stored.items()
        }
    found, taken = {}, times_to_egg(results)
    for name in results["policy"].values:
        times = taken.sel(policy=name).values
        times = times[np.isfinite(times)]
        mean, median = (float(each(times)) if len(times) else np.nan for each in (np.mean, np.median))
        found[str(name)] = {"arrived": len(times), "mean": mean, "median": median}
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


def margin(*samples: np.ndarray, weights: Sequence[float] = (1.0,), shared_cells: bool = True) -> Any:
    """Half the width (...) of the 95% interval of the weighted sum of the samples' means.

    Samples are (..., seeds, cells), or (cells,) of one policy. Each has seeds of its own; the cells are the
    same for all of them, or each sample has its own (`shared_cells=False`). With one seed only cells vary:
    that is all there is to a strategy, but says nothing of other trainings. None for a single number.
    Raises ValueError unless samples fit one another and the weights.
    """
    values = [np.atleast_2d(np.asarray(sample, np.float64)) for sample in samples]
    cells = {sample.shape[-1] for sample in values}
    if len(weights) != len(values) or (shared_cells and len(cells) > 1):
        shapes = ", ".join(str(sample.shape) for sample in values)
        raise ValueError(f"samples must be {len(weights)}, with the same cells, got the shapes {shapes}")
    added, taken_off, by_cell = [], [], []
    for weight, sample in zip(weights, values, strict=True):
        n_seeds, n_cells = sample.shape[-2:]
        of_seed, of_cell = weight * sample.mean(axis=-1), weight * sample.mean(axis=-2)
        by_cell.append(of_cell)
        if n_seeds > 1:
            added.append(_variance(of_seed))
        if n_seeds > 1 and n_cells > 1:
            mean = of_seed.mean(axis=-1)[..., None, None]
            rest = weight * sample - of_seed[..., None] - of_cell[..., None, :] + mean
            freedom = (n_seeds - 1) * (n_cells - 1)
            taken_off.append((np.sum(rest**2, axis=(-2, -1)) / (freedom * n_seeds * n_cells), freedom))
    by_cell = [np.sum(np.stack(np.broadcast_arrays(*by_cell)), axis=0)] if shared_cells else by_cell
    added += [_variance(each) for each in by_cell if each.shape[-1] > 1]
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
