"""What a reproduction keeps as data: tables, lives of every cell, and where all of it comes from."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from swarm.population.results import RIVAL
from swarm.population.statistics import fraction_of_limit
from trainers.studies.claims import DEVISED
from trainers.studies.estimates import Row, columns, estimate
from trainers.studies.paper.measurements import MEASURES, Case, Findings, Measured
from trainers.studies.paper.plan import VORTICES
from trainers.studies.stacks import Key, Stack

# Gains of the networks that the paper's authors published (github.com/mokchie/chemotaxis, v0saved_model of
# commit 2f750d9), replayed in this model on the plan's own test cells: mean and standard deviation over them.
AUTHORS = {
    ("linear_n2", "dqn"): (22.10, 1.13),
    ("linear_n4", "dqn"): (24.52, 0.31),
    ("linear_n8", "dqn"): (20.78, 0.22),
    (VORTICES, "still"): (48.52, 3.18),
}
AUTHORS_TEST = "400 cells of the population seed 100, lives of 200, in the flow of 400"
KEPT = {"drift": ("axis",)} | dict.fromkeys(("gain", "arrived", "lifetime", "wave", "winding", "broken"), ())


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
        learning = each.settings.learning
        own = each.run.startswith(f"{each.recipe}/{each.experiment}")
        yield {
            "training": f"{each.recipe} {each.experiment}",
            "seeds": each.settings.n_seeds,
            "cells": learning.n_swimmers * learning.n_worlds,
            "hidden layers": "×".join(str(size) for size in learning.hidden),
            "γ": f"{learning.discount:g}",
            "life": f"{each.settings.training_world().life:g}",
            "epochs": learning.epochs,
            "minutes, all seeds at once": f"{each.minutes:.1f}" if own else f"the run of {each.run}",
            "commit": each.recorded()["commit"] or "unknown",
        }


def where_from(found: Findings) -> dict[str, list[dict[str, Any]]]:
    """Versions, commits and settings of every training's runs."""
    trained: dict[str, list[dict[str, Any]]] = {}
    for each in found.planned:
        about = {"run": each.run, **each.recorded()}
        trained.setdefault(f"{each.recipe}/{each.experiment}", []).append(about)
    for stack in [stack for case in found.tests for stack in case.stacks if not found.planned]:
        about = {name: stack.choice.card.get(name) for name in ("settings", "versions", "commit")}
        about |= {"shipped": True, "seeds": list(stack.seeds)}
        trained[f"{stack.recipe}/{stack.experiment}"] = [about]
    return trained


def tested(stack: Stack, case: Case, found: Findings) -> dict[str, Any]:
    outcome = found.evidence.cases[case.name]
    lives = outcome.lives[stack.recipe, stack.kind]
    gain = lives.gain[stack.chosen]
    return {
        "cells": case.cells,
        "life": case.world.life,
        "seed": case.seed,
        "gain": {name: float(getattr(gain, name)()) for name in ("mean", "std", "min", "max")},
        "limit": outcome.limit,
        "fraction_of_limit": fraction_of_limit(float(gain.mean()), outcome.limit),
        "arrived": None if case.world.egg is None else float(lives.arrived[stack.chosen].mean()),
        "greedy": float(outcome.lives[DEVISED, RIVAL].gain.mean()),
    }


def as_dataset(case: Case, outcome: Measured) -> xr.Dataset:
    """What is kept of every cell's life under every policy, (policy, cell, ...)."""
    names = [
        "/".join([*filter(None, key), *([f"seed {seed}"] if each.seeds else [])])
        for key, each in outcome.lives.items()
        for seed in each.seeds or (0,)
    ]

    def column(name: str) -> np.ndarray:
        values = np.concatenate([getattr(each, name) for each in outcome.lives.values()])
        return values if values.dtype == bool else values.astype(np.float32)

    variables = {name: (("policy", "cell", *extra), column(name)) for name, extra in KEPT.items()}
    attributes = {"test": case.name, "seed": case.seed, "life": case.world.life}
    attributes |= {} if outcome.limit is None else {"limit": outcome.limit}
    return xr.Dataset(variables, {"policy": names, "axis": ["x", "y"]}, attributes)
