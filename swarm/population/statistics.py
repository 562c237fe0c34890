"""Statistics of a population test: spread, bootstrap intervals, comparison with greedy and with the limit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from swarm._support import streams
from swarm.population.results import RIVAL

if TYPE_CHECKING:
    import xarray as xr

RESAMPLES = 9999  # of the bootstrap


def statistics(results: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Per policy: `mean`, `std`, `min`, `max` of the cells' gains, `ci95` of the mean, `fraction_of_limit`,
    `difference_to_greedy` (`mean`, `ci95`; cell by cell) and `wins`, the number of cells that beat greedy.

    The intervals are 95% percentile bootstraps over cells, seeded by the test's own seed; None with a single
    cell. `std` is over the cells (divided by their number). `fraction_of_limit` is None without a limit.
    """
    gains = results["gain"].values  # (policies, cells)
    rival = results["gain"].sel(policy=RIVAL).values
    ahead = gains - rival
    intervals = mean_intervals(np.stack([gains, ahead]), seed=int(results.attrs["seed"]))
    limit = results.attrs.get("limit")
    return {
        str(name): {
            "mean": float(gains[i].mean()),
            "std": float(gains[i].std()),
            "min": float(gains[i].min()),
            "max": float(gains[i].max()),
            "ci95": intervals[0][i],
            "fraction_of_limit": None if limit is None else float(gains[i].mean() / limit),
            "difference_to_greedy": {"mean": float(ahead[i].mean()), "ci95": intervals[1][i]},
            "wins": int(np.sum(ahead[i] > 0)),
        }
        for i, name in enumerate(results["policy"].values)
    }


def mean_intervals(samples: np.ndarray, *, seed: int = 0) -> Any:
    """95% percentile bootstrap intervals [low, high] of the means over the last axis, as nested lists (...).

    Every row is resampled with the same drawn indices. None in place of an interval where there is one number
    only.
    """
    if samples.shape[-1] < 2:
        return np.full(samples.shape[:-1], None, object).tolist()
    from scipy.stats import bootstrap

    interval = bootstrap(
        (samples,),
        np.mean,
        axis=-1,
        n_resamples=RESAMPLES,
        batch=1000,
        method="percentile",
        rng=streams.generator("test", "bootstrap", seed),
    ).confidence_interval
    return np.stack([interval.low, interval.high], axis=-1).tolist()
