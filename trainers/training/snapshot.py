"""Snapshots: all that a training carries from one epoch to the next, as a checkpoint holds it.

Random numbers are no part of it: every draw is named by its seed and a counter.
"""

import torch
from torch import Tensor

from trainers.training.checkpoint import CheckpointError
from trainers.training.loop import Training

HEADER = 2**20  # [bytes] of a tensor file


def tensors_of(training: Training) -> dict[str, Tensor]:
    """The algorithm's tensors, the environment's, the kept policies and the metrics."""
    held = training.algorithm.tensors() | {f"best.{name}": tensor for name, tensor in training.best.items()}
    held |= {f"env.{name}": value for name, value in training.env.state_dict_of_env().items()}
    for name in ("best_gain", "best_epoch", "measures"):
        held[name] = torch.as_tensor(getattr(training, name))
    return {name: value.detach().clone() for name, value in held.items()}


def record_of(training: Training) -> dict[str, int]:
    """The counters of what is done."""
    own = {"epoch": training.epoch, "decisions": training.decisions}
    return own | training.algorithm.counters()


def _template(training: Training) -> tuple[dict[str, Tensor], dict[str, int]]:
    """The tensors of a training that has not begun, and those whose first axis grows, with the length that it
    has at most.
    """
    training.env.restart()
    held = tensors_of(training)
    training.env.set_seeds(training.seeds)  # as if there had been no life
    return held, training.algorithm.growing() | {"measures": training.settings.learning.epochs}


def largest(training: Training) -> int:
    """Bytes that the tensor file of a checkpoint can have at most."""
    size, (template, growing) = HEADER, _template(training)
    for name, value in template.items():
        one = value.new_zeros(1, *value.shape[1:]).nbytes
        size += growing[name] * one if name in growing else value.nbytes
    return size


def restore(training: Training, tensors: dict[str, Tensor], record: dict[str, int]) -> None:
    """Go on from what `tensors_of` and `record_of` gave, in a training that has not begun.

    Raises CheckpointError unless it was such a run.
    """
    _check(training, tensors, record)
    try:
        training.algorithm.restore(tensors, record)
    except ValueError as error:
        raise CheckpointError(f"checkpoint's {error}") from None
    for name, tensor in training.best.items():
        tensor.copy_(tensors[f"best.{name}"])
    for name in ("best_gain", "best_epoch", "measures"):
        setattr(training, name, tensors[name].numpy())
    of_env = {name: value for name, value in tensors.items() if name.startswith("env.")}
    training.env.load_state_dict_of_env({name.removeprefix("env."): of_env[name] for name in of_env})
    training.epoch, training.decisions = record["epoch"], record["decisions"]


def _check(training: Training, tensors: dict[str, Tensor], record: dict[str, int]) -> None:
    """Raises CheckpointError unless these are the tensors and counters of such a run."""
    epochs, (template, growing) = training.settings.learning.epochs, _template(training)
    for name in record_of(training):
        if type(record.get(name)) is not int or record[name] < 0:
            raise CheckpointError(f"checkpoint's {name} must be a whole number, got {record.get(name)!r}")
    if other := ", ".join(sorted(tensors.keys() ^ template.keys())):
        raise CheckpointError(f"checkpoint must hold what this run needs, but differs in {other}")
    for name, expected in template.items():
        value, shape = tensors[name], tuple(expected.shape)
        if name in growing and value.ndim and 0 < len(value) <= growing[name]:
            shape = (len(value), *shape[1:])
        if (value.dtype, tuple(value.shape)) != (expected.dtype, shape):
            rule = f"checkpoint's {name} must be {expected.dtype} {shape}"
            raise CheckpointError(f"{rule}, got {value.dtype} {tuple(value.shape)}")
    if record["epoch"] > epochs or len(tensors["measures"]) != record["epoch"]:
        rule = f"checkpoint's epoch must be at most {epochs}, with metrics of each"
        raise CheckpointError(f"{rule}, got {record['epoch']}")
