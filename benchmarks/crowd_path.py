"""Crowds that influence each other against VMAS, and what a cell costs in crowds that grow.

VMAS's `dispersion` has agents of the same number in as many worlds; a decision of ours is set against one of
its steps. Both on one thread; ours as shipped, one world in NumPy, many compiled. Without VMAS
(`pip install vmas`) only ours is measured.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

import swarm
from benchmarks.timing import best_times
from swarm.torchrl_env import SwarmEnv

CELLS = 40
CONTACT, DIPOLE = swarm.Contact(diameter=0.1, stiffness=100.0), swarm.Dipole(strength=0.1, core=0.25)
BOTH: dict[str, Any] = {"interactions": [CONTACT, DIPOLE]}
EATING: dict[str, Any] = {"medium": {"uptake": 0.0116, "diffusivity": 0.024, "shape": (128, 128)}}
ALONE = {
    "nothing shared": ({}, None),
    "dipoles": ({"interactions": [DIPOLE]}, None),
    "contact": ({"interactions": [CONTACT]}, None),
    "contact and dipoles": (BOTH, 40.0),
    "a medium of 128²": (EATING, 20.0),
}
MANY = {32: 20.0, 1024: 2.0}
GROWING = (1_000, 10_000, 100_000)
DENSITY = 0.4  # cells per unit area, as 40 in 10 × 10
FLAT = 2.0


def decisions_of(cells: int, **parameters: Any) -> Callable[[], None]:
    """A call that makes a decision of a world in NumPy, each time from the same state."""
    world = swarm.World(**parameters)
    state = world.start(*swarm.draw_starts(world, cells, 1))
    choices = np.random.default_rng(0).integers(2, size=(8, cells))
    for action in choices[:4]:  # who was drawn on top of another is pushed away
        state, _ = world.step(state, action)
    turn = iter(range(10**9))

    def call() -> None:
        world.step(state, choices[next(turn) % len(choices)])

    return call


def compiled_decisions_of(worlds: int, **parameters: Any) -> Callable[[], None]:
    """A call that makes a decision of many worlds on tensors, one after the other."""
    env = SwarmEnv(worlds, n_swimmers=CELLS, seed=0, compile_step=True, **parameters)
    env.restart()
    choices = torch.randint(2, (8, worlds, CELLS), generator=torch.Generator().manual_seed(0))
    turn = iter(range(10**9))

    def call() -> None:
        if env.all_finished():
            env.restart()
        env.advance(choices[next(turn) % len(choices)])

    return call


def steps_of_vmas(worlds: int) -> Callable[[], None] | None:
    """A call that makes a step of VMAS's `dispersion`; None where VMAS is not installed."""
    if importlib.util.find_spec("vmas") is None:
        return None
    from vmas import make_env

    env = make_env("dispersion", num_envs=worlds, device="cpu", n_agents=CELLS, continuous_actions=True)
    env.reset()
    generator = torch.Generator().manual_seed(0)
    force = [torch.rand(worlds, 2, generator=generator) - 0.5 for _ in range(CELLS)]
    return lambda: env.step(force)


def against_vmas(seconds: float) -> list[dict[str, Any]]:
    """Decisions beside VMAS's steps."""
    calls = {(1, name): decisions_of(CELLS, **given) for name, (given, _) in ALONE.items()}
    calls |= {(worlds, "contact and dipoles"): compiled_decisions_of(worlds, **BOTH) for worlds in MANY}
    for worlds in (1, *MANY):
        if (theirs := steps_of_vmas(worlds)) is not None:
            calls[worlds, "VMAS"] = theirs
    times = best_times({f"{worlds} {name}": call for (worlds, name), call in calls.items()}, seconds=seconds)
    wanted = {(1, name): least for name, (_, least) in ALONE.items()}
    wanted |= {(worlds, "contact and dipoles"): least for worlds, least in MANY.items()}
    rows = []
    for worlds, name in calls:
        time, theirs = times[f"{worlds} {name}"], times.get(f"{worlds} VMAS")
        rows.append(
            {
                "what": name,
                "worlds": worlds,
                "ms": 1e3 * time,
                "times VMAS's speed": None if theirs is None else theirs / time,
                "at least": wanted.get((worlds, name)),
            }
        )
    return rows


def growing(seconds: float) -> list[dict[str, Any]]:
    """What a cell costs in crowds of the same density, by lists of neighbours."""
    interactions = [CONTACT, swarm.Dipole(strength=0.1, core=0.25, cutoff=1.0)]
    times = {}
    for cells in GROWING:
        side = (cells / DENSITY) ** 0.5
        call = decisions_of(cells, interactions=interactions, start_box=((0.0, side), (0.0, side)))
        times[cells] = best_times({"ours": call}, seconds=seconds)["ours"] / cells
    first = times[GROWING[0]]
    return [
        {"cells": f"{cells:,}", "µs of a cell": 1e6 * time, "ratio": time / first, "at most": FLAT}
        for cells, time in times.items()
    ]


def run(seconds: float = 20.0) -> dict[str, list[dict[str, Any]]]:
    """Both tables."""
    torch.set_num_threads(1)
    return {
        "Forty cells in a world": against_vmas(seconds),
        "One world that grows, contact and dipoles within 1": growing(seconds / 4),
    }
