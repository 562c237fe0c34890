"""The report in words: verdicts, tables and figures, every number of which was just measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from swarm._support import provenance
from trainers.paper import tables
from trainers.paper.claims import Claim
from trainers.paper.illustrations import Drawing
from trainers.paper.measurements import Case
from trainers.paper.plan import Plan
from trainers.paper.statements import VORTICES, Evidence
from trainers.paper.tables import Row


def text(
    plan: Plan,
    tests: Sequence[Case],
    evidence: Evidence,
    claims: Sequence[Claim],
    results: Sequence[Row],
    costs: Sequence[Row],
    drawn: Sequence[Drawing],
) -> str:
    """Markdown, to be read on its own."""
    parts = [_opening(plan, tests), _verdicts(claims), _results(results), _flow(evidence)]
    parts += [_swinging(evidence), _costs(costs), _drawings(plan, drawn)]
    return "\n".join(part for part in parts if part)


def _opening(plan: Plan, tests: Sequence[Case]) -> str:
    command = "swarm reproduce" + " --quick" * plan.quick
    if not plan.quick and plan.n_seeds != Plan().n_seeds:
        command += f" --seeds {plan.n_seeds}"
    versions = ", ".join(f"{name} {version}" for name, version in provenance.versions().items())
    there = {stack.recipe for case in tests for stack in case.stacks}
    missing = [f"`{recipe}`" for recipe in plan.recipes if recipe not in there]
    how = (
        "The policies tested here are the shipped ones, one for each experiment. Nothing was trained, so the "
        "spread over training seeds is not in the intervals, and claims about training itself are left out"
        + (f"; no policies are shipped for the recipe {', '.join(missing)}." if missing else ".")
        if plan.quick
        else f"Every experiment was trained with {plan.n_seeds} independent seeds under each recipe."
    )
    cells = ", ".join(f"{case.name} {case.cells}" for case in tests)
    changed = f" Settings that differ from the recipes': {' '.join(plan.words)}." if plan.words else ""
    return f"""# Reproduction of the paper

Printed by `{command}`; to be changed by running it again, not by hand.

{how}{changed} Test cells: {cells}; population seed {plan.seed}; no test cell was used in training or in
choosing a policy. Intervals are 95% percentile bootstraps over training seeds and test cells. In figures, the
policy of a stack of seeds is the one that its validation population prefers.

{versions}; commit {provenance.commit() or "unknown"}.
"""


def _verdicts(claims: Sequence[Claim]) -> str:
    rows = [
        [
            f"{each.claim}",
            each.recipe or "–",
            f"{_number(each.measurement)} {_short(each.unit)}".strip(),
            _interval(each.interval),
            each.criterion,
            str(len(each.seeds)) if each.seeds else "–",
            _number(each.worst_seed),
            f"**{each.verdict}**",
        ]
        for each in claims
    ]
    verdicts = Counter(each.verdict for each in claims)
    summary = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.most_common())
    headings = ["claim", "recipe", "measured", "95% interval", "criterion", "seeds", "worst seed", "verdict"]
    return f"""## Claims

{len(claims)} claims: {summary}. A claim is reproduced where the whole interval satisfies the criterion, and
reversed where the whole interval is on the other side of it. `claims.json` holds the same in more detail.

{tables.as_markdown(headings, rows)}"""


def _results(results: Sequence[Row]) -> str:
    limits = any(row["limit"] for row in results)
    authors = any(row["authors"] for row in results)
    headings = ["policy", "gain ± std of cells", "95% interval", "worst / median / best seed"]
    headings += ["lead over greedy", *["of the limit", "worst seed, of the limit"] * limits]
    headings += ["angle to the gradient"]
    headings += ["authors' network"] * authors
    parts = ["## Results\n"]
    for name in dict.fromkeys(row["test"] for row in results):
        mine = [row for row in results if row["test"] == name]
        columns = [*headings, "arrived", "mean time"] if mine[0]["arrived"] is not None else headings
        rows = [_result(row, columns) for row in mine]
        shown = [place for place in range(len(columns)) if any(row[place] not in ("–", "") for row in rows)]
        rows = [[row[place] for place in shown] for row in rows]
        limit = f", limit {_number(mine[0]['limit'])}" if mine[0]["limit"] else ", no limit known"
        limit += f" ± {error:.2f}" if (error := mine[0]["limit_error"] or 0.0) >= 0.005 else ""
        parts.append(f"**{name}** ({mine[0]['cells']} cells, lives of at most {mine[0]['life']:g}{limit})\n")
        parts.append(tables.as_markdown([columns[place] for place in shown], rows))
    if authors:
        parts.append(
            "The authors' network is the one they published for the case, replayed in this model: its mean "
            "gain.\n"
        )
    return "\n".join(parts)


def _result(row: Row, columns: Sequence[str]) -> list[str]:
    seeds = "–"
    if (row["seeds"] or 0) > 1:
        seeds = " / ".join(_number(row[f"{which}_seed"]) for which in ("worst", "median", "best"))
    interval = None if row["gain_low"] is None else (row["gain_low"], row["gain_high"])
    lead = _number(row["lead"], sign=True)
    if row["lead_low"] is not None:
        lead += f" ({_number(row['lead_low'])} … {_number(row['lead_high'])})"
    values = {
        "policy": " ".join(filter(None, [row["recipe"], row["policy"]])),
        "gain ± std of cells": f"{_number(row['gain'])} ± {_number(row['std_of_cells'])}",
        "95% interval": _interval(interval),
        "worst / median / best seed": seeds,
        "lead over greedy": lead,
        "of the limit": _percent(row["part_of_limit"]),
        "worst seed, of the limit": _percent(row["worst_part_of_limit"]) if row["seeds"] else "–",
        "angle to the gradient": "–" if row["angle"] is None else f"{_number(row['angle'])}°",
        "authors' network": _number(row["authors"]),
        "arrived": _percent(row["arrived"]),
        "mean time": _number(row["mean_lifetime"]),
    }
    return [values[name] for name in columns]


def _flow(evidence: Evidence) -> str:
    """The worst aware seed against the best blind one of all recipes."""
    if VORTICES not in evidence.cases:
        return ""
    lives = evidence.cases[VORTICES].lives
    lines = []
    for (recipe, kind), aware in lives.items():
        for (other, rival), blind in lives.items():
            if kind == "aware" and rival == "blind":
                first, second, found = tables.paired(aware, blind, evidence.seed)
                lines.append(
                    f"- the worst seed of {recipe} aware ({first}) less the best of {other} blind "
                    f"({second}): {_number(found.value, sign=True)}, 95% interval {_interval(found.interval)}"
                )
    if not lines:
        return ""
    return "In the flow, cell by cell:\n\n" + "\n".join(lines) + "\n"


def _swinging(evidence: Evidence) -> str:
    if not evidence.circles:
        return ""
    rows = [
        [
            name,
            f"{circle.fitted.mean():.4f}",
            f"{circle.predicted:.4f}",
            _number(float(circle.deviation.max())),
            _number(circle.revolution),
        ]
        for name, circle in evidence.circles.items()
    ]
    headings = [
        "test",
        "fitted radius",
        "predicted radius",
        "farthest off, per radius",
        "time of a revolution",
    ]
    table = tables.as_markdown(headings, rows)
    return f"Circles of swinging, through the centres of the arcs with the lowest curvature:\n\n{table}"


def _costs(costs: Sequence[Row]) -> str:
    if not costs:
        return ""
    headings = ["training", "seeds", "cells", "hidden layers", "γ", "life", "epochs"]
    headings += ["minutes, all seeds at once"]
    rows = [
        [
            f"{row['recipe']} {row['experiment']}",
            str(row["seeds"]),
            str(row["cells"]),
            row["hidden"],
            f"{row['discount']:g}",
            f"{row['life']:g}",
            str(row["epochs"]),
            _cost(row),
        ]
        for row in costs
    ]
    commits = ", ".join(sorted({str(row["commit"] or "unknown") for row in costs}))
    return f"## Trainings\n\nTrained by commit {commits}.\n\n{tables.as_markdown(headings, rows)}"


def _cost(row: Row) -> str:
    shared = row["run"] != f"{row['recipe']}/{row['experiment']}"
    return f"the run of {row['run']}" if shared else f"{row['seconds'] / 60:.1f}"


def _drawings(plan: Plan, drawn: Sequence[Drawing]) -> str:
    parts = ["## Figures\n"]
    if plan.quick:
        if any(each.number == 1 for each in drawn):
            parts.append("The training curves are those that are shipped with the policies.\n")
        else:
            parts.append("Training curves are left out: nothing was trained, and none are shipped.\n")
    for recipe in dict.fromkeys(each.recipe for each in drawn):
        parts.append(f"### Recipe `{recipe}`\n")
        for each in drawn:
            if each.recipe == recipe:
                parts.append(f"![Figure {each.number}, {recipe}]({each.path})\n")
                parts.append(f"*Figure {each.number}. {each.caption}*\n")
    return "\n".join(parts)


def _number(value: float | None, *, sign: bool = False) -> str:
    if value is None:
        return "–"
    if 0 < abs(value) < 5e-4:
        return f"{value:.1g}"
    digits = 2 if abs(value) >= 1 else 3
    return f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"


def _interval(interval: tuple[float, float] | None) -> str:
    return "–" if interval is None else f"{_number(interval[0])} … {_number(interval[1])}"


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.1f}%"


def _short(unit: str) -> str:
    return {"concentration": "", "degrees": "°"}.get(unit, "" if unit.startswith("concentration") else unit)
