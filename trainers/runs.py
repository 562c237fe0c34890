"""The folder of a run: settings, provenance, metrics, policies and the training figure."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import yaml

from swarm import files, provenance
from trainers.settings import Settings

SETTINGS, PROVENANCE, METRICS, TIMINGS = "settings.yaml", "run.json", "metrics.csv", "timings.csv"
POLICY, FIGURE, CHECKPOINTS = "policy.safetensors", "training.png", "checkpoints"

# What the columns of metrics.csv mean is defined where they are computed: `training.Training._measure`.
METRIC_COLUMNS = (
    "epoch",
    "seed",
    "training_gain",
    "loss",
    "q_mean",
    "epsilon",
    "learning_rate",
    "decisions",
    "updates",
    "gain",
    "fraction_of_limit",
)
TIMING_COLUMNS = ("epoch", "seconds", "decisions_per_second", "updates_per_second")


class RunError(RuntimeError):
    """A run folder that cannot be used as asked."""


def default_folder(settings: Settings, parent: Path = Path("runs")) -> Path:
    """A name that is not taken: experiment, recipe, seed and the time."""
    stem = f"{settings.experiment}-{settings.recipe}-seed{settings.seed}-{datetime.now():%Y%m%d-%H%M%S}"
    folder, count = parent / stem, 1
    while folder.exists():
        count += 1
        folder = parent / f"{stem}-{count}"
    return folder


class RunFolder:
    """Writes what a run leaves behind; every file is whole or not there, but for the growing tables."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)

    @classmethod
    def create(cls, path: Path, settings: Settings) -> RunFolder:
        """A new folder with settings and provenance; refuses one that is already there."""
        files.check_new_folder(path)
        path.mkdir(parents=True, exist_ok=True)
        run = cls(path)
        record = {"versions": provenance.versions(), "commit": provenance.commit(), "seeds": settings.seeds}
        files.write_text(path / PROVENANCE, json.dumps(record, indent=2) + "\n")
        # last, because a folder with settings is a run that can be resumed
        files.write_text(path / SETTINGS, yaml.safe_dump(dataclasses.asdict(settings), sort_keys=False))
        return run

    @classmethod
    def open(cls, path: Path) -> tuple[RunFolder, dict[str, Any]]:
        """An existing run and its stored settings, as plain data."""
        file = Path(path) / SETTINGS
        try:
            stored = yaml.safe_load(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise RunError(f"resume must name the folder of a run, with its {SETTINGS}, got {path}") from None
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise RunError(f"{file} must be a run's settings, but cannot be read: {error}") from None
        if not isinstance(stored, dict):
            raise RunError(f"{file} must be a run's settings, but holds {type(stored).__name__}")
        return cls(Path(path)), stored

    @property
    def policy(self) -> Path:
        """The kept policy."""
        return self.path / POLICY

    @property
    def finished(self) -> bool:
        """Whether the run has come to its end."""
        return self.policy.exists() and bool(json.loads((self.path / PROVENANCE).read_text()).get("finished"))

    def mark_finished(self) -> None:
        """Say that the run has come to its end."""
        record = json.loads((self.path / PROVENANCE).read_text())
        files.write_text(self.path / PROVENANCE, json.dumps(record | {"finished": True}, indent=2) + "\n")

    def seed_folder(self, seed: int) -> Path:
        """Where a seed's policy lies in a run of several."""
        return self.path / f"seed_{seed}"

    def rewrite(self, name: str, columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> None:
        """A table from its beginning: what a killed run wrote after its last checkpoint goes."""
        files.write_text(self.path / name, _table(columns, rows, header=True))

    def append(self, name: str, columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> None:
        """Further rows of a table."""
        with (self.path / name).open("a", encoding="utf-8", newline="") as file:
            file.write(_table(columns, rows, header=False))


def read_table(path: Path) -> list[dict[str, str]]:
    """Rows of a table; a last line that was only half written is left out."""
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    return [row for row in csv.DictReader(io.StringIO(whole)) if None not in row.values() and None not in row]


def is_run_folder(path: Path) -> bool:
    """Whether `path` is the folder of a run."""
    return (Path(path) / SETTINGS).is_file()


def safe_name(text: str) -> str:
    """`text` as the name of a file."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", text)


def _table(columns: Sequence[str], rows: Sequence[dict[str, Any]], *, header: bool) -> str:
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, lineterminator="\n")
    if header:
        writer.writeheader()
    writer.writerows({key: _written(value) for key, value in row.items()} for row in rows)
    return buffer.getvalue()


def _written(value: Any) -> Any:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else value
