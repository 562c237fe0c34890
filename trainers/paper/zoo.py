"""Shipped policies: `swarm reproduce --ship` puts what a full reproduction chose into swarm/zoo.

For each experiment the policy that validation prefers among its seeds, with a card that states settings,
seeds, versions, commit, and gains in validation and in the test. NAME.json holds the card for readers, and
the training curve.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any

import swarm
from swarm._support import files
from swarm.policies.network import Network, save_policy
from swarm.population.results import RIVAL
from swarm.population.statistics import fraction_of_limit
from trainers.paper.delivery import ZOO
from trainers.paper.measurements import DEVISED, Case, Evidence, Stack
from trainers.paper.stacks import TrainingCurve
from trainers.paper.tables import Findings

RECIPE = "swarm"  # whose policies are shipped
SHIPPED = Path(swarm.__file__).parent / "zoo"


def keep(folder: Path, found: Findings) -> None:
    """Write the policy that is chosen for every experiment of the recipe, and its card for readers."""
    settings_of = {(each.recipe, each.experiment): each.settings for each in reversed(found.planned)}
    for case, stack in [(each, stack) for each in found.tests for stack in each.stacks]:
        key = (stack.recipe, stack.experiment)
        if stack.recipe != RECIPE or stack.kind == "still" or key not in settings_of:
            continue
        tested = _tested(stack, case, found.evidence)
        settings = dataclasses.asdict(settings_of[key])
        curve = found.trained[key].curve
        assert curve is not None, "what was trained has a curve"
        put(folder, stack, settings, tested, curve)


def put(
    folder: Path, stack: Stack, settings: dict[str, Any], tested: dict[str, Any], curve: TrainingCurve
) -> None:
    """Write the policy of a stack that validation prefers, and its card for readers, which tells with what
    settings it would be trained and what a test says of it.
    """
    card = stack.choice.card
    card = card | {
        "experiment": stack.experiment,
        "settings": {name: settings[name] for name in card["settings"]},
        "seeds": list(stack.seeds),  # among which validation chose
        "test": tested,
    }
    pretty = json.dumps(card, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False)
    text = f'{pretty[:-2]},\n  "training": {json.dumps(curve._asdict(), allow_nan=False)}\n}}\n'
    folder.mkdir(exist_ok=True)
    files.write_text(folder / f"{stack.experiment}.json", text)
    policy = Network(stack.choice.weights, stack.choice.biases, card)
    save_policy(policy, folder / f"{stack.experiment}.safetensors")


def _tested(stack: Stack, case: Case, evidence: Evidence) -> dict[str, Any]:
    """What the test says of a stack's choice."""
    measured = evidence.cases[case.name]
    lives = measured.lives[stack.recipe, stack.kind]
    gain = lives.gain[stack.chosen]
    return {
        "cells": case.cells,
        "life": case.world.life,
        "seed": case.seed,
        "gain": {name: float(getattr(gain, name)()) for name in ("mean", "std", "min", "max")},
        "limit": measured.limit,
        "fraction_of_limit": fraction_of_limit(float(gain.mean()), measured.limit),
        "arrived": None if case.world.egg is None else float(lives.arrived[stack.chosen].mean()),
        "greedy": float(measured.lives[DEVISED, RIVAL].gain.mean()),
    }


def ship(out: Path, zoo: Path = SHIPPED) -> list[str]:
    """Copy what the reproduction in `out` keeps to be shipped; returns names. Raises OSError."""
    zoo.mkdir(parents=True, exist_ok=True)
    kept = sorted((out / ZOO).glob("*"))
    for file in kept:
        files.write_bytes(zoo / file.name, file.read_bytes())
    return sorted({file.stem for file in kept})
