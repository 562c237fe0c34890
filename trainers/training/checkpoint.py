"""Checkpoints: all that a training carries from one epoch to the next, in folders of a tensor file and a
manifest, with one checksum, written whole or not at all. Random numbers are no part of it: every draw is
named by its seed and a counter.

The last few are kept. TorchRL's Checkpoint is not used: it pickles, and replaces a checkpoint in place
without waiting for the disk. Here nothing that is read can run, and a crash at any instant leaves the
previous checkpoint valid.
"""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from swarm._support import files
from trainers.settings.schema import completed
from trainers.training.loop import Training
from trainers.training.run_folder import RunError

FORMAT = 2  # raised whenever what is stored changes its meaning; how the checksum is made never changes
KEPT = 2
MANIFEST, TENSORS = "manifest.json", "state.safetensors"
MAX_MANIFEST = 2**20  # [bytes]
MAX_TENSORS = 2**36  # [bytes] where the caller knows no lower limit
HEADER = 2**20  # [bytes] of a tensor file


class CheckpointError(RunError):
    """A checkpoint that cannot be used."""


def write(
    folder: Path, epoch: int, tensors: dict[str, Tensor], record: dict[str, Any], settings: dict[str, Any]
) -> None:
    """Write the checkpoint of an epoch, then remove all but the newest `KEPT`."""
    data = save({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()})
    manifest = {"format": FORMAT, "epoch": epoch, "settings": settings, "record": record}
    target = folder / f"epoch_{epoch:06d}"
    if target.exists():  # damaged: a valid one would have been gone on from
        shutil.rmtree(target)
    with files.new_folder(target) as temporary:
        (temporary / TENSORS).write_bytes(data)
        whole = manifest | {"checksum": _checksum(manifest, data)}
        (temporary / MANIFEST).write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    for old in _listed(folder)[:-KEPT]:
        shutil.rmtree(old, ignore_errors=True)


def read_newest(
    folder: Path, settings: dict[str, Any], *, at_most: int = MAX_TENSORS
) -> tuple[dict[str, Tensor], dict[str, Any], list[str]] | None:
    """The newest valid checkpoint's tensors and record, and what was wrong with newer ones; None if there is
    none.

    Tensor files of more than `at_most` bytes are not read. Raises CheckpointError for one from a newer
    version or from other settings, and where all there are are damaged.
    """
    complaints: list[str] = []
    for path in reversed(_listed(folder)):
        try:
            return *_read(path, settings, at_most), complaints
        except _Damaged as error:
            complaints.append(f"checkpoint {path} is damaged: {error}")
    if complaints:
        raise CheckpointError("; ".join(complaints) + f"; to start again from epoch 0, remove {folder}")
    return None


class _Damaged(Exception):
    """Not what was written."""


def _read(path: Path, settings: dict[str, Any], at_most: int) -> tuple[dict[str, Tensor], dict[str, Any]]:
    try:
        manifest = json.loads(files.read_bytes(path / MANIFEST, at_most=MAX_MANIFEST))
        data = files.read_bytes(path / TENSORS, at_most=at_most)
        checksum = manifest.pop("checksum")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise _Damaged(f"{type(error).__name__}: {error}") from None
    if _checksum(manifest, data) != checksum:
        raise _Damaged(f"its {MANIFEST} and {TENSORS} do not match their checksum")
    if manifest.get("format") != FORMAT:
        raise CheckpointError(
            f"checkpoint {path} must have format {FORMAT}, which this version of chemoswarm reads, got "
            f"{manifest.get('format')}: go on with the version that wrote it (run.json names it)"
        )
    stored, record = manifest.get("settings"), manifest.get("record")
    if not isinstance(stored, dict) or not isinstance(record, dict):
        raise _Damaged(f"its {MANIFEST} must hold settings and a record")
    stored = completed(stored)
    other = sorted(key for key in settings.keys() | stored.keys() if stored.get(key) != settings.get(key))
    if other:
        raise CheckpointError(
            f"checkpoint {path} must come from this run, but differs from its settings in {', '.join(other)}"
        )
    try:
        return load(data), record
    except (SafetensorError, ValueError) as error:
        raise _Damaged(str(error)) from None


def _checksum(manifest: dict[str, Any], data: bytes) -> str:
    digest = hashlib.sha256(json.dumps(manifest, sort_keys=True).encode())
    digest.update(data)
    return digest.hexdigest()


def _listed(folder: Path) -> list[Path]:
    """Checkpoints by epoch; what a killed write left behind is not among them."""
    numbers = {path: path.name.removeprefix("epoch_") for path in folder.glob("epoch_*") if path.is_dir()}
    return sorted(
        (path for path in numbers if numbers[path].isdecimal()), key=lambda path: int(numbers[path])
    )


# --- what they hold -----------------------------------------------------------------------------------------


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
