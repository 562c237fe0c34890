"""Populations of any size: `evaluate(record="ends")` beside a bare loop of `policy.act` and `world.step`.

The bare loop makes the same decisions by the same policies, of a million cells at once, or of a block at a
time (half of it before and half after). Nanoseconds of processor time per decision of a cell, on one thread;
memory is the most that a process of its own held. A second table says what is left to the driver where blocks
are computed elsewhere and sent by pickle: how many workers it keeps up with.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import tempfile
from concurrent.futures import Executor, Future
from pathlib import Path
from time import process_time
from typing import Any

LIFE, POLICY = 4.0, "zoo:linear_n4"
LIVES = (4.0, 80.0)  # of the second table
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def run() -> dict[str, list[dict[str, Any]]]:
    """A table for the throughput, a row for each size and place, and one for the driver."""
    return {"One process": throughput(), "A driver and its workers": drivers()}


def throughput() -> list[dict[str, Any]]:
    """A row for each size and place."""
    (at_once,) = _alone("at_once", 1_000_000)
    rows = []
    for cells, file in ((1_000_000, ""), (1_000_000, "file"), (10_000_000, "")):
        spent, in_blocks, memory = _alone("tested", cells, file)
        rows.append(
            {
                "cells": f"{cells:,}",
                "ends go to": file or "statistics",
                "evaluate [ns]": f"{spent:.0f}",
                "bare loop, a million at once [ns]": f"{at_once:.0f}",
                "of its throughput": f"{at_once / spent:.2f}",
                "bare loop, in blocks [ns]": f"{in_blocks:.0f}",
                "of that": f"{in_blocks / spent:.2f}",
                "memory [MiB]": f"{memory:.0f}",
            }
        )
    return rows


def drivers() -> list[dict[str, Any]]:
    """A row for each length of life, on which the driver's part does not depend."""
    *blocks, driver = _alone("driven", *LIVES)
    return [
        {
            "life": f"{life:g}",
            "a block, in its worker [ms]": f"{1e3 * block:.0f}",
            "and in the driver [ms]": f"{1e3 * driver:.0f}",
            "workers": f"{block / driver:.0f}",
        }
        for life, block in zip(LIVES, blocks, strict=True)
    ]


def _alone(*words: object) -> list[float]:
    """What a process of its own finds."""
    command = [sys.executable, "-W", "ignore", "-m", "benchmarks.population_path", *map(str, words)]
    environment = {**os.environ, **ONE_THREAD}
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def _players() -> tuple[Any, list[Any]]:
    import swarm

    return swarm.World(life=LIFE), [swarm.load_policy(POLICY), swarm.Greedy(), swarm.Swinging()]


def _load(in_file: bool) -> None:
    """Loads what is loaded once."""
    from swarm.population.evaluation import evaluate

    options: dict[str, Any] = {"experiment": "linear_n4", "life": LIFE, "record": "ends", "cells": 100}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "p.nc" if in_file else None
        evaluate(POLICY, _players()[0], out=out, **options).results.close()


def bare(cells: int, times: int) -> float:
    """Nanoseconds per decision of a cell, of so many cells at once."""
    from swarm.physics.starts import draw_starts

    world, policies = _players()
    spent, first, decisions = 0.0, world.start(*draw_starts(world, cells, 1)), 0
    for policy in policies * times:
        state = first
        began = process_time()
        while not state.finished[0]:
            state, _ = world.step(state, policy.act(world, state, None))
            decisions += cells
        spent += process_time() - began
    return 1e9 * spent / decisions


def at_once(cells: str) -> list[float]:
    """The bare loop on all cells at once."""
    return [bare(int(cells), 1)]


def tested(cells: str, file: str) -> list[float]:
    """Nanoseconds per decision of a cell of the test, and of the bare loop in blocks; the memory in MiB."""
    import resource

    from swarm._support.streams import BLOCK
    from swarm.population.evaluation import evaluate

    world, policies = _players()
    options: dict[str, Any] = {"experiment": "linear_n4", "life": LIFE}
    options["record"] = "ends" if file else "statistics"
    _load(bool(file))
    before = bare(BLOCK, 4)
    with tempfile.TemporaryDirectory() as folder:
        began = process_time()
        found = evaluate(
            POLICY, world, cells=int(cells), out=Path(folder) / "p.nc" if file else None, **options
        )
        spent = process_time() - began
        found.results.close()
    decisions = int(cells) * len(policies) * world.max_decisions
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return [1e9 * spent / decisions, (before + bare(BLOCK, 4)) / 2, memory]


class Elsewhere(Executor):
    """Does tasks here and at once, taking their time, and sends what they give by pickle."""

    workers, spent = 1, 0.0  # [s]

    def submit(self, do: Any, /, *arguments: Any) -> Future:
        """The outcome of `do(*arguments)`, which is done when this returns."""
        began = process_time()
        sent = pickle.dumps(do(*arguments), pickle.HIGHEST_PROTOCOL)
        self.spent += process_time() - began
        done: Future = Future()
        done.set_result(pickle.loads(sent))
        return done


def driven(*lives: str) -> list[float]:
    """Seconds of processor time that a block of each life takes where it is computed, and the driver for it,
    which receives and writes.
    """
    import swarm
    from swarm._support.streams import BLOCK

    def whole(blocks: int, life: float) -> tuple[float, float]:
        world, policies = _players()
        elsewhere, named = Elsewhere(), {type(policy).__name__: policy for policy in policies}
        with tempfile.TemporaryDirectory() as folder:
            sizes: dict[str, Any] = {"cells": blocks * BLOCK, "life": life, "record": "ends"}
            began, out = process_time(), Path(folder) / "p.nc"
            swarm.population_test(world, named, **sizes, out=out, executor=elsewhere).close()
            return elsewhere.spent, process_time() - began - elsewhere.spent

    _load(True)
    first = [whole(1, float(life))[0] for life in lives]
    few, many = whole(4, LIFE)[1], whole(24, LIFE)[1]  # what a file costs by itself is in both
    return [*first, (many - few) / 20]


if __name__ == "__main__":
    print(json.dumps(globals()[sys.argv[1]](*sys.argv[2:])))
