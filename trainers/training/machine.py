"""What a run asks of the machine: packages, device and memory, checked before its folder is made."""

from __future__ import annotations

import importlib.util
import itertools
import os
import re

from trainers.settings.composition import SettingsError
from trainers.settings.learning import DQNSettings
from trainers.settings.schema import Settings


def check_machine(settings: Settings) -> None:
    """Raises SettingsError that names what is missing and the setting that asks for it."""
    for name in ("tensorboard", "wandb"):
        if getattr(settings, name) and importlib.util.find_spec(name) is None:
            raise SettingsError(f"{name}=true needs {name}, which is not installed: pip install {name}")
    needed, there = memory_needed(settings), _memory()
    if settings.device == "cpu" and there is not None and needed > there:
        raise SettingsError(
            f"these settings need {needed / 2**30:.3g} GiB of memory, this machine has {there / 2**30:.3g}: "
            "lower n_seeds, world.n_records, or what learning holds: buffer_size, n_swimmers, n_worlds, "
            "batch_size"
        )
    if settings.device != "cpu":
        _check_device(settings.device)


def memory_needed(settings: Settings) -> int:
    """Bytes a run works with, roughly, and rather too few than too many."""
    learning, world = settings.learning, settings.training_world()
    inputs, seeds = world.observation_size, settings.n_seeds
    cells = learning.n_worlds * learning.n_swimmers
    transition = 4 * (2 * inputs + 4)  # packed
    decisions = min(learning.collect or world.max_decisions, world.max_decisions)
    rollout = cells * decisions * (2 * transition + 8)
    buffer, batch = 0, learning.batch_size * (transition + 16)
    if isinstance(learning, DQNSettings):
        buffer = 2 * learning.buffer_size * transition  # once more for a checkpoint
        batch *= learning.updates
    sizes = (inputs, *learning.hidden, world.n_actions)
    parameters = sum(a * b + b for a, b in itertools.pairwise(sizes))
    layers = 3 * 4 * sum(sizes) * learning.batch_size
    return seeds * (
        buffer + rollout + batch + 7 * 4 * parameters + layers + settings.validation.cells * inputs * 8
    )


def _memory() -> int | None:
    """Bytes of this machine's memory, where the operating system tells."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def _check_device(device: str) -> None:
    import torch

    kind, number = re.fullmatch(r"(\w+?)(?::(\d+))?", device).groups()  # type: ignore[union-attr]
    backend = torch.backends.mps if kind == "mps" else getattr(torch, kind)
    count = 1 if kind == "mps" else backend.device_count()
    if not backend.is_available() or int(number or 0) >= count:
        raise SettingsError(f"device must be one that torch finds here, got {device!r}; cpu is always there")
