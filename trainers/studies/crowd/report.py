"""The report on crowds: verdicts, tables, figures and words, every number of which was just measured."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarm import figures
from swarm._support.tables import NOTHING, Table
from swarm.figures.style import look
from trainers.studies.claims import NOT_REPRODUCED, REPRODUCED, REVERSED, Claim
from trainers.studies.crowd.measurements import MEASURES, Sample, Samples, level
from trainers.studies.crowd.plan import CROWD, FILM, RACE, SHEAR, UPTAKE, VARIANTS, CrowdPlan
from trainers.studies.estimates import columns, estimate, interval_of, number, opening, with_interval
from trainers.studies.stacks import Trained
from trainers.studies.study import FIGURES

VERDICTS = {REPRODUCED: "yes", NOT_REPRODUCED: "not shown", REVERSED: "no"}
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


class CrowdFindings(NamedTuple):
    plan: CrowdPlan
    samples: Samples
    claims: Sequence[Claim]  # their verdicts in the words of `VERDICTS`
    trained: dict[str, Trained]  # by experiment
    limit: float | None  # of a cell alone, in the same lives
    minutes: dict[str, float]  # of every training


def rows(found: CrowdFindings, experiment: str) -> Iterator[dict[str, Any]]:
    """A row for every point and kind of an experiment."""
    for name, value in places(found.samples, experiment).items():
        for kind, sample in found.samples[name].items():
            row: dict[str, Any] = {"experiment": experiment, "at": value, "policy": kind}
            row |= {"seeds": len(sample.seeds) or None, "units": next(iter(sample.numbers.values())).shape[1]}
            for panel in PANELS[experiment]:
                row |= columns(panel.measure, level(sample, panel.measure))
            yield row


def text(found: CrowdFindings, drawn: Sequence[str]) -> str:
    parts = [_opening(found.plan), _verdicts(found.claims)]
    parts += [_experiment(found, each) for each in drawn]
    parts += [_costs(found)]
    return "\n".join(part for part in parts if part)


def _opening(plan: CrowdPlan) -> str:
    how = (
        "The policies are the shipped ones: the spread over training seeds is not in the intervals"
        if plan.quick
        else f"Every policy was trained with {plan.n_seeds} independent seeds"
    )
    changed = f" Settings that differ from the files': {' '.join(plan.words)}." if plan.words else ""
    told = f"""{how}.{changed} Test seed {plan.seed}; nothing was chosen by its worlds.
Intervals are 95%, over training seeds and test units, which are crossed: every seed is tested in the same
ones. The cells of a world that they share are not independent, so units are worlds, in a race turns of
worlds; in shear, where nobody meets, cells. Verdicts are by the interval alone, and by criteria that were
stated before: *yes* where the whole interval satisfies it, *no* where the whole interval does not, else *not
shown*. Two questions were asked when a first run had been looked at, whether a finer mesh says the same and
whether DQN or PPO matters; then the races were doubled, too, and their
intervals were made to keep within 0 and 1."""
    return opening("Crowds", plan, ["reproduce --crowd"], told)


def _verdicts(claims: Sequence[Claim]) -> str:
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
    return f"""## Verdicts

{Table.of(table).as_markdown(texts=2)}"""


def _experiment(found: CrowdFindings, experiment: str) -> str:
    table = []
    for name, value in places(found.samples, experiment).items():
        for kind, sample in found.samples[name].items():
            row = {"at": value, "policy": look(kind).label}
            row |= {
                panel.measure: with_interval(level(sample, panel.measure)) for panel in PANELS[experiment]
            }
            table.append(row)
    about = {UPTAKE: _eating, RACE: _racing, SHEAR: _shear, FILM: _film}[experiment](found)
    return f"""## {TITLES[experiment]}

{about}

![{TITLES[experiment]}]({FIGURES}/{experiment}.png)

*{CAPTIONS[experiment]}*

{Table.of(table).as_markdown()}"""


def _eating(found: CrowdFindings) -> str:
    world = found.plan.world(CROWD)
    medium = world.medium
    assert medium is not None
    worlds = ", ".join(f"{worlds} of {cells}" for cells, worlds in found.plan.crowds)
    limit = NOTHING if found.limit is None else f"{found.limit:.2f}"
    return f"""Cells climb c = y + 20. Each clears {medium.uptake:g} of it per time, and it spreads with the
diffusivity {medium.diffusivity:g}. Lives last {world.life:g}. Cells start in 10 × 10, in a film of
thickness 1 that goes on for ever to both sides: a torus, 10 wide and 30 high. The height is that of the end
over that of the start; the gain is less where others have eaten, at the end, what was there at the start.
Worlds: {worlds}.

No limit is known where cells eat. The limit of a cell alone, in the same lives where nobody eats, is
{limit}."""


def _racing(found: CrowdFindings) -> str:
    cells = found.plan.settings(found.plan.recipes[0], RACE).evaluation.cells
    return f"""{cells} cells start in 6 × 6 beside an egg, on average nine lengths away, and the first to
arrive closes it. Starts rotate, so that every policy has every start. Worlds for each share:
{found.plan.races}."""


def _shear(found: CrowdFindings) -> str:
    (left, right), (low, high) = found.plan.shear_box
    world, age = found.plan.world(SHEAR), getattr(found.plan.world(SHEAR).field, "age", 0.0)
    kinds = found.samples[f"{SHEAR}_best"]
    chosen = ", ".join(f"{_best(found, kind)} for {look(kind).label}" for kind in kinds)
    return f"""An egg releases steadily, in two dimensions, and began {age:g} before.
{found.plan.shear_cells} cells start anywhere in [{left:g}, {right:g}] × [{low:g}, {high:g}], do not meet,
and live for {world.life:g}. They count molecules, {world.binding_rate:g} per concentration and time, so that
far from the egg they know little. The shear rate at which most arrive is chosen among other cells than those
it is then tested with: {chosen}."""


def _best(found: CrowdFindings, kind: str) -> str:
    best = found.samples[f"{SHEAR}_best"][kind]
    rates = (f"{SHEAR}_{rate:g}" for rate in found.plan.shear_rates)
    return next(name for name in rates if found.samples[name][kind] is best).partition("_")[2]


def _film(found: CrowdFindings) -> str:
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
    told = "; ".join(f"`{each}`" for each in world.interactions)
    chance = math.sqrt(math.pi / plan.film_cells) / 2  # the mean of a random walk's end over its steps
    return f"""{plan.film_cells} cells start in a drop of 60 per unit area, {plan.films} drops; lives last
{world.life:g}. Nothing holds a drop together, and it spreads. Interactions: {told}.
Polar order is the length of the mean heading, which of headings without order would be {chance:.3f}; it and
the distance of the nearest neighbour are means over the later half. What interactions change:

{Table.of(rivals).as_markdown()}"""


def _costs(found: CrowdFindings) -> str:
    if not found.minutes:
        return ""
    table = [
        {"training": name, "minutes, all seeds at once": f"{each:.1f}"}
        for name, each in found.minutes.items()
    ]
    return f"## Trainings\n\n{Table.of(table).as_markdown()}"


# --- figures ------------------------------------------------------------------------------------------------


def draw(samples: Samples, folder: Path) -> list[str]:
    """Draw the figure of every experiment that was measured; their names."""
    (folder / FIGURES).mkdir(parents=True, exist_ok=True)
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
