"""What launchers cost: a sweep by `launcher=processes` and by `ray` beside its two halves, each one process.

The halves train their runs one after the other, side by side, on one thread each, and know of no launcher.
RUNS and EPOCHS in the environment make it shorter; the shortest run says how long the epochs of a run took.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

RUNS, EPOCHS = (int(os.environ.get(name, usual)) for name, usual in (("RUNS", 16), ("EPOCHS", 30)))
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
HALF = (sys.executable, "-W", "ignore", "-m", "benchmarks.launchers")
SWARM = (sys.executable, "-W", "ignore", "-m", "chemoswarm", "train", "-m")
WORDS = (f"learning.epochs={EPOCHS}", "tensorboard=false")


def run() -> list[dict[str, Any]]:
    """A row for each way to train the same runs."""
    seeds = [str(seed) for seed in range(RUNS)]
    halves = [(*HALF, "halves", *seeds[: RUNS // 2]), (*HALF, "halves", *seeds[RUNS // 2 :])]
    sweep = (*SWARM, *WORDS, f"seed={','.join(seeds)}", "launcher.jobs=2")
    calls = {"two halves": halves} | {
        name: [(*sweep, f"hydra.sweep.dir={name}", f"launcher={name}")] for name in ("processes", "ray")
    }
    rows, least = [], 0.0
    for name, commands in calls.items():
        with tempfile.TemporaryDirectory() as folder:
            spent = _together(commands, folder)
            least = least or spent
            shortest = min(map(_epochs, Path(folder).glob("*/*/timings.csv")))
        rows.append(
            {
                f"{RUNS} runs by": name,
                "[s]": f"{spent:.1f}",
                "of the halves'": f"{spent / least:.2f}",
                "shortest run [s]": f"{shortest:.1f}",
            }
        )
    return rows


def _together(commands: list[tuple[str, ...]], folder: str) -> float:
    """Seconds that commands take side by side."""
    options: Any = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    options["env"] = {**os.environ, **ONE_THREAD, "PYTHONPATH": os.getcwd()}
    began = perf_counter()
    begun = [subprocess.Popen(command, **options) for command in commands]
    codes = [each.wait() for each in begun]
    if any(codes):
        raise RuntimeError("a sweep must end well, which is what did not: is chemoswarm[cluster] installed?")
    return perf_counter() - began


def _epochs(timings: Path) -> float:
    with timings.open(encoding="utf-8", newline="") as file:
        return sum(float(row["seconds"]) for row in csv.DictReader(file))


def half(folder: str, *seeds: str) -> None:
    """Trains these seeds one after the other."""
    from trainers.settings.composition import settings_from
    from trainers.training.run import train_in

    for seed in seeds:
        train_in(Path(folder) / f"seed={seed}", settings_from([*WORDS, f"seed={seed}"]))


if __name__ == "__main__":
    half(*sys.argv[1:])
