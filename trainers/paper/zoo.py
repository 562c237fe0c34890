"""Shipped policies: `python -m trainers.paper.zoo OUT` puts what a full reproduction chose into swarm/zoo.

For each experiment the policy that validation prefers among its seeds, with a card that states settings,
seeds, versions, commit, and gains in validation and in the test. NAME.json holds the card for readers, and
the training curve.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import swarm
from swarm._support import files
from swarm.policies.network import Network, save_policy
from trainers.paper.measurements import DEVISED, Stack
from trainers.paper.plan import EXPERIMENTS, RUNS, TESTS, Training
from trainers.paper.reproduction import RECORD, RESULTS, SEEDS
from trainers.paper.stacks import TrainingCurve, curve_of, trained_stacks
from trainers.paper.tables import Row
from trainers.settings.composition import SettingsError, settings_from_stored
from trainers.training.run_folder import RunError

RECIPE = "swarm"  # whose policies are shipped
ZOO = Path(swarm.__file__).parent / "zoo"
GAIN = {"mean": "gain", "std": "std", "min": "min", "max": "max"}  # of the card, in the table of seeds


class ZooError(RuntimeError):
    """A reproduction whose policies cannot be shipped; the message says why."""


def ship(out: Path, zoo: Path = ZOO) -> list[str]:
    """Write a policy and a card for every experiment of the reproduction in `out`; returns their names.

    Nothing is written unless every one of them can be. Raises ZooError, RunError, SettingsError or
    PolicyError.
    """
    record = _record(out)
    planned = {name: _trainings(out, record, name) for name in EXPERIMENTS}
    planned = {name: parts for name, parts in planned.items() if parts}
    if not planned:
        raise ZooError(f"{out} must hold trainings of the recipe {RECIPE}, got none")
    results, seeds = _rows(out / RESULTS), _rows(out / SEEDS)
    wanted = []
    for name, parts in planned.items():
        stack = trained_stacks(parts)[RECIPE, name]
        card = _card(parts, stack, results, seeds, record)
        wanted.append((name, Network(stack.choice.weights, stack.choice.biases, card), curve_of(parts)))
    zoo.mkdir(parents=True, exist_ok=True)
    for name, policy, curve in wanted:
        files.write_text(zoo / f"{name}.json", as_text(policy.card, curve))
        save_policy(policy, zoo / f"{name}.safetensors")
    return list(planned)


def _record(out: Path) -> dict[str, Any]:
    try:
        record = json.loads((out / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise ZooError(f"{out} must be the folder of a finished reproduction: it has no {RECORD}") from None
    if record["plan"]["quick"]:
        raise ZooError(f"{out} must be a full reproduction: with --quick nothing is trained")
    return record


def _trainings(out: Path, record: dict[str, Any], experiment: str) -> list[Training]:
    return [
        Training(RECIPE, experiment, settings_from_stored(stored["settings"]), out / RUNS / stored["run"])
        for stored in record["trainings"].get(f"{RECIPE}/{experiment}", [])
    ]


def _rows(path: Path) -> list[Row]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _card(
    parts: Sequence[Training],
    stack: Stack,
    results: Sequence[Row],
    seeds: Sequence[Row],
    record: dict[str, Any],
) -> dict[str, Any]:
    """The policy's card, with what the test says of it; raises ZooError where that was of another policy."""
    test, kind = next(
        (name, kind)
        for name, kinds in TESTS.items()
        for kind, experiment in kinds.items()
        if experiment == stack.experiment and kind != "still"
    )
    place = {"test": test, "policy": kind, "recipe": RECIPE}
    tested = _one(seeds, **place, seed=str(stack.seeds[stack.chosen]))
    whole, greedy = _one(results, **place), _one(results, test=test, policy="greedy", recipe=DEVISED)
    card = stack.choice.card
    if f"{card['validation']['gain']:.6g}" != tested["validation_gain"]:
        raise ZooError(
            f"the report must be about the runs beside it, but {parts[0].folder} was trained after it: "
            "run swarm reproduce again"
        )
    settings = dataclasses.asdict(parts[0].settings)
    return card | {
        "experiment": stack.experiment,
        "settings": {name: settings[name] for name in card["settings"]},
        "seeds": list(stack.seeds),  # among which validation chose
        "test": {
            "cells": int(whole["cells"]),
            "life": float(whole["life"]),
            "seed": record["plan"]["seed"],
            "gain": {name: float(tested[column]) for name, column in GAIN.items()},
            "limit": _number(whole["limit"]),
            "fraction_of_limit": _number(tested["part_of_limit"]),
            "arrived": _number(tested["arrived"]),
            "greedy": float(greedy["gain"]),
        },
    }


def _one(rows: Sequence[Row], **values: str) -> Row:
    found = [row for row in rows if all(row[name] == value for name, value in values.items())]
    if len(found) != 1:
        wanted = ", ".join(f"{name} {value or 'none'}" for name, value in values.items())
        raise ZooError(f"the tables of the reproduction must have one row with {wanted}, got {len(found)}")
    return found[0]


def _number(text: str) -> float | None:
    return float(text) if text else None


def as_text(card: dict[str, Any], curve: TrainingCurve) -> str:
    """The card as JSON to be read, then the curve on one line."""
    pretty = json.dumps(card, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False)
    return f'{pretty[:-2]},\n  "training": {json.dumps(curve._asdict(), allow_nan=False)}\n}}\n'


def main(words: Sequence[str]) -> None:
    """Ship the policies of the reproduction in the folder that is named."""
    if len(words) != 1:
        sys.exit("python -m trainers.paper.zoo takes one folder: that of a full reproduction")
    try:
        names = ship(Path(words[0]))
    except (ZooError, RunError, SettingsError, ValueError, OSError) as error:
        sys.exit(f"zoo: {error}")
    print(f"{len(names)} policies are in {ZOO}: {', '.join(names)}")


if __name__ == "__main__":
    main(sys.argv[1:])
