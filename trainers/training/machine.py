"""What a run asks of the machine: packages, device and memory, checked before its folder is made."""

from __future__ import annotations

import importlib.util
import os
import re
from typing import TYPE_CHECKING

from trainers.settings.composition import SettingsError
from trainers.settings.schema import Settings

if TYPE_CHECKING:
    from trainers.training.loop import Training


def check_machine(settings: Settings) -> None:
    """Raises SettingsError that names what is missing and the setting that asks for it."""
    wanted = {"torch": "training", "tensordict": "training", "torchrl": "training"}
    wanted |= {"tensorboard": "tensorboard=true"} if settings.tensorboard else {}
    wanted |= {"wandb": "wandb=true"} if settings.wandb else {}
    missing = [name for name in wanted if importlib.util.find_spec(name) is None]
    if missing:
        raise SettingsError(
            f"{wanted[missing[0]]} needs {', '.join(missing)}, which is not installed: "
            "pip install 'chemoswarm[train]' brings all but wandb"
        )
    needed, there = memory_needed(settings), _memory()
    if settings.device == "cpu" and there is not None and needed > there:
        raise SettingsError(
            f"these settings need {needed / 2**30:.3g} GiB of memory, this machine has {there / 2**30:.3g}: "
            "lower n_seeds, learning.buffer_size, learning.n_swimmers, learning.n_worlds, "
            "learning.batch_size or world.n_records"
        )
    if settings.device != "cpu":
        _check_device(settings.device)


def prepare(settings: Settings) -> Training:
    """A training that is ready to begin; raises SettingsError where settings or machine do not do."""
    check_machine(settings)
    from trainers.training.loop import Training  # imports torch, which may not be there

    try:
        return Training(settings)
    except (TypeError, ValueError, MemoryError) as error:
        raise SettingsError(str(error) or "there is not enough memory for these settings") from None


def memory_needed(settings: Settings) -> int:
    """Bytes a run works with, roughly, and rather too few than too many."""
    from trainers.algorithms import ALGORITHMS  # imports torch, which may not be there

    learning, world = settings.learning, settings.training_world()
    cells = learning.n_worlds * learning.n_swimmers
    rollout = cells * min(learning.collect or world.max_decisions, world.max_decisions)
    seen = 8 * world.observation_size * (2 * rollout + settings.validation.cells)
    return settings.n_seeds * (seen + ALGORITHMS["dqn"].memory_needed(settings))


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
