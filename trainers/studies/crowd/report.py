"""The report on crowds in words: verdicts, tables and figures, every number of which was just measured."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from swarm._support.tables import NOTHING, Table
from swarm.figures.style import look
from trainers.studies.claims import NOT_REPRODUCED, REPRODUCED, REVERSED, Claim
from trainers.studies.crowd.illustrations import CAPTIONS, PANELS, places
from trainers.studies.crowd.measurements import MEASURES, CrowdEvidence, level
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


class CrowdFindings(NamedTuple):
    """All that the experiments came to."""

    plan: CrowdPlan
    evidence: CrowdEvidence
    claims: Sequence[Claim]  # their verdicts in the words of `VERDICTS`
    trained: dict[str, Trained]  # by experiment
    limit: float | None  # of a cell alone, in the same lives
    minutes: dict[str, float]  # of every training


def rows(found: CrowdFindings, experiment: str) -> Iterator[dict[str, Any]]:
    """A row for every point and kind of an experiment."""
    for name in places(found.plan, experiment):
        for kind, sample in found.evidence.found[name].items():
            row: dict[str, Any] = {"experiment": experiment, "at": name.partition("_")[2], "policy": kind}
            row |= {"seeds": len(sample.seeds) or None, "units": next(iter(sample.numbers.values())).shape[1]}
            for panel in PANELS[experiment]:
                row |= columns(panel.measure, level(sample, panel.measure))
            yield row


def text(found: CrowdFindings, drawn: Sequence[str]) -> str:
    """Markdown, to be read on its own."""
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
    for name in places(found.plan, experiment):
        for kind, sample in found.evidence.found[name].items():
            row = {"at": name.partition("_")[2], "policy": look(kind).label}
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
    kinds = found.evidence.found[f"{SHEAR}_best"]
    chosen = ", ".join(f"{_best(found, kind)} for {look(kind).label}" for kind in kinds)
    return f"""An egg releases steadily, in two dimensions, and began {age:g} before.
{found.plan.shear_cells} cells start anywhere in [{left:g}, {right:g}] × [{low:g}, {high:g}], do not meet,
and live for {world.life:g}. They count molecules, {world.binding_rate:g} per concentration and time, so that
far from the egg they know little. The shear rate at which most arrive is chosen among other cells than those
it is then tested with: {chosen}."""


def _best(found: CrowdFindings, kind: str) -> str:
    best = found.evidence.found[f"{SHEAR}_best"][kind]
    rates = (f"{SHEAR}_{rate:g}" for rate in found.plan.shear_rates)
    return next(name for name in rates if found.evidence.found[name][kind] is best).partition("_")[2]


def _film(found: CrowdFindings) -> str:
    plan, world = found.plan, found.plan.world(FILM)
    rivals = []
    for variant in list(VARIANTS)[1:]:
        for kind, sample in found.evidence.found[f"{FILM}_{variant}"].items():
            neither = found.evidence.found[f"{FILM}_neither"][kind]
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
