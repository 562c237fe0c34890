"""Tensor files: arrays and one card in JSON, as safetensors, whoever wrote them; nothing in them can run."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from typing import Any

import numpy as np

from swarm._support import files

CARD = "chemoswarm"  # the key of the file's metadata that holds the card
PICKLES = (b"\x80", b"P", b"c", b"(")  # what they begin with, zipped ones too

Shapes = dict[str, tuple[str, tuple[int, ...]]]  # by name: what safetensors calls the type, and the shape


def write(path: str | os.PathLike, tensors: dict[str, np.ndarray], card: dict[str, Any]) -> None:
    """Writes tensors and card, whole or not at all; the same ones always in the same bytes."""
    from safetensors.numpy import save

    text = json.dumps(card, sort_keys=True, allow_nan=False, ensure_ascii=False)
    ordered = {name: np.ascontiguousarray(tensors[name]) for name in sorted(tensors)}
    files.write_bytes(path, save(ordered, {CARD: text}))


def read(
    path: str | os.PathLike, check: Callable[[dict[str, Any], Shapes], None], *, at_most: int
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Tensors and card of an ordinary file of at most so many bytes; raises ValueError for anything else.

    `check` gets the card, and types and shapes of the tensors, before any of these is read.
    """
    from safetensors import SafetensorError, safe_open

    path = files.expanded(path)
    files.check_ordinary(path, at_most=at_most)
    try:
        with safe_open(path, "np") as file:
            stored = {name: file.get_slice(name) for name in file.keys()}  # noqa: SIM118
            card = _card(file.metadata() or {})
            check(card, {name: (part.get_dtype(), tuple(part.get_shape())) for name, part in stored.items()})
            return {name: file.get_tensor(name) for name in stored}, card
    except SafetensorError as error:
        with open(path, "rb") as opened:
            pickled = opened.read(1) in PICKLES
        hint = "; it looks like a pickle, which could run anything" if pickled else ""
        raise ValueError(f"it must be a valid safetensors file, got {str(error)[:200]}{hint}") from None


def _card(metadata: dict[str, str]) -> dict[str, Any]:
    if CARD not in metadata:
        raise ValueError(f"its metadata must hold a card named {CARD!r}")
    try:
        card = json.loads(metadata[CARD])
    except (ValueError, RecursionError) as error:
        raise ValueError(f"its card must be valid JSON, got {str(error)[:100]}") from None
    if not isinstance(card, dict):
        raise ValueError(f"its card must be a JSON object, got {type(card).__name__}")
    return card
