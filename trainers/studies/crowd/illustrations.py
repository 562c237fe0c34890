"""Figures of the experiments on crowds: what was measured against what was varied."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarm import figures
from trainers.studies.crowd.measurements import CrowdEvidence, Sample, level
from trainers.studies.crowd.plan import FILM, RACE, SHEAR, UPTAKE, VARIANTS, CrowdPlan
from trainers.studies.study import FIGURES

CAPTIONS = {
    UPTAKE: "Cells that eat what they follow: (a) how far they climb, (b) their gain, by the number of cells "
    "in the same water. In the legend: what each policy was trained in.",
    RACE: "The share of the wins of a learnt policy against greedy, by its share of the crowd. Dotted: as "
    "many wins as cells.",
    SHEAR: "The part of the cells that reach an egg in shear, by the shear rate.",
    FILM: "A dense film with contact, with the flow of dipoles, with both and with neither: (a) gain, "
    "(b) polar order, (c) distance of the nearest neighbour.",
}


class Panel(NamedTuple):
    """What is read off the points of an experiment, and what its axes say."""

    measure: str
    label: str
    quantity: str


PANELS = {
    UPTAKE: (
        Panel("height", "cells that eat", "height climbed"),
        Panel("gain", "cells that eat", r"gain $\Delta c$"),
    ),
    RACE: (Panel("share of wins", "share of the crowd", "share of the wins"),),
    SHEAR: (Panel("part that arrives", r"shear rate $\gamma$", "part that arrives"),),
    FILM: (
        Panel("gain", "", r"gain $\Delta c$"),
        Panel("polar order", "", "polar order"),
        Panel("nearest neighbour", "", "nearest neighbour"),
    ),
}


def draw(plan: CrowdPlan, evidence: CrowdEvidence, folder: Path) -> list[str]:
    """Draw the figure of every experiment that was measured; their names."""
    (folder / FIGURES).mkdir(parents=True, exist_ok=True)
    drawn = []
    for experiment in PANELS:
        if any(name.startswith(experiment) for name in evidence.found):
            figures.save(
                figures.sweeps(list(_sweeps(plan, evidence, experiment))),
                folder / FIGURES / f"{experiment}.png",
            )
            drawn.append(experiment)
    return drawn


def places(plan: CrowdPlan, experiment: str) -> dict[str, float]:
    """Names of an experiment's points, and where they stand in its figure."""
    if experiment == UPTAKE:
        return {f"{UPTAKE}_{cells}": cells for cells, _ in plan.crowds}
    if experiment == RACE:
        return {f"{RACE}_{share}": share for share in plan.shares}
    if experiment == SHEAR:
        return {f"{SHEAR}_{rate:g}": place for place, rate in enumerate(plan.shear_rates)}
    return {f"{FILM}_{name}": place for place, name in enumerate(VARIANTS)}


def _sweeps(plan: CrowdPlan, evidence: CrowdEvidence, experiment: str) -> Iterator[figures.Sweep]:
    where = places(plan, experiment)
    shown: Sequence[str] = list(dict.fromkeys(kind for name in where for kind in evidence.found[name]))
    names = [name.partition("_")[2] for name in where]
    marks = {} if experiment == RACE else dict(zip(where.values(), names, strict=True))
    for panel in PANELS[experiment]:
        found = {
            kind: np.array([_numbers(evidence.found[name][kind], panel.measure) for name in where])
            for kind in shown
        }
        chance = {"by chance": (plan.shares[0], plan.shares[-1])} if experiment == RACE else {}
        yield figures.Sweep(
            list(where.values()),
            found,
            panel.label,
            panel.quantity,
            marks,
            logarithmic=experiment == UPTAKE,
            joined=experiment != FILM,
            chance=chance,
        )


def _numbers(sample: Sample, measure: str) -> tuple[float, float, float]:
    """The mean and its interval."""
    found = level(sample, measure)
    return (found.value, *(found.interval or (np.nan, np.nan)))
