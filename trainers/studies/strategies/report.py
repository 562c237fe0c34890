"""The report on all strategies: a table, a figure and words, every number of which was just measured."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from swarm import figures
from swarm._support.tables import Table, percent
from swarm.figures import style
from trainers.studies.estimates import Row, columns, filled, half, percent_of, printed_by
from trainers.studies.plan import Training
from trainers.studies.strategies.measurements import ANY, LIMIT, WorldFindings, find
from trainers.studies.strategies.plan import DQN, MINIMAL, OPTIMAL, PPO, STRATEGIES, WORLDS, StrategiesPlan
from trainers.studies.study import FIGURES, Contents, Study

FIGURE, RESULTS = "strategies.png", "results.csv"
PANELS = 4  # side by side
COLOURS = {DQN: "#0072B2", PPO: "#E69F00", MINIMAL: "#CC79A7", OPTIMAL: style.INK}  # others: devised
DEVISED = "#009E73"
OWN = f"{STRATEGIES[PPO]}, of its own limit"


def rows(name: str, found: WorldFindings) -> Iterator[Row]:
    for strategy in STRATEGIES:
        seeds, cells = found.lived[strategy].gain.shape if strategy in found.lived else (None, None)
        row: Row = {"world": name, "strategy": strategy, "seeds": seeds, "cells": cells}
        own = found.fraction(strategy, any_curvature=True) if strategy == PPO else None
        numbers = {"gain": found.gain(strategy), "of the limit": found.fraction(strategy)}
        numbers |= {"of its own limit": own, "arrived": found.arrived(strategy)}
        numbers["time to the egg"] = found.time_to_egg(strategy)
        for what, number in numbers.items():
            row |= columns(what, number) | {f"{what}, worst seed": number and number.lowest}
        yield row | {"why not": found.why_not.get(strategy)}


def text(plan: StrategiesPlan, found: Mapping[str, WorldFindings]) -> str:
    words = [] if plan.worlds == WORLDS else [f"experiment={','.join(plan.worlds)}"]
    return filled(
        __package__,
        "report",
        **printed_by(plan, "strategies", *words, *plan.words),
        plan=plan,
        fractions=fractions(found).as_markdown(),
        figure=f"{FIGURES}/{FIGURE}",
        gains=_gains(found).as_markdown(),
        egg=_egg(found),
        reasons="\n".join(_reasons(found)) or "There is none.",
    )


def _table(found: Mapping[str, WorldFindings], cell: Callable[[WorldFindings, str], Any]) -> list[Row]:
    """A row for each strategy, in which each world has a cell."""
    return [
        {"strategy": label, **{name: cell(each, strategy) for name, each in found.items()}}
        for strategy, label in STRATEGIES.items()
    ]


def fractions(found: Mapping[str, WorldFindings]) -> Table:
    """What part of the limit each strategy attains in each world."""
    table = _table(found, lambda each, strategy: percent_of(each.fraction(strategy)))
    own = {name: percent_of(each.fraction(PPO, any_curvature=True)) for name, each in found.items()}
    table.insert(list(STRATEGIES).index(PPO) + 1, {"strategy": OWN, **own})
    return Table.of(table)


def overview(found: Mapping[str, WorldFindings]) -> Table:
    """What part of the limit, or where none is known how many arrive, or else what is gained."""

    def cell(each: WorldFindings, strategy: str) -> str | None:
        if each.possible is not None:
            return percent_of(each.fraction(strategy))
        return _gain(each, strategy) if each.world.egg is None else percent_of(each.arrived(strategy))

    def heading(name: str, each: WorldFindings) -> str:
        instead = ", gain" if each.world.egg is None else ", arrived"
        return name if each.possible is not None else name + instead

    return Table.of(_table({heading(name, each): each for name, each in found.items()}, cell))


def _gain(found: WorldFindings, strategy: str) -> str | None:
    number = found.gain(strategy)
    return number and f"{number.value:.2f} ± {half(number, 2)}"


def _gains(found: Mapping[str, WorldFindings]) -> Table:
    table = _table(found, _gain)
    for label, field in ((LIMIT, "possible"), (ANY, "any_curvature")):
        limits = {name: getattr(each, field) for name, each in found.items()}
        told = {name: None if most is None else f"{most.mean():.2f}" for name, most in limits.items()}
        table.append({"strategy": label, **told})
    return Table.of(table)


def _egg(found: Mapping[str, WorldFindings]) -> str:
    around = {name: each for name, each in found.items() if each.world.egg is not None}
    if not around:
        return ""
    table = []
    for strategy, label in STRATEGIES.items():
        row: Row = {"strategy": label}
        for name, each in around.items():
            part, time = each.arrived(strategy), each.time_to_egg(strategy)
            low, high = (part and part.interval) or (float("nan"), float("nan"))
            row[name] = part and f"{percent(part.value)} ({100 * low:.1f} … {100 * high:.1f})"
            row[f"{name}, time"] = time and f"{time.value:.0f} ± {half(time, 0)}"
        table.append(row)
    return filled(__package__, "egg", table=Table.of(table).as_markdown())


def _reasons(found: Mapping[str, WorldFindings]) -> list[str]:
    """Why there is a dash."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for name, each in found.items():
        for what, reason in each.why_not.items():
            if what != OPTIMAL:
                reasons.setdefault((STRATEGIES.get(what, what), reason), []).append(name)
    return [f"- {label} in {', '.join(names)}: {reason}." for (label, reason), names in reasons.items()]


# --- the figure ---------------------------------------------------------------------------------------------


def draw(found: Mapping[str, WorldFindings], folder: Path) -> None:
    columns = min(PANELS, len(found))
    lines = -(-len(found) // columns)
    with style.in_style():
        figure = style.canvas(1.0, 0.08 + 0.3 * lines)
        panels = figure.subplots(lines, columns, sharey=True, squeeze=False)
        for axes, (name, each) in zip(panels.flat, found.items(), strict=False):
            _panel(axes, each)
            axes.set_title(style.plain(name))
        for axes in panels.flat[len(found) :]:
            axes.set_visible(False)
        panels[0, 0].set_yticks(
            range(len(STRATEGIES)), [label.split(":")[0] for label in STRATEGIES.values()]
        )
        panels[0, 0].invert_yaxis()
        figures.save(figure, folder / FIGURES / FIGURE)


def _panel(axes: Any, found: WorldFindings) -> None:
    """Fractions of the limit with their intervals; around an egg the part that arrives."""
    egg = found.world.egg is not None
    for place, strategy in enumerate(STRATEGIES):
        number = found.arrived(strategy) if egg else found.fraction(strategy)
        if number is None:
            axes.text(0.0, place, "–", ha="center", va="center", color="#777777")
            continue
        ends = number.interval or (number.value, number.value)
        apart = [[number.value - ends[0]], [ends[1] - number.value]]
        colour = COLOURS.get(strategy, DEVISED)
        axes.errorbar(number.value, place, xerr=apart, color=colour, marker="o", ms=4, capsize=2, lw=1)
        axes.plot([0, number.value], [place, place], color=colour, lw=0.8, alpha=0.5, zorder=0)
    axes.axvline(1.0, color="#bbbbbb", lw=0.6, zorder=0)
    axes.set(xlim=(-0.08, 1.08), xlabel="part that arrives" if egg else "of the limit")
    axes.set_xticks([0, 0.5, 1], ["0", "50%", "100%"])


# --- the whole ----------------------------------------------------------------------------------------------


def write(
    plan: StrategiesPlan, planned: Sequence[Training], found: Mapping[str, WorldFindings], folder: Path
) -> Contents:
    draw(found, folder)
    return Contents(
        {RESULTS: [row for name, each in found.items() for row in rows(name, each)]}, text(plan, found)
    )


STUDY = Study("worlds", (RESULTS,), find, write, needs=("the search for the smallest brain needs", "cma"))
