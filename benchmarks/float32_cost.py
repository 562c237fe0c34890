"""What single precision costs: the same lives in float32 and in float64.

With the same decisions, how far poses, observations, rewards and gains drift apart over a life; and with the
greedy strategy deciding by what it perceives, how the gains of a population differ. NumPy on one core; prints
a table. Run with `python -m benchmarks.float32_cost [--out FILE.json]`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

import swarm
from swarm.physics.starts import draw_starts

CELLS = 100
CASES = {
    "still water, N_T = 2": {"n_records": 2},
    "still water, N_T = 4": {},
    "still water, N_T = 8": {"n_records": 8},
    "varying speed": {"varying_speed": True},
    "radial": {"field": "radial"},
    "Taylor–Green": {"flow": "taylor_green", "sense_flow": True, "life": 400.0},
}


def start(world: swarm.World, dtype: type) -> Any:
    """The test population's start in one precision."""
    position, heading, past = draw_starts(world, CELLS, 0)
    return world.start(position.astype(dtype), heading.astype(dtype), past)


def drift(world: swarm.World, seed: int = 0) -> dict[str, float]:
    """Largest differences between a life in float32 and one in float64 with the same random decisions."""
    decide = np.random.default_rng(seed)
    states = {dtype: start(world, dtype) for dtype in (np.float32, np.float64)}
    worst = dict.fromkeys(("position", "heading", "observation", "reward", "gain"), 0.0)
    first_interval = 0.0
    for turn in range(world.max_decisions):
        action = decide.integers(world.n_actions, size=CELLS)
        outcomes = {}
        for dtype in states:
            states[dtype], outcomes[dtype] = world.step(states[dtype], action)
        alive = ~(states[np.float32].finished | states[np.float64].finished)
        pairs = [
            (name, getattr(source[np.float32], name), getattr(source[np.float64], name))
            for source, names in (
                (states, ("position", "heading")),
                (outcomes, ("observation", "reward", "gain")),
            )
            for name in names
        ]
        for name, single, double in pairs:
            difference = float(np.abs(single[alive].astype(np.float64) - double[alive]).max(initial=0.0))
            worst[name] = max(worst[name], difference)
            if turn == 0 and name == "position":
                first_interval = difference
    return {"position after one interval": first_interval, **worst}


def greedy_gain(world: swarm.World, dtype: type) -> np.ndarray:
    """Gains (cells,) of the greedy strategy."""
    state, gain = start(world, dtype), np.zeros(CELLS)
    for _ in range(world.max_decisions):
        alive = ~state.finished
        state, outcome = world.step(state, swarm.Greedy().act(world, state, np.zeros(CELLS)))
        gain = np.where(alive, outcome.gain, gain)
    return gain


def measure(world: swarm.World) -> dict[str, float]:
    """All numbers of one case."""
    single, double = (greedy_gain(world, dtype) for dtype in (np.float32, np.float64))
    return {
        **drift(world),
        "greedy gain": float(double.mean()),
        "its change in float32": float((single - double).mean()),
        "its standard error": float((single - double).std() / CELLS**0.5),
    }


def main() -> None:
    """Measures every case and prints a table."""
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("--out", type=Path, help="write the numbers as JSON too")
    out = arguments.parse_args().out
    results = {name: measure(swarm.World(**{"life": 200.0, **case})) for name, case in CASES.items()}
    columns = list(next(iter(results.values())))
    print("| case | " + " | ".join(columns) + " |")
    print("|---" * (len(columns) + 1) + "|")
    for name, numbers in results.items():
        print(f"| {name} | " + " | ".join(f"{numbers[column]:.2g}" for column in columns) + " |")
    if out is not None:
        out.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
