"""The folder of a run: settings, provenance, metrics, policies and the training figure."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

import yaml

from swarm._support import files, provenance
from swarm._support.tables import Table
from trainers.settings.composition import RECORD
from trainers.settings.schema import Settings

SETTINGS, PROVENANCE, METRICS, TIMINGS = "settings.yaml", RECORD, "metrics.csv", "timings.csv"
POLICY, FIGURE, CHECKPOINTS, TEST = "policy.safetensors", "training.png", "checkpoints", "evaluation"
MAX_TEXT = 2**18  # [bytes] of settings and provenance

TIMING_COLUMNS = ("epoch", "seconds", "decisions_per_second", "updates_per_second")


class RunError(RuntimeError):
    """A run that cannot go on as asked; the message says why and what can be done."""


def default_folder(settings: Settings, parent: Path = Path("runs")) -> Path:
    """A new empty folder, whose name nobody else has: experiment, recipe, seed and the time."""
    names = (each.replace(os.sep, "_") for each in (settings.experiment, settings.recipe))
    return files.reserved(parent / f"{'-'.join(names)}-seed{settings.seed}-{datetime.now():%Y%m%d-%H%M%S}")


class RunFolder:
    """Writes what a run leaves behind; every file is whole or not there, but for the growing tables."""

    def __init__(self, path: Path) -> None:
        self.path = files.expanded(path)

    @classmethod
    def create(cls, path: Path, settings: Settings) -> RunFolder:
        """A new folder with settings and provenance, whole or not at all; refuses one that is there."""
        record = {**provenance.origin(), "seeds": settings.seeds}
        record["begun_in"] = str(Path.cwd())  # from where paths of data are told
        with files.new_folder(path) as folder:
            (folder / PROVENANCE).write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
            (folder / SETTINGS).write_text(settings.as_yaml(), encoding="utf-8")
        return cls(path)

    @classmethod
    def open(cls, path: Path) -> tuple[RunFolder, dict[str, Any]]:
        """An existing run and its stored settings, as plain data; nothing in the folder can run."""
        file = files.expanded(path) / SETTINGS
        try:
            stored = plain_yaml(files.read_bytes(file, at_most=MAX_TEXT).decode())
        except (FileNotFoundError, NotADirectoryError):
            raise RunError(f"resume must name the folder of a run, with its {SETTINGS}, got {path}") from None
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            reason = " ".join(str(error).split())
            raise RunError(f"{file} must be a run's settings, but cannot be read: {reason}") from None
        if not isinstance(stored, dict):
            raise RunError(f"{file} must be a run's settings, but holds {type(stored).__name__}")
        return cls(path), stored

    @contextmanager
    def owned(self) -> Iterator[None]:
        """Within, no other process works on this run, and what killed ones left half-written is gone; raises
        RunError where another does.
        """
        with ExitStack() as held:
            try:
                held.enter_context(files.owned(self.path))
            except FileExistsError as error:
                raise RunError(str(error)) from None
            self.tidy()
            yield

    @property
    def policy(self) -> Path:
        """The kept policy."""
        return self.path / POLICY

    @property
    def finished(self) -> bool:
        """Whether the run has come to its end."""
        return self.policy.exists() and self.record.get("finished") is True

    @property
    def record(self) -> dict[str, Any]:
        """What the run was made with: versions, commit, seeds."""
        try:
            record = json.loads(files.read_bytes(self.path / PROVENANCE, at_most=MAX_TEXT))
        except (OSError, ValueError, RecursionError):
            return {}
        return record if isinstance(record, dict) else {}

    def mark_finished(self) -> None:
        """Say that the run has come to its end."""
        record = self.record | {"finished": True}
        files.write_text(self.path / PROVENANCE, json.dumps(record, indent=2) + "\n")

    def tidy(self) -> None:
        """Remove what killed writes left behind; only for the one process that owns the run."""
        within = [self.path / CHECKPOINTS, *self.path.glob("seed_*")]
        folders = [self.path, *(folder for folder in within if not folder.is_symlink())]
        for path in (path for folder in folders for path in folder.glob(".*.*")):
            if re.fullmatch(r"\..+\.[0-9a-f]{12}", path.name) and not path.is_symlink():
                shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)

    def policies(self, settings: Settings) -> Iterator[tuple[int, Path]]:
        """Every seed and where its kept policy lies; stored settings may name any number of them."""
        for seed in range(settings.seed, settings.seed + settings.n_seeds):
            yield seed, self.policy if settings.n_seeds == 1 else self.path / f"seed_{seed}" / POLICY

    def rewrite(self, name: str, columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> None:
        """A table from its beginning: what a killed run wrote after its last checkpoint goes."""
        files.write_text(self.path / name, Table.of(rows, columns).as_csv())

    def append(self, name: str, columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> None:
        """Further rows of a table, which must be there."""
        _, text = Table.of(rows, columns).as_csv().split("\n", 1)
        descriptor = os.open(self.path / name, os.O_WRONLY | os.O_APPEND)
        with files.naming(self.path / name), open(descriptor, "a", encoding="utf-8", newline="") as file:
            file.write(text)

    def rows(self, name: str) -> list[dict[str, str]]:
        """A table's whole rows, not the last of a killed run; none where it is not there."""
        path = self.path / name
        text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
        rows = csv.DictReader(io.StringIO(text[: text.rfind("\n") + 1]))
        whole = (row for row in rows if None not in row.values() and None not in row)
        return [row for row in whole if row.get("epoch", "").isdecimal()]


def part_done(folder: Path, epochs: int) -> float:
    """The part of a run's epochs that are over, read off its timings."""
    return len(RunFolder(folder).rows(TIMINGS)) / epochs


class _PlainLoader(yaml.SafeLoader):
    """Plain data only; aliases, with which a small file can stand for an endless one, are refused, and keys
    that are given twice.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("it must not hold aliases")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        found: set[Any] = set()
        for key, _ in node.value:
            value = self.construct_object(key, deep=True)
            if isinstance(value, str | int | float) and value in found:
                place = key.start_mark
                raise yaml.YAMLError(f"keys must be given once, got {value} again in line {place.line + 1}")
            found |= {value} if isinstance(value, str | int | float) else set()
        return super().construct_mapping(node, deep)


# 1e-3 is a number, as in words.
_PlainLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(?:\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


def plain_yaml(text: str) -> Any:
    """What YAML says; raises YAMLError for anything but plain data."""
    return yaml.load(text, _PlainLoader)


def is_run_folder(path: Path) -> bool:
    """Whether `path` is the folder of a run."""
    return (files.expanded(path) / SETTINGS).is_file()
