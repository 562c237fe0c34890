"""The report on crowds: verdicts, tables, figures and words, every number of which was just measured."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarm import figures
from swarm._support.tables import NOTHING, Table
from swarm.figures.style import look
from trainers.studies import zoo
from trainers.studies.claims import Claim
from trainers.studies.crowd.measurements import MEASURES, CrowdFindings, Sample, Samples, find, level
from trainers.studies.crowd.plan import CROWD, FILM, RACE, SHEAR, SHIPPED, UPTAKE, VARIANTS, CrowdPlan
from trainers.studies.estimates import (
    Row,
    columns,
    estimate,
    filled,
    interval_of,
    number,
    printed_by,
    with_interval,
)
from trainers.studies.plan import Training
from trainers.studies.study import FIGURES, Contents, Study

VERDICTS_FILE, RESULTS = "verdicts.json", "results.csv"
TITLES = {
    UPTAKE: "Cells that eat",
    RACE: "A race to one egg",
    SHEAR: "An egg in shear",
    FILM: "Dense films",
}


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


def rows(found: CrowdFindings, experiment: str) -> Iterator[Row]:
    """A row for every point and kind of an experiment."""
    for name, value in places(found.samples, experiment).items():
        for kind, sample in found.samples[name].items():
            row: Row = {"experiment": experiment, "at": value, "policy": kind}
            row |= {"seeds": len(sample.seeds) or None, "units": next(iter(sample.numbers.values())).shape[1]}
            for panel in PANELS[experiment]:
                row |= columns(panel.measure, level(sample, panel.measure))
            yield row


def text(found: CrowdFindings, drawn: Sequence[str]) -> str:
    plan = found.plan
    how = (
        "The policies are the shipped ones: the spread over training seeds is not in the intervals"
        if plan.quick
        else f"Every policy was trained with {plan.n_seeds} independent seeds"
    )
    return filled(
        __package__,
        "report",
        **printed_by(plan, "reproduce --crowd"),
        how=how,
        changed=f" Settings that differ from the files': {' '.join(plan.words)}." if plan.words else "",
        plan=plan,
        verdicts=_judged(found.claims).as_markdown(texts=2),
        others="\n".join([*(_experiment(found, each) for each in drawn), *_costs(found)]),
    )


def _judged(claims: Sequence[Claim]) -> Table:
    table = [
        {
            "verdict": f"**{each.verdict}**",
            "question": each.claim,
            "measured": f"{number(each.measurement, '+')} {each.unit}".strip(),
            "95% interval": interval_of(each.interval),
            "criterion": each.criterion,
        }
        for each in claims
    ]
    return Table.of(table)


def _experiment(found: CrowdFindings, experiment: str) -> str:
    table = []
    for name, value in places(found.samples, experiment).items():
        for kind, sample in found.samples[name].items():
            row = {"at": value, "policy": look(kind).label}
            row |= {
                panel.measure: with_interval(level(sample, panel.measure)) for panel in PANELS[experiment]
            }
            table.append(row)
    told = {UPTAKE: _eating, RACE: _racing, SHEAR: _searching, FILM: _crowding}[experiment](found)
    return filled(
        __package__,
        "experiment",
        title=TITLES[experiment],
        about=filled(__package__, experiment, plan=found.plan, **told),
        figure=f"{FIGURES}/{experiment}.png",
        caption=CAPTIONS[experiment],
        table=Table.of(table).as_markdown(),
    )


def _eating(found: CrowdFindings) -> Row:
    world = found.plan.world(CROWD)
    return {
        "world": world,
        "medium": world.medium,
        "worlds": ", ".join(f"{worlds} of {cells}" for cells, worlds in found.plan.crowds),
        "limit": NOTHING if found.limit is None else f"{found.limit:.2f}",
    }


def _racing(found: CrowdFindings) -> Row:
    return {"cells": found.plan.settings(found.plan.recipes[0], RACE).evaluation.cells}


def _searching(found: CrowdFindings) -> Row:
    (left, right), (low, high) = found.plan.shear_box
    world, kinds = found.plan.world(SHEAR), found.samples[f"{SHEAR}_best"]
    chosen = ", ".join(f"{_best(found, kind)} for {look(kind).label}" for kind in kinds)
    box = {"left": left, "right": right, "low": low, "high": high}
    return {"world": world, "age": getattr(world.field, "age", 0.0), "chosen": chosen, **box}


def _best(found: CrowdFindings, kind: str) -> str:
    best = found.samples[f"{SHEAR}_best"][kind]
    rates = (f"{SHEAR}_{rate:g}" for rate in found.plan.shear_rates)
    return next(name for name in rates if found.samples[name][kind] is best).partition("_")[2]


def _crowding(found: CrowdFindings) -> Row:
    plan, world = found.plan, found.plan.world(FILM)
    rivals = []
    for variant in list(VARIANTS)[1:]:
        for kind, sample in found.samples[f"{FILM}_{variant}"].items():
            neither = found.samples[f"{FILM}_neither"][kind]
            row = {"against neither": variant, "policy": look(kind).label}
            for panel in PANELS[FILM]:
                values = MEASURES[panel.measure].values
                less = estimate(values(sample), values(neither))
                row[panel.measure] = with_interval(less, "+")
            rivals.append(row)
    return {
        "world": world,
        "told": "; ".join(f"`{each}`" for each in world.interactions),
        "chance": math.sqrt(math.pi / plan.film_cells) / 2,  # a random walk's mean end over its steps
        "rivals": Table.of(rivals).as_markdown() + "\n",
    }


def _costs(found: CrowdFindings) -> list[str]:
    table = [
        {"training": name, "minutes, all seeds at once": f"{each:.1f}"}
        for name, each in found.minutes.items()
    ]
    return [f"## Trainings\n\n{Table.of(table).as_markdown()}"] if table else []


# --- figures ------------------------------------------------------------------------------------------------


def draw(samples: Samples, folder: Path) -> list[str]:
    """Draw the figure of every experiment that was measured; their names."""
    drawn = [experiment for experiment in PANELS if places(samples, experiment)]
    for experiment in drawn:
        figure = figures.sweeps(list(_sweeps(samples, experiment)))
        figures.save(figure, folder / FIGURES / f"{experiment}.png")
    return drawn


def places(samples: Samples, experiment: str) -> dict[str, str]:
    """Names of an experiment's points, and what was varied there."""
    values = {name: name.removeprefix(f"{experiment}_") for name in samples if name.startswith(experiment)}
    return {name: value for name, value in values.items() if value != "best" and "choice" not in value}


def _sweeps(samples: Samples, experiment: str) -> Iterator[figures.Sweep]:
    where = places(samples, experiment)
    shown = list(dict.fromkeys(kind for name in where for kind in samples[name]))
    in_order = experiment in (SHEAR, FILM)
    at = list(range(len(where))) if in_order else [float(value) for value in where.values()]
    marks = {} if experiment == RACE else dict(zip(at, where.values(), strict=True))
    for panel in PANELS[experiment]:
        yield figures.Sweep(
            at,
            {
                kind: np.array([_numbers(samples[name][kind], panel.measure) for name in where])
                for kind in shown
            },
            panel.label,
            panel.quantity,
            marks,
            logarithmic=experiment == UPTAKE,
            joined=experiment != FILM,
            chance={"by chance": (at[0], at[-1])} if experiment == RACE else {},
        )


def _numbers(sample: Sample, measure: str) -> tuple[float, float, float]:
    found = level(sample, measure)
    return (found.value, *(found.interval or (np.nan, np.nan)))


# --- the whole ----------------------------------------------------------------------------------------------


def write(plan: CrowdPlan, planned: Sequence[Training], found: CrowdFindings, folder: Path) -> Contents:
    """Figures, policies to be shipped, whose cards tell of the test in the world they were trained for, and
    tables.
    """
    drawn = draw(found.samples, folder)
    for name, where in SHIPPED.items() if planned else ():
        trained, (point, _, kind) = found.trained[name], where.partition("/")
        sample = found.samples.get(point, {}).get(kind, Sample((), {}))
        chosen = trained.stack.chosen
        tested = {name: float(values[chosen].mean()) for name, values in sample.numbers.items()}
        told = tested | {"test": where, "seed": plan.seed}
        zoo.put(folder / zoo.FOLDER, trained, told)
    return Contents(
        {RESULTS: [row for experiment in drawn for row in rows(found, experiment)]},
        text(found, drawn),
        {"trainings": {each.name: each.recorded() for each in planned}},
        {VERDICTS_FILE: found.claims},
    )


STUDY = Study("crowds", (VERDICTS_FILE, RESULTS), find, write)
