"""The report on the smallest brain: tables, a figure and words, every number of which was just measured."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarm import figures
from swarm._support.tables import Table, percent
from swarm.figures import style
from trainers.studies.estimates import estimate, filled, percent_of, printed_by
from trainers.studies.minimal import drawing
from trainers.studies.minimal.brain import Brains
from trainers.studies.minimal.measurements import (
    LEVELS,
    MACHINE,
    METHODS,
    PRUNED,
    THINNED,
    CaseFindings,
    Findings,
    Measured,
    find,
    lived,
)
from trainers.studies.minimal.plan import DQN, EVOLUTION, MinimalPlan
from trainers.studies.minimal.tables import Tabulated
from trainers.studies.plan import Training
from trainers.studies.study import FIGURES, Contents, Study

FIGURE, RESULTS = "parameters.png", "results.csv"
ROUNDING = 1e-3  # part of the gain that rounding may cost
COLOURS = ("#0072B2", "#56B4E9", "#D55E00", "#E69F00", "#009E73", "#222222")
LOOKS = dict(zip(METHODS, zip(COLOURS, "o.s^vD", strict=True), strict=True))


class Drawn(NamedTuple):
    """The brain that is drawn, and what it gains when its numbers are rounded as in the drawing."""

    source: Measured
    seed: int
    digits: int
    brain: Brains
    gain: float  # mean of the test cells [concentration]


def rows(case: str, found: CaseFindings) -> Iterator[dict[str, Any]]:
    for each in found.measured:
        of_limit = found.fraction(each)
        low, high = of_limit.interval or (None, None)
        yield {
            "experiment": case,
            "method": each.rung.method,
            "nodes": each.rung.nodes,
            "parameters": each.rung.parameters,
            "validation, of the limit": float(each.validation.mean()) / found.validation_limit,
            "gain": float(each.gain.mean()),
            "of the limit": of_limit.value,
            "low": low,
            "high": high,
            "worst seed": of_limit.lowest,
        }


def text(plan: MinimalPlan, found: Findings, drawn: Mapping[str, Drawn]) -> str:
    said = (
        "Fewest parameters with which the validation cells reach the level in the mean over seeds, and what "
        "of the limit the test cells then gain, the worst seed in brackets."
    )
    for case, each in found.cases.items():
        if each.attainable:
            said += (
                f" In {case} two records leave the heading ambiguous: levels are of {each.attainable:g}, "
                "about the most that they allow; percentages are of the limit everywhere."
            )
    return filled(
        __package__,
        "report",
        **printed_by(plan, "minimal", f"experiment={','.join(plan.cases)}", *plan.words),
        plan=plan,
        ladder=", ".join(map(str, plan.nodes)),
        thinned=METHODS[THINNED],
        begun=" and ".join(map(str, plan.thinned)),
        said=textwrap.fill(said, 109),
        smallest=smallest(found.cases).as_markdown(texts=2),
        figure=f"{FIGURES}/{FIGURE}",
        cases="\n".join(_case(plan, case, each, drawn[case]) for case, each in found.cases.items()),
        first=plan.cases[0],
        tables=_tabulated(plan, found.tables).as_markdown(),
    )


def smallest(found: Mapping[str, CaseFindings]) -> Table:
    """For each experiment and method the fewest parameters that reach each level."""
    table = []
    for case, each in found.items():
        for method, label in METHODS.items():
            row: dict[str, Any] = {"experiment": case, "method": label}
            for level in LEVELS:
                row |= _of_level(each, each.smallest(method, level), f"{100 * level:g}%")
            table.append(row)
    return Table.of(table)


def _of_level(found: CaseFindings, each: Measured | None, level: str) -> dict[str, Any]:
    if each is None:
        return {f"parameters for {level}": None, f"test, {level}": None}
    numbers = found.fraction(each)
    told = f"{percent_of(numbers)} ({percent(numbers.lowest)})"
    return {f"parameters for {level}": each.rung.parameters, f"test, {level}": told}


def _case(plan: MinimalPlan, case: str, found: CaseFindings, drawn: Drawn) -> str:
    ladder = []
    for nodes in plan.nodes:
        row: dict[str, Any] = {"nodes": nodes}
        for method in (DQN, EVOLUTION):
            (each,) = [one for one in found.measured if one.rung[:2] == (method, nodes)]
            row |= {"parameters": each.rung.parameters, METHODS[method]: percent_of(found.fraction(each))}
        ladder.append(row)
    sizes = [
        {"parameters": each.rung.parameters, METHODS[THINNED]: percent_of(found.fraction(each))}
        for each in found.by_size(THINNED)[:8]
    ]
    (pair,) = [each for each in found.measured if each.rung.method == MACHINE]
    a, b = _thresholds(pair.rung.brains)
    world = plan.test_world(case)
    torsions = world.torsions or (0.0,) * world.n_actions
    radii = [k / (k * k + t * t) for k, t in zip(world.curvatures, torsions, strict=True)]
    return filled(
        __package__,
        "case",
        case=case,
        found=found,
        drawn=drawn,
        greedy=percent(float(found.greedy.mean()) / found.limit),
        pair=percent_of(found.fraction(pair)),
        a=a,
        b=b,
        path="circle" if world.torsions is None else "helix across the gradient",
        swing=" to ".join(f"±{world.mean_curvature * radius:.2f}" for radius in radii),
        ladder=Table.of(ladder).as_markdown(),
        sizes=Table.of(sizes).as_markdown(),
        figures=FIGURES,
        most=drawing.MOST,
        method=METHODS[drawn.source.rung.method],
        of_limit=percent(drawn.gain / found.limit),
        exact=float(drawn.source.gain[drawn.seed].mean()),
        lines="\n".join(drawing.formulas(drawn.brain, drawn.digits)),
        computed=textwrap.fill(f"What it computes: {drawing.words(drawn.brain, world)}", 109),
    )


def _thresholds(brains: Brains) -> Iterator[str]:
    """a and b of the two-state machine."""
    push, bias = brains.weights[:, 0, 1], brains.biases[:, 0]
    for values in (push - bias, -push - bias):
        yield f"{values.mean():+.2f} ± {values.std():.2f}"


def _tabulated(plan: MinimalPlan, tables: Sequence[Tabulated]) -> Table:
    rows = []
    for n_records in plan.records:
        row: dict[str, Any] = {"N_T": n_records}
        for each in (one for one in tables if one.n_records == n_records):
            of_limit = percent_of(estimate(each.gain / each.limit))
            row[f"{each.bins} bins"] = f"{of_limit} ({each.entries})"
        rows.append(row)
    return Table.of(rows)


# --- the figure ---------------------------------------------------------------------------------------------


def draw(found: Mapping[str, CaseFindings], folder: Path) -> None:
    with style.in_style():
        figure = style.canvas(1.0, 0.5 if len(found) < 3 else 0.4)
        panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
        for place, (axes, (case, each)) in enumerate(zip(panels, found.items(), strict=True)):
            _panel(axes, each)
            axes.set(title=style.plain(case), xlabel="parameters")
            if not place:
                axes.set_ylabel("missing of the limit")
        handles = dict(zip(*panels[0].get_legend_handles_labels()[::-1], strict=True))
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4)
        figures.save(figure, folder / FIGURES / FIGURE)


def _panel(axes: Any, found: CaseFindings) -> None:
    """What of the limit is missing, by the number of parameters, on logarithmic axes."""
    for method, label in METHODS.items():
        rows = found.by_size(method)
        if method == PRUNED:  # of networks of all widths
            means = [each.validation.mean() for each in rows]
            rows = [
                each for place, each in enumerate(rows) if means[place] > max(means[:place], default=-np.inf)
            ]
        if not rows:
            continue
        colour, marker = LOOKS[method]
        sizes = [each.rung.parameters for each in rows]
        numbers = [found.fraction(each) for each in rows]
        missing = np.array([1 - each.value for each in numbers])
        ends = np.array([1 - np.array(each.interval or (np.nan, np.nan)) for each in numbers])
        apart = np.abs(ends[:, ::-1] - missing[:, None]).T
        axes.errorbar(
            sizes, missing, apart, color=colour, marker=marker, ms=4, lw=0.9, elinewidth=0.7, label=label
        )
        for fewest in filter(None, (found.smallest(method, level) for level in LEVELS)):
            at = fewest.rung.parameters, 1 - found.fraction(fewest).value
            axes.plot(*at, "o", ms=9, mfc="none", mec=colour, mew=0.8)
    axes.axhline(
        1 - found.greedy.mean() / found.limit, color="#777777", lw=0.8, ls=(0, (4, 2)), label="greedy"
    )
    axes.set(xscale="log", yscale="log", ylim=(1.2, 0.003))
    axes.set_yticks([1, 0.3, 0.1, 0.05, 0.03, 0.01, 0.005], ["100%", "30%", "10%", "5%", "3%", "1%", "0.5%"])
    axes.minorticks_off()
    axes.set_xticks([1, 3, 10, 30, 100, 300], ["1", "3", "10", "30", "100", "300"])
    for level in LEVELS:
        axes.axhline(
            1 - level * (found.attainable or found.limit) / found.limit, color="#bbbbbb", lw=0.6, zorder=0
        )


# --- the whole ----------------------------------------------------------------------------------------------


def chosen(case: str, plan: MinimalPlan, found: CaseFindings) -> Drawn:
    """The smallest brain of all methods that reaches the highest level of those that can be drawn, of the
    seed that validation prefers, its numbers rounded as far as that costs next to nothing.
    """
    for level in (*LEVELS[::-1], -np.inf):
        smallest = filter(None, (found.smallest(method, level) for method in METHODS))
        fit = [each for each in smallest if each.rung.parameters <= drawing.MOST]
        if fit:
            break
    source = min(fit, key=lambda each: (each.rung.parameters, -float(each.validation.mean())))
    seed = int(np.argmax(source.validation))
    exact = source.rung.brains[seed : seed + 1]
    for digits in range(1, 7):
        brain = drawing.rounded(exact, digits)
        if lived(case, plan, brain, "validation").mean() >= (1 - ROUNDING) * source.validation[seed]:
            break
    return Drawn(source, seed, digits, brain, float(lived(case, plan, brain, "test").mean()))


def write(plan: MinimalPlan, planned: Sequence[Training], found: Findings, folder: Path) -> Contents:
    """The figure, a drawing of each case's smallest brain, and tables."""
    draw(found.cases, folder)
    drawn = {case: chosen(case, plan, each) for case, each in found.cases.items()}
    for case, each in drawn.items():
        path = folder / FIGURES / f"brain_{case}.svg"
        drawing.draw(each.brain, each.digits, f"{case}: {int(each.brain.parameters[0])} parameters", path)
    told = {case: {"gain": each.gain, "inputs": each.brain.inputs} for case, each in drawn.items()}
    table = [row for case, each in found.cases.items() for row in rows(case, each)]
    return Contents({RESULTS: table}, text(plan, found, drawn), {"drawn": told})


STUDY = Study("nodes", (RESULTS,), find, write, needs=("the searches need", "cma", "neat"))
