"""The report: tables, verdicts, figures and words, every number of which was just measured."""

import itertools
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swarm._support.tables import NOTHING, Table, percent
from trainers.jobs.executors import Task
from trainers.studies import zoo
from trainers.studies.claims import Claim
from trainers.studies.estimates import Row, estimate, filled, interval_of, number, printed_by, spread_of
from trainers.studies.paper.illustrations import Drawing, draw_all
from trainers.studies.paper.measurements import SHIPPED, Evidence, Findings, find
from trainers.studies.paper.plan import EGG, VORTICES, Plan
from trainers.studies.paper.tables import (
    AUTHORS_TEST,
    as_dataset,
    result_rows,
    seed_rows,
    tested,
    training_rows,
    where_from,
)
from trainers.studies.plan import Training
from trainers.studies.study import FIGURES, Contents, Study, do

CLAIMS, RESULTS, SEEDS = "claims.json", "results.csv", "seeds.csv"
LIVES = "lives"  # of every cell, a file per test


def text(found: Findings, drawn: Sequence[Drawing]) -> str:
    plan, tests, claims = found.plan, found.tests, found.claims
    missing = set(plan.recipes).difference(*(case.recipes for case in tests))
    how = (
        "The policies tested here are the shipped ones, one for each experiment. Nothing was trained, so the "
        "spread over training seeds is not in the intervals, and claims about training itself are left out"
        + "".join(f"; no policies are shipped for the recipe `{recipe}`" for recipe in sorted(missing))
        if plan.quick
        else f"Every experiment was trained with {plan.n_seeds} independent seeds under each recipe"
    )
    counts = Counter(each.verdict for each in claims).most_common()
    others = [_results(result_rows(found)), _flow(found.evidence), _swinging(found.evidence)]
    others += [_costs(list(training_rows(found))), _drawings(plan, drawn)]
    return filled(
        __package__,
        "report",
        **printed_by(plan, "reproduce"),
        how=how,
        changed=f" Settings that differ from the recipes': {' '.join(plan.words)}." if plan.words else "",
        cells=", ".join(f"{case.name} {case.cells}" for case in tests),
        plan=plan,
        count=len(claims),
        verdicts=", ".join(f"{count} {verdict}" for verdict, count in counts),
        claims=_judged(claims).as_markdown(texts=3),
        others="\n".join(filter(None, others)),
    )


def _judged(claims: Sequence[Claim]) -> Table:
    rows = [
        {
            "verdict": f"**{each.verdict}**",
            "claim": each.claim,
            "recipe": each.recipe,
            "measured": f"{spread_of(each.measurement, each.spread_of_seeds)} {_short(each.unit)}".strip(),
            "95% interval": interval_of(each.interval),
            "criterion": each.criterion,
            "seeds": len(each.seeds) or None,
            "worst seed": number(each.worst_seed),
        }
        for each in claims
    ]
    return Table.of(rows)


def _results(results: Sequence[Row]) -> str:
    parts = ["## Results\n"]
    for name in dict.fromkeys(row["test"] for row in results):
        mine = [row for row in results if row["test"] == name]
        first, columns = mine[0], [_result(row) for row in mine]
        lines = [(said, [column[said] for column in columns]) for said in columns[0]]
        headings, *rows = [
            [said, *values] for said, values in lines if any(each not in (None, NOTHING) for each in values)
        ]
        limit = f", limit {number(first['limit'])}" if first["limit"] else ", no limit known"
        limit += f" ± {error:.2f}" if (error := first["limit_error"] or 0.0) >= 0.005 else ""
        parts.append(f"**{name}** ({first['cells']} cells, lives of at most {first['life']:g}{limit})\n")
        parts.append(Table(headings, rows).as_markdown())
    if any(row["authors"] for row in results):
        parts.append(
            "The authors' network is the one they published for the case, replayed in this model: gain ± std "
            f"of {AUTHORS_TEST}.\n"
        )
    return "\n".join(parts)


def _result(row: Row) -> dict[str, Any]:
    seeds = [number(row[f"{which}_seed"]) for which in ("worst", "median", "best")]
    lead = number(row["lead"], "+")
    if row["lead_low"] is not None:
        lead += f" ({interval_of((row['lead_low'], row['lead_high']))})"
    return {
        "policy": " ".join(filter(None, [row["recipe"], row["policy"]])),
        "gain ± std of cells": spread_of(row["gain"], row["std_of_cells"]),
        "95% interval": interval_of((row["gain_low"], row["gain_high"])),
        "worst / median / best seed": " / ".join(seeds) if (row["seeds"] or 0) > 1 else None,
        "lead over greedy": lead,
        "cells ahead": percent(row["beat_greedy"]),
        "of the limit": percent(row["part_of_limit"]),
        "worst seed, of the limit": percent(row["worst_part_of_limit"]) if row["seeds"] else None,
        "angle ± std of seeds [°]": spread_of(row["angle"], row["std_of_angle"]),
        "swinging broken": percent(row["pattern_broken"]),
        "wave": number(row["wave"]),
        "arrived": percent(row["arrived"]),
        "mean time": number(row["mean_lifetime"]),
        "authors' network": spread_of(row["authors"], row["std_of_authors"]),
    }


def _flow(evidence: Evidence) -> str:
    """The worst aware seed of each recipe less the best blind one of each."""
    lives, lines = evidence.cases[VORTICES].lives if VORTICES in evidence.cases else {}, []
    for (recipe, kind), (other, other_kind) in itertools.product(lives, repeat=2):
        if (kind, other_kind) == ("aware", "blind"):
            aware, blind = lives[recipe, kind], lives[other, other_kind]
            worst, best = aware.gain.mean(axis=1).argmin(), blind.gain.mean(axis=1).argmax()
            found = estimate(aware.gain[worst : worst + 1], blind.gain[best : best + 1])
            lines.append(
                f"- the worst seed of {recipe} aware ({aware.seeds[worst]}) less the best of {other} blind "
                f"({blind.seeds[best]}): {number(found.value, '+')}, 95% interval "
                f"{interval_of(found.interval)}\n"
            )
    return "In the flow, cell by cell:\n\n" + "".join(lines) if lines else ""


def _swinging(evidence: Evidence) -> str:
    rows = [
        {
            "test": name,
            "fitted radius": f"{circle.fitted.mean():.4f}",
            "predicted radius": f"{circle.predicted:.4f}",
            "farthest off, per radius": number(float(circle.deviation.max())),
            "time of a revolution": number(circle.revolution),
        }
        for name, circle in evidence.circles.items()
    ]
    title = "Circles of swinging, through the centres of the arcs with the lowest curvature:"
    return f"{title}\n\n{Table.of(rows).as_markdown()}" if rows else ""


def _costs(costs: Sequence[Row]) -> str:
    if not costs:
        return ""
    commits = ", ".join(sorted({row["commit"] for row in costs}))
    table = Table.of(costs, [heading for heading in costs[0] if heading != "commit"])
    return f"## Trainings\n\nTrained by commit {commits}.\n\n{table.as_markdown()}"


def _drawings(plan: Plan, drawn: Sequence[Drawing]) -> str:
    parts = ["## Figures\n"]
    if plan.quick and any(each.number == 1 for each in drawn):
        parts.append("The training curves are those that are shipped with the policies.\n")
    elif plan.quick:
        parts.append("Training curves are left out: nothing was trained, and none are shipped.\n")
    for recipe in dict.fromkeys(each.recipe for each in drawn):
        parts.append(f"### Recipe `{recipe}`\n")
        for each in drawn:
            if each.recipe == recipe:
                parts.append(f"![Figure {each.number}, {recipe}]({each.path})\n")
                parts.append(f"*Figure {each.number}. {each.caption}*\n")
    return "\n".join(parts)


def _short(unit: str) -> str:
    return {"degrees": "°"}.get(unit, "" if unit.startswith("concentration") else unit)


# --- the whole ----------------------------------------------------------------------------------------------


def write(plan: Plan, planned: Sequence[Training], found: Findings, folder: Path) -> Contents:
    """Every figure of the paper under every recipe, lives, policies to be shipped, and tables."""
    few, fewer = plan.figure_cells, plan.radial_figure_cells
    shown = [case._replace(cells=fewer if case.name == EGG else few) for case in found.tests]
    curves = {key: each.curve for key, each in found.trained.items() if each.curve is not None}
    recipes = dict.fromkeys(recipe for case in found.tests for recipe in case.recipes)
    tasks = [Task(recipe, draw_all, (recipe, curves, shown, folder)) for recipe in recipes]
    drawn = [each for some in do(plan.executor(on_disk=True), tasks, "figures").values() for each in some]
    (folder / LIVES).mkdir()
    for case in found.tests:
        data = as_dataset(case, found.evidence.cases[case.name])
        compressed = {name: {"zlib": True} for name in data.data_vars}
        data.to_netcdf(folder / LIVES / f"{case.name}.nc", engine="h5netcdf", encoding=compressed)
        for stack in case.stacks if planned else ():
            if stack.recipe == SHIPPED and stack.kind != "still":
                trained = found.trained[stack.recipe, stack.experiment]
                zoo.put(folder / zoo.FOLDER, trained, tested(stack, case, found))
    return Contents(
        {RESULTS: result_rows(found), SEEDS: list(seed_rows(found))},
        text(found, drawn),
        {"trainings": where_from(found)},
        {CLAIMS: found.claims},
    )


STUDY = Study("radial_cells", (CLAIMS, RESULTS, SEEDS), find, write, (FIGURES, LIVES))
