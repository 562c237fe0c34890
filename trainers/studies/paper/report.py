"""The report: tables, verdicts, figures and words, every number of which was just measured."""

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from swarm._support.tables import NOTHING, Table, percent
from swarm.population.results import RIVAL
from swarm.population.statistics import fraction_of_limit
from trainers.studies.claims import DEVISED, Claim
from trainers.studies.estimates import (
    Row,
    columns,
    estimate,
    filled,
    interval_of,
    number,
    printed_by,
    spread_of,
)
from trainers.studies.paper.illustrations import Drawing
from trainers.studies.paper.measurements import MEASURES, Case, Evidence, Measured
from trainers.studies.paper.plan import VORTICES, Plan
from trainers.studies.plan import Training
from trainers.studies.stacks import Key, Trained
from trainers.training import run_folder as runs
from trainers.training.run_folder import RunFolder

# Gains of the networks that the paper's authors published (github.com/mokchie/chemotaxis, v0saved_model of
# commit 2f750d9), replayed in this model on the plan's own test cells: mean and standard deviation over them.
AUTHORS = {
    ("linear_n2", "dqn"): (22.10, 1.13),
    ("linear_n4", "dqn"): (24.52, 0.31),
    ("linear_n8", "dqn"): (20.78, 0.22),
    (VORTICES, "still"): (48.52, 3.18),
}
AUTHORS_TEST = "400 cells of the population seed 100, lives of 200, in the flow of 400"


class Findings(NamedTuple):
    plan: Plan
    planned: Sequence[Training]  # none where shipped policies are tested
    trained: Mapping[Key, Trained]
    tests: Sequence[Case]
    evidence: Evidence
    claims: Sequence[Claim]


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


# --- tables of results --------------------------------------------------------------------------------------


def result_rows(found: Findings) -> list[Row]:
    """A row for every policy or strategy in every test."""
    outcomes = [(case, found.evidence.cases[case.name]) for case in found.tests]
    return [_result_row(case, outcome, key) for case, outcome in outcomes for key in outcome.lives]


def _result_row(case: Case, measured: Measured, key: Key) -> Row:
    (recipe, kind), lives = key, measured.lives[key]
    of_mean, by_seed = estimate(lives.gain), lives.gain.mean(axis=1)
    greedy, rival = measured.lives[DEVISED, RIVAL], kind == RIVAL
    still = case.world.egg is None and not case.world.in_flow
    angle = MEASURES["angle"].values(lives).mean(axis=1) if still and kind != "swinging" else None
    authors = AUTHORS.get((case.name, kind), (None, None)) if recipe == "paper" else (None, None)
    return {
        "test": case.name,
        "recipe": recipe or None,
        "policy": kind,
        "seeds": len(lives.seeds) or None,
        "cells": lives.gain.shape[1],
        "life": case.world.life,
        **columns("gain", of_mean, "_"),
        "std_of_cells": float(lives.gain.std(axis=1).mean()),
        "std_of_seeds": _spread(by_seed),
        "worst_seed": of_mean.lowest,
        "median_seed": float(np.quantile(by_seed, 0.5, method="lower")),
        "best_seed": of_mean.highest,
        "limit": measured.limit,
        "limit_error": measured.limit_error,
        "part_of_limit": fraction_of_limit(of_mean.value, measured.limit),
        "worst_part_of_limit": fraction_of_limit(of_mean.lowest, measured.limit),
        **columns("lead", None if rival else estimate(lives.gain, greedy.gain), "_"),
        "beat_greedy": None if rival else float(lives.ahead.mean()),
        "angle": None if angle is None else float(angle.mean()),
        "std_of_angle": None if angle is None else _spread(angle),
        "pattern_broken": float(lives.broken.mean()) if still else None,
        "wave": float(lives.wave.mean()) if still else None,
        "arrived": None if case.world.egg is None else float(lives.arrived.mean()),
        "mean_lifetime": None if case.world.egg is None else float(lives.lifetime.mean()),
        "authors": authors[0],
        "std_of_authors": authors[1],
    }


def _spread(by_seed: np.ndarray) -> float | None:
    return float(by_seed.std(ddof=1)) if len(by_seed) > 1 else None


def seed_rows(found: Findings) -> Iterator[Row]:
    """A row for every training seed in every test."""
    for case, stack in [(each, stack) for each in found.tests for stack in each.stacks]:
        measured = found.evidence.cases[case.name]
        lives = measured.lives[stack.recipe, stack.kind]
        for place, (seed, policy) in enumerate(zip(stack.seeds, stack.policies, strict=True)):
            gain = lives.gain[place]
            yield {
                "test": case.name,
                "recipe": stack.recipe,
                "policy": stack.kind,
                "experiment": stack.experiment,
                "seed": seed,
                "chosen": place == stack.chosen,
                "kept_epoch": policy.card.get("epoch"),
                "validation_gain": policy.card.get("validation", {}).get("gain"),
                "gain": float(gain.mean()),
                "std": float(gain.std()),
                "min": float(gain.min()),
                "max": float(gain.max()),
                "part_of_limit": fraction_of_limit(float(gain.mean()), measured.limit),
                "arrived": None if case.world.egg is None else float(lives.arrived[place].mean()),
            }


def training_rows(found: Findings) -> Iterator[Row]:
    """A row for every run: what it cost."""
    for each in found.planned:
        run, learning = RunFolder(each.folder), each.settings.learning
        own = each.run.startswith(f"{each.recipe}/{each.experiment}")
        minutes = sum(float(row["seconds"]) for row in run.rows(runs.TIMINGS)) / 60
        yield {
            "training": f"{each.recipe} {each.experiment}",
            "seeds": each.settings.n_seeds,
            "cells": learning.n_swimmers * learning.n_worlds,
            "hidden layers": "×".join(str(size) for size in learning.hidden),
            "γ": f"{learning.discount:g}",
            "life": f"{each.settings.training_world().life:g}",
            "epochs": learning.epochs,
            "minutes, all seeds at once": f"{minutes:.1f}" if own else f"the run of {each.run}",
            "commit": run.record.get("commit") or "unknown",
        }
