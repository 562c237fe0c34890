"""Training and stepping without pause: memory, open files and speed must not drift.

Run with `python -m benchmarks.soak [--minutes 60] [--out DIR]`; writes soak.csv and soak.png, and ends with
exit code 1 where something drifts.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path
from time import monotonic

import numpy as np
import torch

import swarm
from benchmarks.timing import resident_bytes
from swarm import files
from trainers.composing import settings_from
from trainers.training import Training

COLUMNS = ("minutes", "megabytes", "open_files", "epochs_per_second", "steps_per_second")
DRIFT = 0.1  # of memory and speed, last third against the middle third


def measure(training: Training, env: swarm.parallel_env, seconds: float) -> tuple[float, float]:
    """Epochs of training and PettingZoo steps per second, each for half of the time."""
    begun, epochs, steps = monotonic(), 0, 0
    with torch.inference_mode():
        while monotonic() - begun < seconds / 2:
            training.epoch = epochs = epochs + 1
            training.run_epoch()
            training.measures = training.measures[:0]
    first = monotonic() - begun
    while monotonic() - begun < seconds:
        if not env.agents:
            env.reset()
        env.step(dict.fromkeys(env.agents, steps % 2))
        steps += 1
    return epochs / first, steps / (monotonic() - begun - first)


def soak(minutes: float, out: Path, every: float = 10.0) -> bool:
    """Sample until the time is over; whether nothing drifted."""
    words = ["experiment=linear_n4", "learning.epochs=1000000", "validation.every=20", "compile=never"]
    training, env = Training(settings_from(words)), swarm.parallel_env()
    env.reset(seed=0)
    rows, begun = [], monotonic()
    while monotonic() - begun < 60 * minutes:
        speeds = measure(training, env, every)
        handles = len(list(Path("/proc/self/fd").iterdir()))
        rows.append(((monotonic() - begun) / 60, resident_bytes() / 2**20, handles, *speeds))
    out.mkdir(parents=True, exist_ok=True)
    with files.replacing(out / "soak.csv") as path, path.open("w", newline="") as file:
        csv.writer(file).writerows([COLUMNS, *rows])
    table = np.array(rows)
    third = len(table) // 3
    middle, last = table[third : 2 * third], table[-third:]
    steady = True
    for place, name in enumerate(COLUMNS[1:], start=1):
        before, after = np.median(middle[:, place]), np.median(last[:, place])
        worse = after / before - 1 if name in ("megabytes", "open_files") else before / after - 1
        limit = 0 if name == "open_files" else DRIFT
        steady &= worse <= limit
        print(f"{name:20s}{before:12.2f} -> {after:12.2f}  {'steady' if worse <= limit else 'DRIFTS'}")
    draw(table, out / "soak.png")
    return steady


def draw(table: np.ndarray, path: Path) -> None:
    """Every measure against time."""
    from matplotlib.figure import Figure

    from swarm import figures

    figure = Figure(figsize=(7, 5), layout="constrained")
    for axes, place in zip(figure.subplots(2, 2, sharex=True).flat, range(1, 5), strict=True):
        axes.plot(table[:, 0], table[:, place])
        axes.set_ylim(0, 1.15 * table[:, place].max())
        axes.set_title(COLUMNS[place].replace("_", " "), loc="left")
        axes.set_xlabel("minutes")
    figures.save(figure, path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--out", type=Path, default=Path("runs/soak"))
    options = parser.parse_args()
    sys.exit(0 if soak(options.minutes, options.out) else 1)
