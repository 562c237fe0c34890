"""Training, checkpoints and stepping without pause: memory, open files and speed must not drift.

Speed is that of the references of the other benchmarks divided by ours, in processor time of the same sample,
so that what else the machine does counts as little as possible. Run with
`python -m benchmarks.soak [--minutes 60] [--out DIR]`; writes soak.csv, soak.txt and soak.png, and ends with
exit code 1 where something drifts.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, process_time

import numpy as np

import swarm
from benchmarks.pettingzoo_path import Leanest
from benchmarks.plain_loop import PlainLoop
from benchmarks.tables import as_table
from benchmarks.timing import resident_bytes
from swarm._support import files
from trainers.settings.composition import settings_from
from trainers.training import checkpoint as checkpoints
from trainers.training.loop import Training

COLUMNS = ("minutes", "megabytes", "open_files", "training_speed", "stepping_speed", "epochs", "steps")
DRIFT = 0.1  # of memory and speed, last third against the middle third


def timed(call: Callable[[], object], seconds: float) -> tuple[float, int]:
    """Processor time per call, and calls, within `seconds`."""
    begun, used, calls = monotonic(), process_time(), 0
    while calls == 0 or monotonic() - begun < seconds:
        call()
        calls += 1
    return (process_time() - used) / calls, calls


class Work:
    """What is done again and again, and what it is measured against."""

    def __init__(self) -> None:
        words = ["experiment=linear_n4", "learning.epochs=1000000", "validation.every=20", "compile=never"]
        self.settings = settings_from(words)
        self.training, self.plain = Training(self.settings), PlainLoop(self.settings)
        self.env, self.reference = swarm.parallel_env(), Leanest(swarm.parallel_env())
        self.env.reset(seed=0)
        self.actions = dict.fromkeys(self.env.possible_agents, 1)

    def train(self) -> None:
        """An epoch, with a validation every twentieth time."""
        self.training.run_epoch()
        self.training.measures = self.training.measures[:0]

    def step(self) -> None:
        """A decision of all swimmers."""
        if not self.env.agents:
            self.env.reset()
        self.env.step(dict.fromkeys(self.env.agents, 1))

    def save(self, folder: Path) -> None:
        """A checkpoint."""
        held = checkpoints.tensors_of(self.training), checkpoints.record_of(self.training)
        checkpoints.write(folder, self.training.epoch, *held, dataclasses.asdict(self.settings))

    def sample(self, seconds: float) -> tuple[float, float, int, int]:
        """Speeds of training and stepping, and epochs and steps."""
        train, epochs = timed(self.train, 0.5 * seconds)
        plain, _ = timed(self.plain.epoch, 0.2 * seconds)
        step, steps = timed(self.step, 0.2 * seconds)
        nothing, _ = timed(lambda: self.reference.step(self.actions), 0.1 * seconds)
        return plain / train, nothing / step, epochs, steps


def soak(minutes: float, out: Path, every: float = 20.0) -> bool:
    """Sample until the time is over; whether nothing drifted."""
    work = Work()
    out.mkdir(parents=True, exist_ok=True)
    rows, begun = [], monotonic()
    with TemporaryDirectory(dir=out) as folder:
        while monotonic() - begun < 60 * minutes:
            sample = work.sample(every)
            work.save(Path(folder))
            handles = len(list(Path("/proc/self/fd").iterdir()))
            rows.append(((monotonic() - begun) / 60, resident_bytes() / 2**20, handles, *sample))
    with files.replacing(out / "soak.csv") as path, path.open("w", newline="") as file:
        csv.writer(file).writerows([COLUMNS, *rows])
    return report(np.array(rows), out)


def report(table: np.ndarray, out: Path) -> bool:
    """Print and write what the samples say, and draw them; whether nothing drifted."""
    third = len(table) // 3
    middle, last = table[third : 2 * third], table[-third:]
    rows: list[dict[str, object]] = []
    for place, name in enumerate(COLUMNS[1:5], start=1):
        before, after = np.median(middle[:, place]), np.median(last[:, place])
        worse = after / before - 1 if name in ("megabytes", "open_files") else before / after - 1
        verdict = "steady" if worse <= (0 if name == "open_files" else DRIFT) else "drifts"
        rows.append(
            {"median": name, "middle third": f"{before:.4g}", "last third": f"{after:.4g}", "": verdict}
        )
    text = as_table(rows)
    print(text)
    files.write_text(out / "soak.txt", text)
    draw(table, out / "soak.png")
    return all(row[""] == "steady" for row in rows)


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
