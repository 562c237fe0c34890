"""Snapshots: all that a training carries from one epoch to the next, as a checkpoint holds it."""

from __future__ import annotations

import torch
from torch import Tensor

from trainers.algorithms.transitions import Transitions
from trainers.training.checkpoint import CheckpointError
from trainers.training.loop import MEASURES, Training


def tensors_of(training: Training) -> dict[str, Tensor]:
    """Networks, optimiser, buffer, environment, kept policies and metrics.

    Random numbers need none: every draw is named by its seed and a counter.
    """
    learner = training.learner
    held = {"online": learner.online.flat, "target": learner.target.flat, "played": learner.played.flat}
    held |= {"best": training.best, **_kept(training), "measures": torch.as_tensor(training.measures)}
    held |= {f"optimiser.{name}": value for name, value in learner.moments.items()}
    held["buffer"] = learner.buffer[:]
    held |= {f"env.{name}": value for name, value in training.env.state_dict_of_env().items()}
    return {name: value.clone() for name, value in held.items()}


def _kept(training: Training) -> dict[str, Tensor]:
    """Validation gain and epoch (seeds,) of the policies that are kept."""
    return {
        "best_gain": torch.as_tensor(training.best_gain),
        "best_epoch": torch.as_tensor(training.best_epoch),
    }


def record_of(training: Training) -> dict[str, int]:
    """The counters of what is done."""
    learner = training.learner
    return {
        "epoch": training.epoch,
        "decisions": training.decisions,
        "updates": learner.updates,
        "cursor": learner.buffer.writer.state_dict()["_cursor"],
    }


def _template(training: Training) -> dict[str, Tensor]:
    """Tensors as a checkpoint holds them, with one row of the buffer and one epoch of metrics."""
    seeds, flat = len(training.seeds), training.learner.online.flat
    explorer = training.make_explorer(training.env.world, compile=False)
    explorer.restart()
    rows = explorer.collect(training.learner.online, 1.0, explorer.n_steps)[:1]
    held = {"online": flat, "target": flat, "played": flat, "best": flat}
    held |= {f"optimiser.{name}": value for name, value in training.learner.moments.items()}
    held |= _kept(training)
    held["measures"] = torch.zeros(1, seeds, len(MEASURES), dtype=torch.float64)
    held["buffer"] = rows
    return held | {f"env.{name}": value for name, value in explorer.env.state_dict_of_env().items()}


def largest(training: Training) -> int:
    """Bytes that the tensor file of a checkpoint can have at most."""
    learning, size = training.learner.settings, 2**20  # the header
    for name, value in _template(training).items():
        rows = learning.buffer_size if name == "buffer" else 1
        size += value.nbytes * (learning.epochs if name == "measures" else rows)
    return size


def restore(training: Training, tensors: dict[str, Tensor], record: dict[str, int]) -> None:
    """Go on from what `tensors_of` and `record_of` gave; raises CheckpointError unless it was such a run."""
    _check(training, tensors, record)
    learner = training.learner
    held = {name: value.to(learner.device) for name, value in tensors.items()}
    for name in ("online", "target", "played"):
        getattr(learner, name).flat.copy_(held[name])
    training.best = held["best"]
    training.best_gain, training.best_epoch = tensors["best_gain"].numpy(), tensors["best_epoch"].numpy()
    training.measures = tensors["measures"].numpy()
    learner.moments = {name: held[f"optimiser.{name}"] for name in learner.moments}
    learner.refill(held["buffer"], record["cursor"])
    training.env.load_state_dict_of_env(
        {name.removeprefix("env."): value for name, value in tensors.items() if name.startswith("env.")}
    )
    training.epoch, training.decisions = record["epoch"], record["decisions"]
    learner.updates = record["updates"]


def _check(training: Training, tensors: dict[str, Tensor], record: dict[str, int]) -> None:
    """Raises CheckpointError unless these are the tensors and counters of such a run."""
    learning, template = training.learner.settings, _template(training)
    for name in record_of(training):
        if type(record.get(name)) is not int or record[name] < 0:
            raise CheckpointError(f"checkpoint's {name} must be a whole number, got {record.get(name)!r}")
    if tensors.keys() != template.keys():
        other = ", ".join(sorted(tensors.keys() ^ template.keys()))
        raise CheckpointError(f"checkpoint must hold what this run needs, but differs in {other}")
    rows = len(tensors["buffer"]) if tensors["buffer"].ndim else 0
    _check_shapes(tensors, template, rows, record["epoch"])
    known = training.env.world.n_actions
    action = Transitions.unpacked(tensors["buffer"]).action
    if not 0 < rows <= learning.buffer_size or action.min() < 0 or action.max() >= known:
        raise CheckpointError(
            f"checkpoint's buffer must hold 1 to {learning.buffer_size} rows of known actions"
        )
    if record["epoch"] > learning.epochs or record["cursor"] > learning.buffer_size:
        raise CheckpointError(f"checkpoint's epoch must be at most {learning.epochs}, got {record['epoch']}")


def _check_shapes(tensors: dict[str, Tensor], template: dict[str, Tensor], rows: int, epochs: int) -> None:
    for name, expected in template.items():
        value, shape = tensors[name], tuple(expected.shape)
        if name == "measures":
            shape = (epochs, *shape[1:])
        elif name == "buffer":
            shape = (rows, *shape[1:])
        if value.dtype != expected.dtype or tuple(value.shape) != shape:
            raise CheckpointError(
                f"checkpoint's {name} must be {expected.dtype} {shape}, "
                f"got {value.dtype} {tuple(value.shape)}"
            )
