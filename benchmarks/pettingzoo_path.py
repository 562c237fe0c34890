"""Stepping through PettingZoo against an environment that does nothing: what the physics adds to the interface.

The reference has the same agents and spaces and hands over the same dictionaries, but computes nothing.
Run with `python -m benchmarks.pettingzoo_path [--out FILE.json]`.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pettingzoo import ParallelEnv

import swarm
from benchmarks.timing import best_times

CASES = {
    "still water": {},
    "Taylor–Green, flow sensed": {"flow": "taylor_green", "sense_flow": True},
}
TARGETS = {("still water", 40): 3.5, ("still water", 1000): 1.6}
TARGETS |= {("Taylor–Green, flow sensed", 40): 8.0, ("Taylor–Green, flow sensed", 1000): 3.0}


class DoNothing(ParallelEnv):
    """Unpacks the actions into an array and packs rows of zeros."""

    def __init__(self, like: ParallelEnv) -> None:
        self.possible_agents = like.possible_agents[:]
        self.agents = self.possible_agents[:]
        size = like.observation_space(self.agents[0]).shape[0]
        self.observations = np.zeros((len(self.agents), size), np.float32)
        self.rewards = np.zeros(len(self.agents))

    def step(self, actions: dict[str, int]) -> tuple[dict[str, Any], ...]:
        agents = self.agents
        np.array([actions[agent] for agent in agents])
        return (
            dict(zip(agents, self.observations, strict=True)),
            dict(zip(agents, self.rewards.tolist(), strict=True)),
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, False),
            {agent: {"gain": 0.0} for agent in agents},
        )


def stepping(env: ParallelEnv, actions: list[dict[str, int]]) -> Callable[[], object]:
    """A call that steps with the next of the actions."""
    supply = itertools.cycle(actions)
    return lambda: env.step(next(supply))


def measure(n_swimmers: int, seconds: float = 3.0) -> list[dict[str, Any]]:
    """One row per case: microseconds of the reference and of ours, and their ratio."""
    generator = np.random.default_rng(0)
    envs = {name: swarm.parallel_env(n_swimmers, life=1e6, **settings) for name, settings in CASES.items()}
    for env in envs.values():
        env.reset(seed=0)
    agents = env.possible_agents
    drawn = generator.integers(2, size=(64, n_swimmers))  # NumPy integers, as spaces sample them
    actions = [dict(zip(agents, row, strict=True)) for row in drawn]
    calls = {name: stepping(env, actions) for name, env in envs.items()}
    references = {f"reference of {name}": stepping(DoNothing(env), actions) for name, env in envs.items()}
    times = best_times(calls | references, seconds=seconds)
    rows = []
    for name in CASES:
        ours, reference = times[name], times[f"reference of {name}"]
        rows.append(
            {
                "case": name,
                "cells": n_swimmers,
                "reference_us": reference * 1e6,
                "ours_us": ours * 1e6,
                "ratio": ours / reference,
                "target": TARGETS[name, n_swimmers],
                "agent_steps_per_second": n_swimmers / ours,
            }
        )
    return rows


def run(seconds: float = 3.0) -> list[dict[str, Any]]:
    """All rows, printed as a table."""
    rows = [row for n_swimmers in (40, 1000) for row in measure(n_swimmers, seconds)]
    print(f"{'':28s}{'cells':>6s}{'reference':>12s}{'ours':>12s}{'ratio':>8s}{'at most':>9s}{'agent steps/s':>16s}")
    for row in rows:
        print(
            f"{row['case']:28s}{row['cells']:6d}{row['reference_us']:9.1f} µs{row['ours_us']:9.1f} µs"
            f"{row['ratio']:8.2f}{row['target']:9.1f}{row['agent_steps_per_second']:16,.0f}"
        )
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="write the rows as JSON")
    parser.add_argument("--seconds", type=float, default=3.0, help="time for each number of cells")
    options = parser.parse_args()
    table = run(options.seconds)
    if options.out:
        options.out.write_text(json.dumps(table, indent=1))
