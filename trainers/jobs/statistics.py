"""Statistics over training seeds and test cells: of every seed, and of all of them with intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from swarm._support.tables import Table, percent, span
from swarm.population.evaluation import TO_THE_EGG
from swarm.population.statistics import fraction_of_limit, independent, mean_interval

CELLS = (1, 2)  # axes of worlds and cells
SHARES = ("wins", "arrived")  # statistics that lie between 0 and 1
Array = Any


class Lives(NamedTuple):
    """What cells of one test gained, under policies of several seeds or under one reference."""

    gain: Array  # (seeds, worlds, cells) [concentration]
    greedy: Array  # (worlds, cells), of the same cells
    times: Array | None  # (seeds, worlds, cells) [time] to the egg, infinite for who never came
    limit: float  # of the mean gain; NaN where none is known
    coupled: bool  # whether what one cell does can matter to another


class Statistic(NamedTuple):
    """A number of every seed."""

    label: str
    units: str
    of: Callable[[Lives], Array]  # of each cell (seeds, worlds, cells), whose mean it is; or (seeds,)
    needs_egg: bool = False


def _of_arrived(number: Callable[[Array], Any]) -> Callable[[Lives], Array]:
    def of(lives: Lives) -> Array:
        came = [each[np.isfinite(each)] for each in np.asarray(lives.times)]
        return np.array([number(each) if each.size else np.nan for each in came])

    return of


STATISTICS = {
    "gain": Statistic(r"mean gain $\Delta c$", "concentration", lambda lives: lives.gain),
    "over_greedy": Statistic(
        "mean lead over greedy", "concentration", lambda lives: lives.gain - lives.greedy
    ),
    "fraction_of_limit": Statistic(
        "fraction of the limit", "1", lambda lives: lives.gain / (lives.limit if lives.limit > 0 else np.nan)
    ),
    "wins": Statistic("cells that beat greedy", "1", lambda lives: (lives.gain > lives.greedy) * 1.0),
    "std": Statistic(
        "standard deviation of the gain", "concentration", lambda lives: lives.gain.std(axis=CELLS)
    ),
    "lowest": Statistic("lowest gain", "concentration", lambda lives: lives.gain.min(axis=CELLS)),
    "highest": Statistic("highest gain", "concentration", lambda lives: lives.gain.max(axis=CELLS)),
    "arrived": Statistic(
        "cells at the egg", "1", lambda lives: np.isfinite(np.asarray(lives.times)) * 1.0, True
    ),
    "time_to_egg": Statistic("mean time to the egg", "time", _of_arrived(np.mean), True),
    "median_time_to_egg": Statistic("median time to the egg", "time", _of_arrived(np.median), True),
}


def sample(lives: Lives, statistic: str) -> Array:
    """What a statistic is the mean of: (seeds, independent units); NaN where there is no egg."""
    kind = STATISTICS[statistic]
    if kind.needs_egg and lives.times is None:
        return np.full((len(lives.gain), 1), np.nan)
    values = np.asarray(kind.of(lives), np.float64)
    if values.ndim == 1:
        return values[:, None]
    return np.stack([independent(each, lives.coupled) for each in values])


def estimate(lives: Lives, statistic: str) -> tuple[float, float, float]:
    """A statistic over all seeds, with its 95% interval over seeds and cells, or worlds where the cells of
    one are coupled; NaN where there is none, as there is no interval with a single cell, or such world.
    """
    values, several = sample(lives, statistic), independent(lives.gain[0], lives.coupled).size > 1
    low, high = (mean_interval(values) if several and np.isfinite(values).all() else None) or (np.nan, np.nan)
    if statistic in SHARES:
        low, high = np.clip([low, high], 0.0, 1.0).tolist()
    return float(values.mean()), low, high


def summary(lives: Lives) -> dict[str, Any]:
    """The numbers of a table: of all seeds the mean gain with its interval (low, high; as `estimate` says),
    of the worst and the best seed, of greedy, the limit, and of the egg; None where there is no number.
    """
    mean, low, high = estimate(lives, "gain")
    means, (seeds, worlds, cells) = lives.gain.mean(axis=CELLS), lives.gain.shape
    limit = None if np.isnan(lives.limit) else lives.limit
    came = np.zeros(0) if lives.times is None else lives.times[np.isfinite(lives.times)]
    return {
        "seeds": seeds,
        "worlds": worlds,
        "cells": cells,
        "mean": mean,
        "low": None if np.isnan(low) else low,
        "high": None if np.isnan(high) else high,
        "worst": float(means.min()),
        "best": float(means.max()),
        "greedy": float(lives.greedy.mean()),
        "limit": limit,
        "fraction_of_limit": fraction_of_limit(mean, limit),
        "arrived": None if lives.times is None else came.size / lives.times.size,
        "time_to_egg": float(came.mean()) if came.size else None,
        "median_time_to_egg": float(np.median(came)) if came.size else None,
    }


def readable(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Summaries as they are read, without the columns in which none of them has anything."""
    _, mean_time, median_time = TO_THE_EGG
    told = [
        {
            "seeds": row["seeds"],
            "gain": _rounded(row["mean"]),
            "95% interval": None if row["low"] is None else span((row["low"], row["high"])),
            "worst": _rounded(row["worst"]),
            "best": _rounded(row["best"]),
            "greedy": _rounded(row["greedy"]),
            "of the limit": percent(row["fraction_of_limit"]),
            "arrived": percent(row["arrived"]),
            mean_time: _rounded(row["time_to_egg"], 1),
            median_time: _rounded(row["median_time_to_egg"], 1),
        }
        for row in rows
    ]
    shown = [name for name in told[0] if name == "95% interval" or any(row[name] is not None for row in told)]
    return Table.of(told, shown)


def _rounded(value: float | None, digits: int = 2) -> str | None:
    return None if value is None else f"{value:.{digits}f}"


def beside(headings: Sequence[str], labels: Sequence[Sequence[Any]], table: Table) -> Table:
    """A table with further columns in front: a row of labels for each of its rows."""
    rows = [[*front, *row] for front, row in zip(labels, table.rows, strict=True)]
    return Table([*headings, *table.headings], rows)
