"""What a policy file may hold: limits of strangers' files, checked before anything in them is used."""

from __future__ import annotations

import json
import math
from typing import Any

from swarm._support.checks import check_count
from swarm._support.registry import TYPE
from swarm._support.tensors import Shapes
from swarm.physics.world.actions import check_range

POLICY_FILE = "policy.safetensors"  # its name in a run folder
MAX_FILE = 16 * 2**20  # [bytes]
MAX_HEADER = 256 * 2**10  # [bytes] of the file that are no tensors
MAX_LAYERS = 16
MAX_WIDTH = 4096  # nodes of a layer
MAX_SIZE = 1e6  # of a weight, so that nothing overflows
SENSORS = {2: "memory", 5: "memory_with_flow"}  # by numbers per record, of cards that state no sensor
MEMORY = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")  # of a recurrent layer, in PyTorch's names
MAX_NAME = 40  # letters of an algorithm's
MAX_DEPTH = 8  # of a card's nesting


class PolicyError(ValueError):
    """A file that is no policy, or a policy that does not fit a world."""


def check_tensors(shapes: Shapes) -> None:
    """Raises PolicyError unless these are the weights and biases of layers, with or without a memory before
    them, each within the limits.
    """
    layers = [name for name in shapes if not name.startswith("memory.")]
    names = [f"layers.{i}.{part}" for i in range(len(layers) // 2) for part in ("weight", "bias")]
    memory = [f"memory.{part}" for part in MEMORY] if len(layers) < len(shapes) else []
    if not 1 <= len(layers) // 2 <= MAX_LAYERS or set(shapes) != {*names, *memory}:
        raise PolicyError(
            f"its tensors must be layers.0.weight, layers.0.bias, … of at most {MAX_LAYERS} layers, and of a "
            f"recurrent network memory.{', memory.'.join(MEMORY)}, "
            f"got {', '.join(repr(name)[:60] for name in list(shapes)[:6]) or 'none'}"
        )
    for name, (dtype, shape) in shapes.items():
        if dtype != "F32":
            raise PolicyError(f"{name} must be of dtype F32, got {dtype}")
        check_shape(name, shape)


def check_shape(name: str, shape: tuple[int, ...]) -> None:
    """Raises PolicyError unless it is one of a layer's weight or bias."""
    axes = 2 if "weight" in name else 1
    if len(shape) != axes or not all(1 <= side <= MAX_WIDTH for side in shape):
        raise PolicyError(f"{name} must have {axes} axes of 1 to {MAX_WIDTH}, got {str(shape)[:60]}")


def check_card(card: dict[str, Any]) -> dict[str, Any]:
    """The card as plain JSON values, printable as it is; raises PolicyError otherwise."""
    plain = _plain(card, 0)
    if len(json.dumps(plain)) > MAX_HEADER // 4:
        raise PolicyError(f"card must have at most {MAX_HEADER // 4} bytes")
    continuous = plain.get("curvature_range") is not None
    try:
        for name in ("n_records", "features", "n_actions"):
            if name not in plain:
                given = ", ".join(list(plain)[:10]) or "an empty card"
                raise ValueError(f"card must state {name}, got {given}")
            least = 1 if name == "n_actions" and continuous else 2
            check_count(f"card's {name}", plain[name], at_least=least)
        if continuous:
            plain["curvature_range"] = list(check_range("card's curvature_range", plain["curvature_range"]))
    except (TypeError, ValueError) as error:
        raise PolicyError(str(error)) from None
    sensor = plain.get("sensor", SENSORS.get(plain["features"]))
    if not isinstance(sensor.get(TYPE) if isinstance(sensor, dict) else sensor, str):
        rule = f"card must state the sensor of {plain['features']} features by name, or type and parameters"
        raise PolicyError(f"{rule}, got {sensor!r}")
    algorithm = plain.get("algorithm", "dqn")
    if not isinstance(algorithm, str) or not algorithm.isidentifier() or len(algorithm) > MAX_NAME:
        raise PolicyError(
            f"card's algorithm must be a name of at most {MAX_NAME} letters, got {str(algorithm)[:60]!r}"
        )
    return plain


def _plain(value: Any, depth: int) -> Any:
    if depth > MAX_DEPTH:
        raise PolicyError(f"card must be nested at most {MAX_DEPTH} deep")
    if isinstance(value, dict):
        return {_plain_text(key): _plain(item, depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, depth + 1) for item in value]
    if isinstance(value, str):
        return _plain_text(value)
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float) and math.isfinite(value):
        return float(value)
    raise PolicyError(f"card must hold JSON values only, with finite numbers, got {str(value)[:60]!r}")


def _plain_text(value: Any) -> str:
    # Cards are printed: an escape sequence of a stranger must not reach the terminal.
    if not isinstance(value, str) or not all(
        character.isprintable() or character == "\n" for character in value
    ):
        raise PolicyError(f"card must hold printable text only, got {ascii(value)[:60]}")
    return value
