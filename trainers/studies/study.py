"""What studies have in common: their tasks, what they keep, and their folder, whose files are each whole.

Training runs are ordinary run folders in OUT/runs/RECIPE/EXPERIMENT; a study that was stopped goes on with
them and with what it measured or searched. Every other file of OUT is written again at the end, each whole,
the report last.
"""

import dataclasses
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarm._support import files, provenance, tensors
from swarm._support.checks import check_installed
from swarm._support.tables import Table
from trainers.jobs.executors import Task, run_tasks
from trainers.studies import stacks, zoo
from trainers.studies.plan import Training, TrainingPlan, trainings
from trainers.training.run_folder import RunError

RECORD, REPORT, FIGURES = "reproduction.json", "report.md", "figures"
UNFINISHED = ("runs", "measured", "searched")  # what a study goes on with
RESULTS = (".csv", ".html", ".json", ".mp4", ".nc", ".png", ".safetensors", ".yaml")
WRITING = ".writing."  # what a folder is called that is not whole yet
DIGITS = 6  # of numbers in tables


class Contents(NamedTuple):
    """What a study writes besides figures."""

    tables: Mapping[str, Sequence[Mapping[str, Any]]]  # rows, by file
    report: str
    record: Mapping[str, Any] = {}  # where numbers come from, besides the plan, versions and settings
    claims: Mapping[str, Sequence[Any]] = {}  # by file


class Study(NamedTuple):
    """What a study does of its own, and leaves behind besides RECORD, REPORT and FIGURES."""

    own: str  # a field that only its plan has: so a record tells whose a folder is
    files: tuple[str, ...]
    find: Callable[[Any, Sequence[Training], Path], Any]  # of a plan, its trainings and the folder
    write: Callable[[Any, Sequence[Training], Any, Path], Contents]  # of what was found; it draws figures
    folders: tuple[str, ...] = (FIGURES,)  # whose files are all its own
    needs: tuple[str, ...] = ()  # what needs packages of the extra `evolution`, and which

    def carry_out(
        self, plan: TrainingPlan, out: Path, publish: Path | None = None, *, ship: bool = False
    ) -> Any:
        """Train, measure, judge, draw and report into `out`, with a copy of all but what it goes on with in
        `publish`; `ship` puts the policies that validation prefers in the place of those that are shipped.

        Returns what was found. Raises RunError, SettingsError, ImportError, KeyboardInterrupt or OSError.
        """
        if self.needs:
            check_installed(*self.needs, extra="evolution")
        for folder in (out, publish or out):
            self.check(folder)
        if ship and plan.quick:
            raise RunError("--ship must come with policies that are trained, not with --quick")
        planned = trainings(plan, out)
        train(plan, planned)
        found = self.find(plan, planned, out)
        out.mkdir(parents=True, exist_ok=True)
        for left in out.glob(WRITING + "*"):  # of studies that were killed
            shutil.rmtree(left, ignore_errors=True)
        with tempfile.TemporaryDirectory(prefix=WRITING, dir=out, ignore_cleanup_errors=True) as name:
            staged = Path(name)
            (staged / FIGURES).mkdir()
            _write(self.write(plan, planned, found, staged), plan, planned, staged)
            if publish is not None:
                self.put_in_place(staged, publish, without=zoo.FOLDER)
            self.put_in_place(staged, out)
        if ship:
            print(f"shipped in {zoo.SHIPPED}: {', '.join(zoo.ship(out))}")
        return found

    def check(self, folder: Path) -> None:
        """Raises RunError where `folder` cannot be written to, or holds results of something else, or files
        that this would overwrite and did not write.
        """
        there = next(path for path in (folder, *folder.parents) if path.exists() or path.is_symlink())
        if not there.is_dir():
            raise RunError(f"{folder} must be a folder, but {there} is a file")
        if not os.access(there, os.W_OK):
            raise RunError(f"{folder} must be a folder to write to, but {there} is read-only")
        if (folder / RECORD).exists():
            strange = [] if self._wrote(folder / RECORD) else [f"another's {RECORD}"]
        else:
            mine = (REPORT, *self.files, *self.folders, zoo.FOLDER)
            there_now = sorted(folder.iterdir()) if folder.is_dir() else []
            strange = [path.name for path in there_now if path.name in mine or _is_result(path)]
        if strange:
            raise RunError(
                f"{folder} must be a new folder or that of an earlier study of the same kind, got one that "
                f"holds {strange[0]}"
            )

    def _wrote(self, record: Path) -> bool:
        """Whether a record is of this kind of study."""
        try:
            return self.own in json.loads(record.read_text(encoding="utf-8"))["plan"]
        except (ValueError, KeyError, TypeError):
            return False

    def put_in_place(self, staged: Path, out: Path, *, without: str = "") -> None:
        """Copy what was written, file by file and each whole: first the record, which says whose folder it
        is, last the report. What is left of an earlier study goes.
        """
        written = {path.relative_to(staged) for path in staged.rglob("*") if path.is_file()}
        written = {path for path in written if path.parts[0] != without}
        for old in [path for name in (*self.folders, zoo.FOLDER) for path in (out / name).rglob("*")]:
            if old.is_file() and old.relative_to(out) not in written:
                old.unlink()
        for path in sorted(written, key=lambda path: (path.name == REPORT, path.name != RECORD)):
            (out / path).parent.mkdir(parents=True, exist_ok=True)
            files.write_bytes(out / path, (staged / path).read_bytes())


def _is_result(path: Path) -> bool:
    """Whether something else may have written it, and would miss it."""
    hidden = path.name in UNFINISHED or path.name.startswith(".")
    return not hidden and (path.is_dir() or path.suffix in RESULTS)


def _write(contents: Contents, plan: TrainingPlan, planned: Sequence[Training], folder: Path) -> None:
    for name, rows in contents.tables.items():
        headings = dict.fromkeys(heading for row in rows for heading in row)
        full = [{heading: row.get(heading) for heading in headings} for row in rows]
        (folder / name).write_text(Table.of(full).as_csv(DIGITS), encoding="utf-8")
    record = {"plan": plan.recorded(), **provenance.origin(), **contents.record}
    record.setdefault("trainings", {each.name: dataclasses.asdict(each.settings) for each in planned})
    claims = {name: [each._asdict() for each in judged] for name, judged in contents.claims.items()}
    for name, values in (claims | {RECORD: record}).items():
        stored = json.dumps(values, indent=2, allow_nan=False, ensure_ascii=False)
        (folder / name).write_text(stored + "\n", encoding="utf-8")
    (folder / REPORT).write_text(contents.report, encoding="utf-8")


# --- tasks --------------------------------------------------------------------------------------------------


def train(plan: TrainingPlan, planned: Sequence[Training]) -> None:
    """Train what is still to be trained; a run that is no longer of use is set aside."""
    found = {each.folder: each for each in reversed(planned)}  # of those that share a run, the first
    wanted = [each for each in found.values() if not stacks.is_done(each)]
    if len(wanted) < len(found):
        print(f"{len(found) - len(wanted)} of {len(found)} trainings are finished", flush=True)
    if wanted:
        from trainers.jobs import sweep  # it needs torch

        tasks, executor = sweep.trainings({each.folder: each.settings for each in wanted}, plan.executor())
        own = [
            task._replace(label=each.run, seconds=each.decisions, keep=partial(stacks.tidy, each.folder))
            for task, each in zip(tasks, wanted, strict=True)
        ]
        do(executor, own, "trainings")


def do(executor: Executor, tasks: Sequence[Task], what: str) -> dict[str, Any]:
    """Results of all tasks by their labels; raises RunError that names those that failed."""
    results = dict(zip([task.label for task in tasks], run_tasks(tasks, executor, title=what), strict=True))
    failed = [f"{label}: {result}" for label, result in results.items() if isinstance(result, Exception)]
    if failed:
        raise RunError(
            f"{len(failed)} of {len(tasks)} {what} failed: {'; '.join(failed)}; the same command goes on "
            "with them"
        )
    return results


Packed = tuple[dict[str, np.ndarray], dict[str, Any]]  # arrays, and what else is to be known of them


def do_once(
    executor: Executor,
    tasks: Mapping[Path, Task],
    what: str,
    packed: Callable[[Any], Packed],
    unpacked: Callable[[Task, dict[str, np.ndarray], dict[str, Any]], Any],
) -> dict[str, Any]:
    """As `do`, of tasks by the files that keep what comes of them: where a file is there it is read."""

    def keep(path: Path, outcome: Any) -> Any:
        path.parent.mkdir(parents=True, exist_ok=True)
        tensors.write(path, *packed(outcome))
        return outcome

    held = {
        task.label: unpacked(task, *tensors.read(path, lambda card, shapes: None, at_most=2**28))
        for path, task in tasks.items()
        if path.exists()
    }
    left = [task._replace(keep=partial(keep, path)) for path, task in tasks.items() if task.label not in held]
    done = held | do(executor, left, what)
    return {task.label: done[task.label] for task in tasks.values()}


def kept_in(folder: Path, name: str, plain: Any, parts: Iterable[Any]) -> Path:
    """The file that keeps what depends on `plain` data, on arrays and texts, and on versions."""
    found = hashlib.sha256(json.dumps(plain, default=str).encode())
    for part in parts:
        found.update(part.encode() if isinstance(part, str) else np.ascontiguousarray(part).tobytes())
    return folder / f"{name}.{found.hexdigest()[:16]}.safetensors"
