"""Files of a reproduction, put in place whole once all of them are there."""

from __future__ import annotations

import dataclasses
import json
import shutil
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from swarm._support import files, provenance
from trainers.paper import report, tables
from trainers.paper.claims import Claim
from trainers.paper.illustrations import FOLDER as FIGURES
from trainers.paper.illustrations import Drawing
from trainers.paper.measurements import Case
from trainers.paper.plan import Plan, Training
from trainers.paper.statements import Evidence, all_claims
from trainers.training.run_folder import RunFolder

RECORD = "reproduction.json"  # settings, versions, commits; it says that a folder is a reproduction's
CLAIMS, REPORT, RESULTS, SEEDS = "claims.json", "report.md", "results.csv", "seeds.csv"
LIVES = "lives"  # of every cell, a file per test
FILES = (REPORT, CLAIMS, RESULTS, SEEDS, RECORD, FIGURES, LIVES)


@contextmanager
def staging(out: Path) -> Iterator[Path]:
    """A folder to write to, removed at the end."""
    folder = out / f".writing.{uuid.uuid4().hex[:12]}"
    for left in out.glob(".writing.*"):  # by a reproduction that was killed
        shutil.rmtree(left, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def put_in_place(staged: Path, out: Path) -> None:
    """Copy what was written, file by file and each whole: first the record, which says whose folder it is,
    last the report. What is left of an earlier reproduction goes.
    """
    written = {path.relative_to(staged) for path in staged.rglob("*") if path.is_file()}
    for old in [path for name in (FIGURES, LIVES) for path in (out / name).rglob("*") if path.is_file()]:
        if old.relative_to(out) not in written:
            old.unlink()
    for path in sorted(written, key=lambda path: (path.name == REPORT, path.name != RECORD)):
        (out / path).parent.mkdir(parents=True, exist_ok=True)
        files.write_bytes(out / path, (staged / path).read_bytes())


def write(
    folder: Path,
    plan: Plan,
    tests: Sequence[Case],
    evidence: Evidence,
    planned: Sequence[Training],
    drawn: Sequence[Drawing],
) -> list[Claim]:
    """Write everything but the figures, which are there; returns the claims."""
    recipes = tuple(dict.fromkeys(stack.recipe for case in tests for stack in case.stacks))
    claims = all_claims(evidence, recipes)
    results, seeds = tables.result_rows(tests, evidence), tables.seed_rows(tests, evidence)
    _write_json(folder / CLAIMS, [each.as_json() for each in claims])
    _write_json(folder / RECORD, where_from(plan, planned, tests))
    (folder / RESULTS).write_text(tables.as_csv(results), encoding="utf-8")
    (folder / SEEDS).write_text(tables.as_csv(seeds), encoding="utf-8")
    (folder / LIVES).mkdir()
    for case in tests:
        _save_lives(case, evidence, folder / LIVES / f"{case.name}.nc")
    text = report.text(plan, tests, evidence, claims, results, tables.training_rows(planned), drawn)
    (folder / REPORT).write_text(text, encoding="utf-8")
    return claims


def _write_json(path: Path, values: Any) -> None:
    text = json.dumps(values, indent=2, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def where_from(plan: Plan, planned: Sequence[Training], tests: Sequence[Case]) -> dict[str, Any]:
    """What reproduction.json says: the plan, versions, commits, and the settings of every training."""
    trained: dict[str, Any] = {}
    for each in planned:
        record = RunFolder(each.folder).record
        trained[f"{each.recipe}/{each.experiment}"] = {
            "run": tables.runs_folder(each),
            "seeds": each.settings.seeds,
            "settings": dataclasses.asdict(each.settings),
            "versions": record.get("versions"),
            "commit": record.get("commit"),
        }
    for stack in [stack for case in tests for stack in case.stacks if not planned]:
        card = stack.choice.card
        trained[f"{stack.recipe}/{stack.experiment}"] = {
            "shipped": True,
            "seeds": list(stack.seeds),
            **{name: card.get(name) for name in ("settings", "versions", "commit")},
        }
    plain = dataclasses.asdict(plan)
    plain.pop("workers")  # no number depends on it
    return {
        "plan": plain,
        "versions": provenance.versions(),
        "commit": provenance.commit(),
        "trainings": trained,
    }


def _save_lives(case: Case, evidence: Evidence, path: Path) -> None:
    """Gain, arrival and drift of every cell under every policy."""
    import numpy as np
    import xarray as xr

    lives = evidence.cases[case.name].lives
    names = [
        "/".join([*filter(None, key), *([f"seed {seed}"] if each.seeds else [])])
        for key, each in lives.items()
        for seed in each.seeds or (0,)
    ]
    variables: dict[str, Any] = {
        name: (("policy", "cell"), np.concatenate([getattr(each, name) for each in lives.values()]))
        for name in ("gain", "arrived", "lifetime")
    }
    drift = np.concatenate([each.drift for each in lives.values()])
    variables["drift"] = (("policy", "cell", "axis"), drift)
    data = xr.Dataset(variables, {"policy": names, "axis": ["x", "y"]})
    data.attrs |= {"test": case.name, "seed": case.seed, "life": case.world.life}
    if (limit := evidence.cases[case.name].limit) is not None:
        data.attrs["limit"] = limit
    data.to_netcdf(path, engine="h5netcdf")
