"""What a reproduction does whatever it reproduces: its tasks, and its folder, whose files are each whole."""

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from swarm._support import files
from trainers.jobs.executors import Task, run_tasks
from trainers.training.run_folder import RunError

RECORD, REPORT = "reproduction.json", "report.md"
ZOO = "zoo"  # of a reproduction that trained
UNFINISHED = ("runs", "measured")  # what a reproduction goes on with
RESULTS = (".csv", ".html", ".json", ".mp4", ".nc", ".png", ".safetensors", ".yaml")
WRITING = ".writing."  # what a folder is called that is not whole yet


class ReproductionError(RunError):
    """A reproduction that cannot go on as asked; the message says why and what can be done."""


class Delivery(NamedTuple):
    """What a reproduction leaves behind: RECORD, which says whose the folder is, REPORT, and these."""

    files: tuple[str, ...]
    folders: tuple[str, ...]  # whose files are all its own

    def check(self, folder: Path) -> None:
        """Raises ReproductionError where `folder` cannot be written to, or holds results of something else,
        or files that this would overwrite and did not write.
        """
        there = next(path for path in (folder, *folder.parents) if path.exists() or path.is_symlink())
        if not there.is_dir():
            raise ReproductionError(f"{folder} must be a folder, but {there} is a file")
        if not os.access(there, os.W_OK):
            raise ReproductionError(f"{folder} must be a folder to write to, but {there} is read-only")
        names = (REPORT, *self.files, *self.folders, ZOO, RECORD)
        mine = [name for name in names if (folder / name).exists()]
        if mine and RECORD not in mine:
            raise ReproductionError(
                f"{folder} must be a new folder or that of an earlier reproduction: {folder / mine[0]} is "
                f"there, but no {RECORD}"
            )
        others = [] if self.files[0] in mine or not folder.is_dir() else sorted(folder.iterdir())
        for path in others:
            known = path.name in (*names, *UNFINISHED) or path.name.startswith(".")
            if not known and (path.is_dir() or path.suffix in RESULTS):
                raise ReproductionError(
                    f"{folder} must be a new folder or that of an earlier reproduction of the same, got "
                    f"one that holds {path.name}"
                )

    def put_in_place(self, staged: Path, out: Path) -> None:
        """Copy what was written, file by file and each whole: first the record, which says whose folder it
        is, last the report. What is left of an earlier reproduction goes.
        """
        written = {path.relative_to(staged) for path in staged.rglob("*") if path.is_file()}
        for old in [path for name in (*self.folders, ZOO) for path in (out / name).rglob("*")]:
            if old.is_file() and old.relative_to(out) not in written:
                old.unlink()
        for path in sorted(written, key=lambda path: (path.name == REPORT, path.name != RECORD)):
            (out / path).parent.mkdir(parents=True, exist_ok=True)
            files.write_bytes(out / path, (staged / path).read_bytes())

    def deliver(self, out: Path, publish: Path | None, write: Callable[[Path], None]) -> None:
        """Have everything written, then put it in place, in `publish` too where there is one."""
        with staging(out) as staged:
            write(staged)
            for folder in (publish, out):
                if folder is not None:
                    self.put_in_place(staged, folder)


def check_shipping(ship: bool, quick: bool) -> None:
    """Raises ReproductionError where nothing is trained that could be shipped."""
    if ship and quick:
        raise ReproductionError("--ship must come with policies that are trained, not with --quick")


def write_json(path: Path, values: Any) -> None:
    """Write what a reproduction says of itself."""
    stored = json.dumps(values, indent=2, allow_nan=False, ensure_ascii=False)
    path.write_text(stored + "\n", encoding="utf-8")


@contextmanager
def staging(out: Path) -> Iterator[Path]:
    """A folder within `out` that goes again; those of reproductions that were killed go, too."""
    out.mkdir(parents=True, exist_ok=True)
    for left in out.glob(WRITING + "*"):
        shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix=WRITING, dir=out, ignore_cleanup_errors=True) as name:
        yield Path(name)


def do(executor: Executor, tasks: Sequence[Task], what: str) -> list[Any]:
    """Results of all tasks; raises ReproductionError that names those that failed."""
    results = run_tasks(tasks, executor, title=what)
    failed = [
        f"{task.label}: {result}"
        for task, result in zip(tasks, results, strict=True)
        if isinstance(result, Exception)
    ]
    if failed:
        raise ReproductionError(
            f"{len(failed)} of {len(tasks)} {what} failed: {'; '.join(failed)}; the same command goes on "
            "with them"
        )
    return results
