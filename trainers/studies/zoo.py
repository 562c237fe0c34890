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
from trainers.studies.stacks import Trained

FOLDER = "zoo"  # of a study that trained
SHIPPED = Path(swarm.__file__).parent / "zoo"


def put(folder: Path, trained: Trained, tested: dict[str, Any]) -> None:
    """Write the policy of a stack that validation prefers, and its card for readers, which tells with what
    settings it would be trained and what a test says of it.
    """
    stack, curve = trained.stack, trained.curve
    assert trained.settings is not None, "what was trained has settings"
    assert curve is not None, "what was trained has a curve"
    stored, card = dataclasses.asdict(trained.settings), stack.choice.card
    card = card | {
        "experiment": stack.experiment,
        "settings": {name: stored[name] for name in card["settings"]},
        "seeds": list(stack.seeds),  # among which validation chose
        "test": tested,
    }
    pretty = json.dumps(card, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False)
    text = f'{pretty[:-2]},\n  "training": {json.dumps(curve._asdict(), allow_nan=False)}\n}}\n'
    folder.mkdir(exist_ok=True)
    files.write_text(folder / f"{stack.experiment}.json", text)
    policy = Network(stack.choice.weights, stack.choice.biases, card)
    save_policy(policy, folder / f"{stack.experiment}.safetensors")


def ship(out: Path, zoo: Path = SHIPPED) -> list[str]:
    """Copy what the study in `out` keeps to be shipped; returns names. Raises OSError."""
    zoo.mkdir(parents=True, exist_ok=True)
    kept = sorted((out / FOLDER).glob("*"))
    for file in kept:
        files.write_bytes(zoo / file.name, file.read_bytes())
    return sorted({file.stem for file in kept})
