"""Timing of alternatives side by side, so that what else the machine does falls on all of them alike."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from time import perf_counter


def best_times(
    calls: Mapping[str, Callable[[], object]], *, seconds: float = 2.0, turn: float = 1e-3
) -> dict[str, float]:
    """Seconds per call of each, the best of rounds in which every call has its turn of about `turn` seconds.

    Turns are short, so that some of them fall between what else the machine does.
    """
    counts = {}
    for name, call in calls.items():
        call()
        start = perf_counter()
        call()
        counts[name] = max(1, round(turn / max(perf_counter() - start, 1e-7)))
    best = dict.fromkeys(calls, float("inf"))
    end = perf_counter() + seconds
    while perf_counter() < end:
        for name, call in calls.items():
            repeats = range(counts[name])
            start = perf_counter()
            for _ in repeats:
                call()
            best[name] = min(best[name], (perf_counter() - start) / counts[name])
    return best


def printed_number(script: str, **environment: str) -> float:
    """The number that a script prints last, run by a Python process of its own."""
    command = [sys.executable, "-W", "ignore", "-c", script]
    done = subprocess.run(
        command, env={**os.environ, **environment}, check=True, capture_output=True, text=True
    )
    return float(done.stdout.split()[-1])


def resident_bytes() -> int:
    """Memory that this process has in use."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
