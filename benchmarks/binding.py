"""Remembering against a memory of records, where cells count molecules: `configs/study/binding.yaml`.

A network that is shown the newest two records, and remembers by a GRU, beside one that is shown all four.
What is there in runs/binding is neither trained nor tested again. Signal to noise is of one record where
lives begin: c_k/κ̄, how far the concentration on a circle is from its mean at most, to √(c₀/(λ_b ΔT)).
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from swarm.optimal.physical_limit import limit
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.population.statistics import margin, mean_interval
from trainers.jobs.statistics import estimate, sample
from trainers.jobs.study import study
from trainers.jobs.study_figure import lives_at

FILE, FOLDER = Path("configs/study/binding.yaml"), Path("runs/binding")
RATE, MEMORY, OWN = "world.binding_rate", "memory", "own"
OTHERS = {"many": "gain with records that are exact means", "turning": "gain with rotational diffusion 0.05"}


def run() -> dict[str, list[dict[str, Any]]]:
    """A table for each rate of binding."""
    found = study(FILE, FOLDER).results
    return {title_of(rate): rows(found, rate) for rate in found[RATE].values.tolist()}


def title_of(rate: float) -> str:
    """What is said of a rate of binding."""
    world = World(binding_rate=rate)
    noise = math.sqrt(world.field.concentration(np.zeros(2)) / (rate * world.intervals[0]))
    signal = world.field.gradient_scale / world.mean_curvature
    return f"λ_b = {rate:g}: signal to noise of a record {signal / noise:.2f}"


def rows(found: xr.Dataset, rate: float) -> list[dict[str, Any]]:
    """A row per policy: what it gains, how far it leads, and what it gains in the other tests."""
    here = {RATE: rate, "test": OWN}
    tested = json.loads(found["tested_world"].sel(here | {"learner": MEMORY}).item())
    world, cells = World(life=tested["life"]), found.sizes["cell"]
    bound = limit(world, draw_starts(world, cells, 0)) or np.nan
    table, memory = [], sample(lives_at(found, here | {"learner": MEMORY}), "gain")
    known = [({"learner": MEMORY}, name) for name in found["policy"].values.tolist()]
    for which, name in known + [({"learner": name}, None) for name in found["learner"].values.tolist()]:
        gain = sample(lives_at(found, here | which, name), "gain")
        (low, high), seeds = mean_interval(gain) or (np.nan, np.nan), gain.mean(axis=1)
        row = {
            "policy": name or which["learner"],
            "gain": f"{gain.mean():.2f}",
            "95% interval": f"{low:.2f} … {high:.2f}",
            "worst and best seed": None if name else f"{seeds.min():.2f}, {seeds.max():.2f}",
            "of the limit without noise": f"{gain.mean() / bound:.1%}",
        }
        lead, half = gain.mean() - memory.mean(), margin(gain, memory, weights=(1.0, -1.0))
        own = name is None and which["learner"] == MEMORY
        row["lead over the memory"] = (
            None if own else f"{lead:+.2f} ({lead - half:+.2f} … {lead + half:+.2f})"
        )
        for test, told in OTHERS.items():
            row[told] = f"{estimate(lives_at(found, here | which | {'test': test}, name), 'gain')[0]:.2f}"
        table.append(row)
    return table
