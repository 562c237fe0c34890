"""Checkpoints: folders of one tensor file and a manifest with its checksum, written whole or not at all, the last few kept.

TorchRL's Checkpoint is not used: it pickles, and replaces a checkpoint in place without waiting for the disk. Here nothing
that is read can run, and a crash at any instant leaves the previous checkpoint valid.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from swarm import files

FORMAT = 1  # raised whenever what is stored changes its meaning
KEPT = 2
MANIFEST, TENSORS = "manifest.json", "state.safetensors"


class CheckpointError(RuntimeError):
    """A checkpoint that cannot be used."""


def write(
    folder: Path, epoch: int, tensors: dict[str, Tensor], record: dict[str, Any], settings: dict[str, Any]
) -> None:
    """Write the checkpoint of an epoch, then remove all but the newest `KEPT`."""
    data = save({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()})
    manifest = {
        "format": FORMAT,
        "epoch": epoch,
        "sha256": hashlib.sha256(data).hexdigest(),
        "settings": settings,
        "record": record,
    }
    target = folder / f"epoch_{epoch:06d}"
    if target.exists():  # damaged: a valid one would have been gone on from
        shutil.rmtree(target)
    with files.new_folder(target) as temporary:
        (temporary / TENSORS).write_bytes(data)
        (temporary / MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")
    for old in _listed(folder)[:-KEPT]:
        shutil.rmtree(old, ignore_errors=True)


def read_newest(
    folder: Path, settings: dict[str, Any]
) -> tuple[dict[str, Tensor], dict[str, Any], list[str]] | None:
    """The newest valid checkpoint's tensors and record, and what was wrong with newer ones; None where there is none.

    Raises CheckpointError for one from a newer version or from other settings, and where all there are are damaged.
    """
    complaints: list[str] = []
    for path in reversed(_listed(folder)):
        try:
            tensors, record = _read(path, settings)
        except _Damaged as error:
            complaints.append(str(error))
            continue
        return tensors, record, complaints
    if complaints:
        raise CheckpointError("; ".join(complaints) + f"; to start again, remove {folder}")
    return None


class _Damaged(Exception):
    """Not what was written."""


def _read(path: Path, settings: dict[str, Any]) -> tuple[dict[str, Tensor], dict[str, Any]]:
    try:
        manifest = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
        data = (path / TENSORS).read_bytes()
        version, checksum, record = manifest["format"], manifest["sha256"], manifest["record"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _Damaged(f"checkpoint {path} is damaged ({type(error).__name__}: {error})") from None
    if version != FORMAT:
        raise CheckpointError(
            f"checkpoint {path} must have format {FORMAT}, which this version reads, got {version}"
        )
    if hashlib.sha256(data).hexdigest() != checksum:
        raise _Damaged(f"checkpoint {path} is damaged: {TENSORS} does not match its checksum")
    other = sorted(key for key in settings if manifest.get("settings", {}).get(key) != settings[key])
    if other:
        raise CheckpointError(f"checkpoint {path} must come from this run, but differs in {', '.join(other)}")
    try:
        return load(data), record
    except (SafetensorError, ValueError) as error:
        raise _Damaged(f"checkpoint {path} is damaged ({error})") from None


def _listed(folder: Path) -> list[Path]:
    """Checkpoints by epoch; what a killed write left behind is not among them."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.name.startswith("epoch_") and path.is_dir())
