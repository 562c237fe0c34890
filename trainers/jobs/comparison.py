"""Runs side by side: the same test for every policy, grouped by what differs besides the seed."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm._support import files, provenance
from swarm._support.tables import Table, percent, span
from swarm._support.terminal import dispensable
from swarm.physics.world import World
from swarm.policies.network import load_policy
from swarm.policies.policy import AnyPolicy
from swarm.population.contest import population_test
from swarm.population.results import RIVAL
from swarm.population.statistics import fraction_of_limit, independent, mean_interval
from trainers.jobs.executors import InProcess
from trainers.settings.composition import by_value, settings_from_stored
from trainers.settings.schema import CELLS, Settings
from trainers.training import run_folder as runs
from trainers.training.run_folder import RunError, RunFolder

if TYPE_CHECKING:
    import xarray as xr

NAMES = ("experiment", "recipe", "algorithm")  # which tell the settings that come with them
SECTIONS = ("world", "learning", "validation", "evaluation")  # of settings that decide what is learnt


class Contender(NamedTuple):
    """One policy of a run, tested."""

    settings: Settings
    seed: int
    gains: np.ndarray  # (worlds, cells)
    greedy: np.ndarray  # (worlds, cells)
    limit: float | None


class Group(NamedTuple):
    """Runs that differ in nothing but the seed."""

    label: str
    members: list[Contender]

    @property
    def means(self) -> np.ndarray:
        """Mean gain (seeds,) of each seed's policy."""
        return np.array([member.gains.mean() for member in self.members])

    def row(self) -> dict[str, Any]:
        """What the table says of the group; low and high: 95% interval of the mean, over seeds and cells, or
        worlds where the cells of one are coupled; None with a single one.
        """
        means, limits = self.means, [member.limit for member in self.members]
        coupled = self.members[0].settings.test_world().is_shared
        units = np.stack([independent(member.gains, coupled) for member in self.members])
        low, high = (mean_interval(units) if units.shape[1] > 1 else None) or (None, None)
        worlds, cells = self.members[0].gains.shape
        limit = None if None in limits else float(np.mean(np.array(limits, float)))
        return {
            "runs": self.label,
            "seeds": len(means),
            "worlds": worlds,
            "cells": cells,
            "mean": float(means.mean()),
            "low": low,
            "high": high,
            "worst": float(means.min()),
            "best": float(means.max()),
            "greedy": float(np.mean([member.greedy.mean() for member in self.members])),
            "limit": limit,
            "fraction_of_limit": fraction_of_limit(float(means.mean()), limit),
        }


def compare(
    folders: Sequence[Path],
    *,
    cells: int | None = None,
    worlds: int | None = None,
    seed: int = 0,
    out: Path | None = None,
    executor: Executor | None = None,
) -> list[Group]:
    """Test the policies of finished runs on the same cells, so many in each of `worlds` worlds; writes
    comparison.csv, comparison.json and comparison.png.

    By default 40 cells of one world; where cells are coupled, as many as the runs' own tests have. Runs are
    tested by the executor, by default one after the other here.

    Folders that hold no run are passed over where others do. Raises RunError where none does or a run is not
    finished.
    """
    if out is not None:
        files.check_new_folder(out)
    known = {folder.resolve(): folder for folder in map(files.expanded, reversed(folders))}  # each one once
    found = [folder for folder in reversed(known.values()) if runs.is_run_folder(folder)]
    if not found:
        raise RunError(f"compare must name folders of runs, got {' '.join(map(str, folders))}")
    for folder in found:
        if not RunFolder(folder).finished:
            raise RunError(f"{folder} must be finished; to go on with it: swarm train resume={folder}")
    tests = [_test(folder, cells, worlds, seed) for folder in found]
    submit = (executor or InProcess()).submit
    futures = [submit(population_test, *each.players, **each.sizes, record="ends") for each in tests]
    groups = grouped(
        [one for each, future in zip(tests, futures, strict=True) for one in _tested(each, future.result())]
    )
    if out is not None:
        _write(out, groups, {"runs": [str(path) for path in found], "seed": seed})
    return groups


def _write(out: Path, groups: Sequence[Group], about: dict[str, Any]) -> None:
    rows = [group.row() for group in groups]
    record = {"groups": rows, **about, "versions": provenance.versions(), "commit": provenance.commit()}
    with files.new_folder(out) as folder:
        (folder / "comparison.csv").write_text(Table.of(rows).as_csv(), encoding="utf-8")
        (folder / "comparison.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
        with dispensable("comparison.png"):
            from swarm import figures

            figure = figures.groups([(row, group.means) for row, group in zip(rows, groups, strict=True)])
            figures.save(figure, folder / "comparison.png")


def grouped(contenders: Sequence[Contender]) -> list[Group]:
    """Contenders by all their settings but the seeds, labelled by what differs between groups.

    The same settings with the same seed are one training, wherever and however often they are named: they
    count once.
    """
    told = [by_value(each.settings) for each in contenders]
    described = [{key: each[key] for key in each if key.split(".")[0] in NAMES + SECTIONS} for each in told]
    keys = [key for key in NAMES if _differs(key, described)]
    others = list(dict.fromkeys(key for each in described for key in each if key not in NAMES))
    for key in others:  # but for those that are the same in all runs that share the names
        alike = itertools.groupby(sorted(described, key=_names), _names)
        keys += [key] if any(_differs(key, list(each)) for _, each in alike) else []
    groups: dict[str, dict[int, Contender]] = {}
    for contender, each in zip(contenders, described, strict=True):
        parts = [each[key] if key in NAMES else f"{key}={each[key]}" for key in keys if key in each]
        label = " ".join(parts or _names(each))
        groups.setdefault(label, {}).setdefault(contender.seed, contender)
    return [Group(label, list(members.values())) for label, members in groups.items()]


def _names(described: Mapping[str, Any]) -> list[str]:
    return [described[name] for name in NAMES]


def _differs(key: str, described: Sequence[Mapping[str, Any]]) -> bool:
    return len({str(each.get(key)) for each in described}) > 1


def table(groups: Sequence[Group]) -> Table:
    """A row per group, best first."""
    headings = ["runs", "seeds", "gain", "95% interval", "worst", "best", "greedy", "of the limit"]
    rows = []
    for row in sorted((group.row() for group in groups), key=lambda each: -each["mean"]):
        interval = None if row["low"] is None else span((row["low"], row["high"]))
        mean, *others = (f"{row[name]:.2f}" for name in ("mean", "worst", "best", "greedy"))
        rows.append([row["runs"], row["seeds"], mean, interval, *others, percent(row["fraction_of_limit"])])
    return Table(headings, rows)


class _Test(NamedTuple):
    """How the policies of a run are tested."""

    settings: Settings
    players: tuple[World, dict[str, AnyPolicy]]
    sizes: dict[str, Any]


def _test(folder: Path, cells: int | None, worlds: int | None, seed: int) -> _Test:
    run, stored = RunFolder.open(folder)
    settings = settings_from_stored(stored, run.path)
    policies: dict[str, AnyPolicy] = {str(each): load_policy(path) for each, path in run.policies(settings)}
    world = settings.test_world()
    own = settings.evaluation
    usual = (own.cells, own.worlds) if world.is_shared else (CELLS, 1)
    cells, worlds = (usual[0] if cells is None else cells), (usual[1] if worlds is None else worlds)
    sizes = {"cells": cells, "worlds": worlds, "life": world.life, "seed": seed}
    return _Test(settings, (world, policies), sizes)


def _tested(test: _Test, results: xr.Dataset) -> list[Contender]:
    shape = (-1, test.sizes["worlds"], test.sizes["cells"])
    lived = results["gain"].transpose("policy", ..., "cell").values.reshape(shape)
    gains = dict(zip(results["policy"].values, lived, strict=True))
    greedy, limit = gains.pop(RIVAL), results.attrs.get("limit")
    return [Contender(test.settings, int(name), gain, greedy, limit) for name, gain in gains.items()]
