"""Training, checkpoints and stepping without pause: memory, open files and speed must not drift.

Speed is per second of processor time, so that what else the machine does counts as little as possible. Run
with `python -m benchmarks.soak [--minutes 60] [--out DIR]`; writes soak.csv and soak.png, and ends with exit
code 1 where something drifts.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, process_time

import numpy as np
import torch

import swarm
from benchmarks.timing import resident_bytes
from swarm import files
from trainers import checkpoints, snapshots
from trainers.composing import settings_from
from trainers.training import Training

COLUMNS = ("minutes", "megabytes", "open_files", "epochs_per_second", "steps_per_second", "checkpoints")
DRIFT = 0.1  # of memory and speed, last third against the middle third


def measure(training: Training, env: swarm.parallel_env, seconds: float) -> tuple[float, float]:
    """Epochs of training and PettingZoo steps per second of processor time, each for half of `seconds`."""
    begun, used, epochs, steps = monotonic(), process_time(), 0, 0
    with torch.inference_mode():
        while monotonic() - begun < seconds / 2:
            training.epoch = epochs = epochs + 1
            training.run_epoch()
            training.measures = training.measures[:0]
    epochs_per_second, used = epochs / (process_time() - used), process_time()
    while monotonic() - begun < seconds:
        if not env.agents:
            env.reset()
        env.step(dict.fromkeys(env.agents, steps % 2))
        steps += 1
    return epochs_per_second, steps / (process_time() - used)


def soak(minutes: float, out: Path, every: float = 10.0) -> bool:
    """Sample until the time is over; whether nothing drifted."""
    words = ["experiment=linear_n4", "learning.epochs=1000000", "validation.every=20", "compile=never"]
    settings, env = settings_from(words), swarm.parallel_env()
    training, stored = Training(settings), dataclasses.asdict(settings)
    env.reset(seed=0)
    out.mkdir(parents=True, exist_ok=True)
    rows, begun = [], monotonic()
    with TemporaryDirectory(dir=out) as folder:
        while monotonic() - begun < 60 * minutes:
            speeds = measure(training, env, every)
            number = len(rows) + 1
            held = snapshots.tensors_of(training), snapshots.record_of(training)
            checkpoints.write(Path(folder), number, *held, stored)
            handles = len(list(Path("/proc/self/fd").iterdir()))
            rows.append(((monotonic() - begun) / 60, resident_bytes() / 2**20, handles, *speeds, number))
    with files.replacing(out / "soak.csv") as path, path.open("w", newline="") as file:
        csv.writer(file).writerows([COLUMNS, *rows])
    table = np.array(rows)
    third = len(table) // 3
    middle, last = table[third : 2 * third], table[-third:]
    steady = True
    for place, name in enumerate(COLUMNS[1:5], start=1):
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
