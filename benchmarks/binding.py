"""Remembering against a memory of records, where cells count molecules: `configs/study/binding.yaml`.

A network that is shown the newest two records, and remembers by a GRU, beside one that is shown all four.
What is there in runs/binding is neither trained nor tested again. Signal to noise is of one record where
lives begin: c_k/κ̄, how far the concentration on a circle is from its mean at most, to √(c₀/(λ_b ΔT)).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from swarm.physics.world import World
from swarm.population.statistics import margin, mean_interval
from trainers.jobs.study import study
from trainers.jobs.study_figure import estimate, lives_at, sample

FILE, FOLDER = Path("configs/study/binding.yaml"), Path("runs/binding")
RATE, MEMORY = "world.binding_rate", "memory"


def run() -> dict[str, list[dict[str, Any]]]:
    """A table for each rate of binding."""
    found = study(FILE, FOLDER).results
    return {title_of(rate): rows(found, rate) for rate in found[RATE].values.tolist()}


def title_of(rate: float) -> str:
    """What is said of a rate of binding."""
    world = World(binding_rate=rate)
    noise = math.sqrt(20 / (rate * world.intervals[0]))
    signal = world.field.gradient_scale / world.mean_curvature
    return f"λ_b = {rate:g}: signal to noise of a record {signal / noise:.2f}"


def rows(found: xr.Dataset, rate: float) -> list[dict[str, Any]]:
    """A row per policy: what it gains, also where there is no noise, and how far it leads."""
    places = {
        (name, test): {RATE: rate, "learner": name, "test": test}
        for name in found["learner"].values.tolist()
        for test in found["test"].values.tolist()
    }
    limit = float(found["limit"].sel(places[MEMORY, "exact"]))
    table = []
    for name in found["policy"].values.tolist():
        gain, exact = (
            found["reference_gain"].sel(places[MEMORY, test] | {"policy": name}).values
            for test in ("own", "exact")
        )
        table.append(
            row(name, gain.mean(), mean_interval(gain), limit) | {"without noise": f"{exact.mean():.2f}"}
        )
    for name in found["learner"].values.tolist():
        own, rival = (sample(lives_at(found, places[each, "own"]), "gain") for each in (name, MEMORY))
        table.append(row(name, own.mean(), mean_interval(own), limit))
        table[-1]["without noise"] = f"{estimate(lives_at(found, places[name, 'exact']), 'gain')[0]:.2f}"
        seeds = own.mean(axis=1)
        table[-1]["worst and best seed"] = f"{seeds.min():.2f}, {seeds.max():.2f}"
        if name != MEMORY:
            lead, half = own.mean() - rival.mean(), margin(own, rival, weights=(1.0, -1.0))
            table[-1]["lead over the memory"] = f"{lead:.2f} ({lead - half:.2f} … {lead + half:.2f})"
    names = list(dict.fromkeys(key for each in table for key in each))
    return [{key: each.get(key) for key in names} for each in table]


def row(name: str, mean: float, interval: Any, limit: float) -> dict[str, Any]:
    """Gain and interval, and the part of the limit without noise."""
    low, high = np.asarray(interval)
    told = {"policy": name, "gain": f"{mean:.2f}", "95% interval": f"{low:.2f} … {high:.2f}"}
    return told | {"of the limit without noise": f"{mean / limit:.1%}"}
