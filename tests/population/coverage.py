"""How often intervals hold the truth: `python -m tests.population.coverage` prints the whole table.

Two samples are paired where both policies are tested on the same cells, with effects that agree in part.
"""

import itertools
from typing import NamedTuple

import numpy as np

from swarm._support.tables import Table
from swarm.population.statistics import margin

SEEDS, CELLS = (3, 5, 10, 20), (40, 400)
RATIOS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # spread of seeds per spread of cells
DESIGNS = ("one sample", "paired")
INTERACTION = 0.3  # spread of (seed, cell), per spread of cells
BATCH = 100  # trials at once


class Effects(NamedTuple):
    """Distributions with mean 0 and standard deviation 1."""

    name: str
    seed: str
    cell: str


NORMAL = Effects("normal", "normal", "normal")
SKEWED = Effects("skewed seeds", "skewed", "normal")  # as where a few trainings fail


def coverage(design, n_seeds, n_cells, ratio, *, effects=NORMAL, trials=2000, seed=0):
    """Part of the trials whose interval holds the truth, which is 0."""
    generator = np.random.default_rng([seed, n_seeds, n_cells, round(1000 * ratio), DESIGNS.index(design)])

    def draw(kind, *shape):
        if kind == "normal":
            return generator.standard_normal(shape)
        return 1.0 - generator.standard_exponential(shape)  # skewness −2

    held = 0
    for _ in range(trials // BATCH):
        common = draw(effects.cell, BATCH, 1, n_cells)
        samples = []
        for _ in range(1 if design == "one sample" else 2):
            own = draw(effects.cell, BATCH, 1, n_cells)
            cells = common if design == "one sample" else 0.8 * common + 0.6 * own
            of_seeds = ratio * draw(effects.seed, BATCH, n_seeds, 1)
            noise = INTERACTION * generator.standard_normal((BATCH, n_seeds, n_cells))
            samples.append(of_seeds + cells + noise)
        weights = (1.0, -1.0)[: len(samples)]
        found = sum(w * sample.mean(axis=(-2, -1)) for w, sample in zip(weights, samples, strict=True))
        held += np.sum(np.abs(found) < margin(*samples, weights=weights))
    return held / (trials // BATCH * BATCH)


def table(**options):
    """Coverage [percent] of every design, number of seeds and of cells, by the ratio of spreads."""
    rows = []
    for effects, design in itertools.product((NORMAL, SKEWED), DESIGNS):
        for n_seeds, n_cells in itertools.product(SEEDS, CELLS):
            found = [
                coverage(design, n_seeds, n_cells, ratio, effects=effects, **options) for ratio in RATIOS
            ]
            rows.append(
                [f"{effects.name}, {design}", n_seeds, n_cells, *(f"{100 * each:.1f}" for each in found)]
            )
    return Table(["effects", "seeds", "cells", *(f"seeds/cells {ratio:g}" for ratio in RATIOS)], rows)


if __name__ == "__main__":
    print(table().as_markdown(), end="")
