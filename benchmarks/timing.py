"""Timing of alternatives side by side, so that what else the machine does falls on all of them alike."""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from time import perf_counter


def best_times(calls: Mapping[str, Callable[[], object]], *, seconds: float = 2.0, rounds: int = 40) -> dict[str, float]:
    """Seconds per call of each, the best of interleaved rounds that take about `seconds` altogether."""
    share = seconds / rounds / len(calls)
    counts = {}
    for name, call in calls.items():
        call()
        start = perf_counter()
        call()
        counts[name] = max(1, round(share / max(perf_counter() - start, 1e-7)))
    best = dict.fromkeys(calls, float("inf"))
    for _ in range(rounds):
        for name, call in calls.items():
            gc.collect(0)
            repeats = range(counts[name])
            start = perf_counter()
            for _ in repeats:
                call()
            best[name] = min(best[name], (perf_counter() - start) / counts[name])
    return best
