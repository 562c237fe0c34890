"""Statistics of a population test: spread, intervals, comparison with greedy and with the limit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from swarm.population.intervals import mean_interval
from swarm.population.results import RIVAL

if TYPE_CHECKING:
    import xarray as xr


def statistics(results: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Per policy: `mean`, `std`, `min`, `max` of the cells' gains, `ci95` of the mean, `fraction_of_limit`,
    `difference_to_greedy` (`mean`, `ci95`; cell by cell) and `wins`, the number of cells that beat greedy.

    The intervals are Student's, 95%, over the cells; None with a single cell. `std` is over the cells
    (divided by their number). `fraction_of_limit` is None without a limit or with none above 0.
    """
    gains = results["gain"].values  # (policies, cells)
    rival = results["gain"].sel(policy=RIVAL).values
    ahead = gains - rival
    limit = results.attrs.get("limit")
    return {
        str(name): {
            "mean": float(gains[i].mean()),
            "std": float(gains[i].std()),
            "min": float(gains[i].min()),
            "max": float(gains[i].max()),
            "ci95": mean_interval(gains[i]),
            "fraction_of_limit": fraction_of_limit(float(gains[i].mean()), limit),
            "difference_to_greedy": {"mean": float(ahead[i].mean()), "ci95": mean_interval(ahead[i])},
            "wins": int(np.sum(ahead[i] > 0)),
        }
        for i, name in enumerate(results["policy"].values)
    }


def fraction_of_limit(gain: float, limit: float | None) -> float | None:
    """The part of the limit that is gained; None where no limit is known, or none above 0 (short lives)."""
    return None if limit is None or limit <= 0 else gain / limit
