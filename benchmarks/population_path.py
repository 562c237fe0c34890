"""Populations of any size: `evaluate` with the ends of all cells written to a file, beside a bare loop.

The bare loop is `policy.act` and `world.step` alone, of the same policies and decisions, on blocks of as many
cells; half of it runs before and half after. Processor time on one thread; memory is the most that a process
of its own held.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

LIFE, POLICY = 4.0, "zoo:linear_n4"
SIZES = (1_000_000, 10_000_000)
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def run() -> list[dict[str, Any]]:
    """A row for each size."""
    command = [sys.executable, "-W", "ignore", "-m", "benchmarks.population_path"]
    rows = []
    for cells in SIZES:
        done = subprocess.run(
            [*command, str(cells)],
            env={**os.environ, **ONE_THREAD},
            check=True,
            capture_output=True,
            text=True,
        )
        rows.append(json.loads(done.stdout.splitlines()[-1]))
    return rows


def bare(world: Any, policies: list[Any], blocks: int) -> float:
    """Seconds of the decisions of so many blocks."""
    from swarm._support.streams import BLOCK
    from swarm.physics.starts import draw_starts

    spent, first = 0.0, world.start(*draw_starts(world, BLOCK, 1))
    for policy in policies * blocks:
        state = first
        began = process_time()
        while not state.finished[0]:
            state, _ = world.step(state, policy.act(world, state, None))
        spent += process_time() - began
    return spent


def measured(cells: int) -> dict[str, Any]:
    """What a test of so many cells takes, against what the bare loop takes for as many."""
    import resource

    import swarm
    from swarm._support.streams import BLOCK
    from swarm.population.evaluation import evaluate

    world = swarm.World(life=LIFE)
    policies = [swarm.load_policy(POLICY), swarm.Greedy(), swarm.Swinging()]
    sizes: dict[str, Any] = {"experiment": "linear_n4", "life": LIFE, "record": "ends"}
    with tempfile.TemporaryDirectory() as folder:
        evaluate(POLICY, world, cells=100, **sizes)  # loads what is loaded once
        alone = bare(world, policies, 4)
        began = process_time()
        found = evaluate(POLICY, world, cells=cells, out=Path(folder) / "population.nc", **sizes)
        spent = process_time() - began
        found.results.close()
        size = (Path(folder) / "population.nc").stat().st_size
    alone = (alone + bare(world, policies, 4)) / (8 * BLOCK)
    decisions = 3 * 11  # of three policies in a life of 4
    return {
        "cells": f"{cells:,}",
        "bare loop": f"{alone / decisions * 1e9:.0f} ns per decision of a cell",
        "evaluate": f"{spent / cells / decisions * 1e9:.0f} ns",
        "of its throughput": f"{alone * cells / spent:.2f}",
        "memory": f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB",
        "file": f"{size / 2**20:.0f} MiB",
    }


if __name__ == "__main__":
    print(json.dumps(measured(int(sys.argv[1]))))
