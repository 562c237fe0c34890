"""What a policy file may hold: checks of strangers' files before anything in them is used.

The file's announcements are held against fixed limits before anything of their size is allocated.
"""

from __future__ import annotations

import json
import math
import stat
import struct
from pathlib import Path
from typing import Any

import numpy as np

from swarm._support.checks import check_count

POLICY_FILE = "policy.safetensors"  # its name in a run folder
CARD = "chemoswarm"  # the one key of the file's metadata
MAX_FILE = 16 * 2**20  # [bytes]
MAX_HEADER = 256 * 2**10  # [bytes]
MAX_LAYERS = 16
MAX_WIDTH = 4096  # nodes of a layer
MAX_SIZE = 1e6  # of a weight, so that nothing overflows
FEATURES = (2, 5)  # numbers per record: without and with the flow
MAX_DEPTH = 8  # of a card's nesting


class PolicyError(ValueError):
    """A file that is no policy, or a policy that does not fit a world."""


def read_bytes(path: Path) -> bytes:
    """The file's bytes; nothing is read that is no ordinary file of a reasonable size."""
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise PolicyError(f"{path} must be an ordinary file")
        if about.st_size > MAX_FILE:
            raise PolicyError(f"{path} must have at most {MAX_FILE} bytes, got {about.st_size}")
        with path.open("rb") as file:
            data = file.read(MAX_FILE + 1)
    except FileNotFoundError:
        raise PolicyError(
            f"{path} must be a policy file or a folder with a {POLICY_FILE}: it is not there"
        ) from None
    except OSError as error:
        raise PolicyError(f"{path} must be a policy file that can be read, got {error.strerror}") from None
    if len(data) > MAX_FILE:
        raise PolicyError(f"{path} must have at most {MAX_FILE} bytes")
    return data


def check_header(data: bytes) -> tuple[dict[str, tuple[int, ...]], dict[str, Any]]:
    """Shapes of the tensors and the card; raises PolicyError before anything of their size is allocated."""
    # A safetensors header begins with a brace after its length, whose first byte may be any.
    if data[8:9] != b"{" and data[:1] in (b"\x80", b"P", b"c", b"("):
        raise PolicyError(
            "it looks like a pickle, which could run anything; a policy must be a safetensors file"
        )
    if len(data) < 8:
        raise PolicyError(f"a safetensors file must have at least 8 bytes, got {len(data)}")
    (size,) = struct.unpack("<Q", data[:8])
    if size > min(MAX_HEADER, len(data) - 8):
        raise PolicyError(
            f"a policy's safetensors header must have at most {MAX_HEADER} bytes, all in the file, "
            f"got {size} announced in a file of {len(data)}"
        )
    header = _parse_json(data[8 : 8 + size], "header")
    metadata = header.pop("__metadata__", None)
    if not isinstance(metadata, dict) or not isinstance(metadata.get(CARD), str):
        raise PolicyError(f"its metadata must hold a card named {CARD!r}")
    shapes = _check_tensors(header)
    stored = 4 * sum(math.prod(shape) for shape in shapes.values())
    if stored != len(data) - 8 - size:
        raise PolicyError(
            f"its tensors must fill the file: {stored} bytes by the header, got {len(data) - 8 - size}"
        )
    return shapes, _parse_json(metadata[CARD].encode(), "card")


def _check_tensors(header: dict[str, Any]) -> dict[str, tuple[int, ...]]:
    layers = len(header) // 2
    names = [f"layers.{i}.{part}" for i in range(layers) for part in ("weight", "bias")]
    if not 1 <= layers <= MAX_LAYERS or set(header) != set(names):
        raise PolicyError(
            f"its tensors must be layers.0.weight, layers.0.bias, … of at most {MAX_LAYERS} layers, "
            f"got {', '.join(repr(name)[:60] for name in list(header)[:6]) or 'none'}"
        )
    shapes = {}
    for name in names:
        entry = header[name]
        entry = entry if isinstance(entry, dict) else {}
        dtype, shape = entry.get("dtype"), entry.get("shape")
        if dtype != "F32":
            raise PolicyError(f"{name} must be of dtype F32, got {str(dtype)[:60]!r}")
        axes = 2 if name.endswith("weight") else 1
        sides = shape if isinstance(shape, list) else []
        if len(sides) != axes or not all(type(side) is int and 1 <= side <= MAX_WIDTH for side in sides):
            raise PolicyError(
                f"{name} must have {axes} axes of 1 to {MAX_WIDTH}, got the shape {str(shape)[:60]}"
            )
        shapes[name] = tuple(sides)
    return shapes


def read_tensors(
    data: bytes, shapes: dict[str, tuple[int, ...]]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        tensors = load(data)
    except SafetensorError as error:
        raise PolicyError(f"it must be a valid safetensors file, got {error}") from None
    layers = range(len(shapes) // 2)
    return [tensors[f"layers.{i}.weight"] for i in layers], [tensors[f"layers.{i}.bias"] for i in layers]


def _parse_json(data: bytes, part: str) -> dict[str, Any]:
    """A JSON object; raises PolicyError for anything that JSON proper does not allow."""

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        result = dict(pairs)
        if len(result) != len(pairs):
            raise ValueError("a key appears twice")
        return result

    def no_number(text: str) -> Any:
        raise ValueError(f"{text} is no number")

    try:
        value = json.loads(data.decode(), object_pairs_hook=unique, parse_constant=no_number)
    except (ValueError, RecursionError) as error:
        raise PolicyError(f"its {part} must be valid JSON, got {str(error)[:100]}") from None
    if not isinstance(value, dict):
        raise PolicyError(f"its {part} must be a JSON object, got {type(value).__name__}")
    return value


def check_card(card: dict[str, Any]) -> dict[str, Any]:
    """The card as plain JSON values, printable as it is; raises PolicyError otherwise."""
    plain = _plain(card, 0)
    if len(json.dumps(plain)) > MAX_HEADER // 4:
        raise PolicyError(f"card must have at most {MAX_HEADER // 4} bytes")
    for name in ("n_records", "features", "n_actions"):
        if name not in plain:
            raise PolicyError(f"card must state {name}, got {', '.join(list(plain)[:10]) or 'an empty card'}")
        try:
            check_count(f"card's {name}", plain[name], at_least=2)
        except (TypeError, ValueError) as error:
            raise PolicyError(str(error)) from None
    if plain["features"] not in FEATURES:
        raise PolicyError(f"card's features must be one of {FEATURES}, got {plain['features']}")
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
