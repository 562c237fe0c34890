"""Stepping through PettingZoo against an environment that does nothing: what the physics adds.

The reference has the same agents and spaces and hands over dictionaries, but computes nothing. Beside it
stands the leanest that can be written, which no environment with anything to tell can reach.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
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
    """Unpacks the actions into an array and packs arrays of zeros, agent by agent."""

    def __init__(self, like: ParallelEnv) -> None:
        self.possible_agents = like.possible_agents[:]
        self.agents = self.possible_agents[:]
        cells, size = len(self.agents), like.observation_space(self.agents[0]).shape[0]
        self.observation = np.zeros((cells, size), np.float32)
        self.reward = np.zeros(cells)
        self.terminated = self.truncated = np.zeros(cells, bool)

    def step(self, actions: dict[str, int]) -> tuple[dict[str, Any], ...]:
        np.array([actions[agent] for agent in self.agents])
        return (
            {agent: self.observation[i] for i, agent in enumerate(self.agents)},
            {agent: float(self.reward[i]) for i, agent in enumerate(self.agents)},
            {agent: bool(self.terminated[i]) for i, agent in enumerate(self.agents)},
            {agent: bool(self.truncated[i]) for i, agent in enumerate(self.agents)},
            {agent: {} for agent in self.agents},
        )


class Leanest(DoNothing):
    """The same with every shortcut there is: no array is read but the observations."""

    def step(self, actions: dict[str, int]) -> tuple[dict[str, Any], ...]:
        agents = self.agents
        np.array([actions[agent] for agent in agents])
        return (
            dict(zip(agents, self.observation, strict=True)),
            dict.fromkeys(agents, 0.0),
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, False),
            {agent: {} for agent in agents},
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
    references = {"reference": DoNothing(env), "leanest": Leanest(env)}
    calls = {name: stepping(env, actions) for name, env in (envs | references).items()}
    times = best_times(calls, seconds=seconds)
    return [
        {
            "case": name,
            "cells": n_swimmers,
            "reference_us": times["reference"] * 1e6,
            "leanest_us": times["leanest"] * 1e6,
            "ours_us": times[name] * 1e6,
            "ratio": times[name] / times["reference"],
            "target": TARGETS[name, n_swimmers],
            "ratio_to_leanest": times[name] / times["leanest"],
            "agent_steps_per_second": n_swimmers / times[name],
        }
        for name in CASES
    ]


def run(seconds: float = 3.0) -> list[dict[str, Any]]:
    """All rows."""
    return [row for n_swimmers in (40, 1000) for row in measure(n_swimmers, seconds)]
