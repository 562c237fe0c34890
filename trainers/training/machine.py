"""What a run asks of the machine: packages, device and memory, checked before its folder is made."""

import importlib.util
import re

from swarm._support.checks import check_memory
from swarm.population.blocks import block as blocks
from trainers.algorithms.base import learner_of
from trainers.settings.composition import SettingsError
from trainers.settings.schema import Settings


def check_machine(settings: Settings) -> None:
    """Raises SettingsError that names what is missing and the setting that asks for it."""
    for name in ("tensorboard", "wandb"):
        if getattr(settings, name) and importlib.util.find_spec(name) is None:
            raise SettingsError(f"{name}=true needs {name}, which is not installed: pip install {name}")
    if settings.device != "cpu":
        return _check_device(settings.device)
    try:
        held = "buffer_size, n_swimmers, n_worlds, batch_size"
        rule = f"n_seeds, world.n_records, or what learning holds ({held}) must be smaller"
        check_memory(memory_needed(settings), rule)
        if settings.evaluate:
            test = settings.evaluation
            rule = "evaluation.cells must be fewer, or evaluation.life shorter, got"
            cells = test.cells * test.worlds
            needed = blocks.memory_needed(settings.test_world(), cells)
            check_memory(needed, f"{rule} {cells} and {test.life:g}")
    except ValueError as error:
        raise SettingsError(str(error)) from None


def memory_needed(settings: Settings) -> int:
    """Bytes a run works with, roughly, and rather too few than too many."""
    learning, world = settings.learning, settings.training_world()
    decisions = min(learning.collect or world.max_decisions, world.max_decisions)
    validated = settings.validation.cells * settings.validation.worlds
    cells = 2 * decisions * learning.n_worlds * learning.n_swimmers + validated
    own = learner_of(settings).memory_needed(settings)
    return settings.n_seeds * (8 * world.observation_size * cells + own)


def _check_device(device: str) -> None:
    import torch

    kind, number = re.fullmatch(r"(\w+?)(?::(\d+))?", device).groups()  # type: ignore[union-attr]
    backend = torch.backends.mps if kind == "mps" else getattr(torch, kind)
    count = 1 if kind == "mps" else backend.device_count()
    if not backend.is_available() or int(number or 0) >= count:
        raise SettingsError(f"device must be one that torch finds here, got {device!r}; cpu is always there")
