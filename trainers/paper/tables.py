"""Tables of a reproduction: a row per policy and test, a row per training seed, a row per training."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from swarm.population.results import RIVAL
from trainers.paper.intervals import estimate, median_place, off_gradient
from trainers.paper.measurements import DEVISED, Case, Lives, Measured, Stack
from trainers.paper.plan import Training
from trainers.paper.statements import Evidence
from trainers.training import run_folder as runs
from trainers.training.run_folder import RunFolder

# Mean gains of the networks that the paper's authors published (github.com/mokchie/chemotaxis), replayed in
# this model.
AUTHORS = {("linear_n2", "dqn"): 21.9, ("linear_n4", "dqn"): 24.3, ("linear_n8", "dqn"): 20.6}
AUTHORS[("taylor_green", "still")] = 49.1

Row = dict[str, Any]


def result_rows(tests: Sequence[Case], evidence: Evidence) -> list[Row]:
    """A row for every policy or strategy in every test."""
    return [
        _result(case, evidence.cases[case.name], recipe, kind, lives, evidence.seed)
        for case in tests
        for (recipe, kind), lives in evidence.cases[case.name].lives.items()
    ]


def _result(case: Case, measured: Measured, recipe: str, kind: str, lives: Lives, seed: int) -> Row:
    gain, limit = lives.gain, measured.limit
    greedy = measured.lives[DEVISED, RIVAL].gain
    of_mean = estimate(lambda gain: gain, gain, seed=seed)
    ahead = estimate(np.subtract, gain, greedy, seed=seed)
    by_seed = gain.mean(axis=1)
    angle = estimate(lambda angle: angle, lives.off_gradient, summary=off_gradient, seed=seed)
    linear = case.world.egg is None and not case.world.in_flow
    return {
        "test": case.name,
        "recipe": recipe or None,
        "policy": kind,
        "seeds": len(lives.seeds) or None,
        "cells": gain.shape[1],
        "life": case.world.life,
        "gain": of_mean.value,
        "gain_low": of_mean.interval and of_mean.interval[0],
        "gain_high": of_mean.interval and of_mean.interval[1],
        "std_of_cells": float(gain.std(axis=1).mean()),
        "std_of_seeds": float(by_seed.std(ddof=1)) if len(by_seed) > 1 else None,
        "worst_seed": float(by_seed.min()),
        "median_seed": float(by_seed[median_place(by_seed.tolist())]),
        "best_seed": float(by_seed.max()),
        "limit": limit,
        "limit_error": measured.limit_error,
        "part_of_limit": limit and of_mean.value / limit,
        "worst_part_of_limit": limit and float(by_seed.min()) / limit,
        "lead": None if kind == RIVAL else ahead.value,
        "lead_low": None if kind == RIVAL or ahead.interval is None else ahead.interval[0],
        "lead_high": None if kind == RIVAL or ahead.interval is None else ahead.interval[1],
        "beat_greedy": None if kind == RIVAL else float(np.mean(gain > greedy)),
        "angle": angle.value if linear and kind != "swinging" else None,
        "arrived": None if case.world.egg is None else float(lives.arrived.mean()),
        "mean_lifetime": None if case.world.egg is None else float(lives.lifetime.mean()),
        "authors": AUTHORS.get((case.name, kind)) if recipe == "paper" else None,
    }


def seed_rows(tests: Sequence[Case], evidence: Evidence) -> list[Row]:
    """A row for every training seed in every test."""
    return [
        row
        for case in tests
        for stack in case.stacks
        for row in _seeds(case, stack, evidence.cases[case.name])
    ]


def _seeds(case: Case, stack: Stack, measured: Measured) -> Iterable[Row]:
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
            "part_of_limit": measured.limit and float(gain.mean()) / measured.limit,
            "arrived": None if case.world.egg is None else float(lives.arrived[place].mean()),
        }


def training_rows(planned: Iterable[Training]) -> list[Row]:
    """A row for every run: what it cost."""
    rows = []
    for each in planned:
        timings = RunFolder(each.folder).rows(runs.TIMINGS)
        learning = each.settings.learning
        rows.append(
            {
                "recipe": each.recipe,
                "experiment": each.experiment,
                "run": f"{runs_folder(each)}",
                "seeds": each.settings.n_seeds,
                "cells": learning.n_swimmers * learning.n_worlds,
                "hidden": "×".join(str(size) for size in learning.hidden),
                "discount": learning.discount,
                "life": each.settings.world["life"],
                "epochs": learning.epochs,
                "seconds": sum(float(row["seconds"]) for row in timings),
                "commit": RunFolder(each.folder).record.get("commit"),
            }
        )
    return rows


def runs_folder(training: Training) -> str:
    """A run within the folder of runs."""
    return f"{training.folder.parent.name}/{training.folder.name}"


def paired(first: Lives, second: Lives, seed: int) -> tuple[int, int, Any]:
    """The worst seed of the first, the best of the second, and their difference on the same cells."""
    worst, best = int(first.gain.mean(axis=1).argmin()), int(second.gain.mean(axis=1).argmax())
    found = estimate(np.subtract, first.gain[worst : worst + 1], second.gain[best : best + 1], seed=seed)
    return first.seeds[worst], second.seeds[best], found


def as_csv(rows: Sequence[Row]) -> str:
    """Rows as CSV; nothing where there is no number."""
    buffer = io.StringIO()
    if rows:
        writer = csv.DictWriter(buffer, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({name: _plain(value) for name, value in row.items()} for row in rows)
    return buffer.getvalue()


def _plain(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else value


def as_markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; the first column is text, the others are numbers."""
    lines = [headings, [":--", *["--:"] * (len(headings) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
