"""Runs side by side: the same test for every policy, grouped by what differs besides the seed."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarm._support import files, provenance
from swarm.policies.network import load_policy
from swarm.population.contest import population_test
from swarm.population.intervals import mean_interval
from swarm.population.statistics import fraction_of_limit
from trainers.settings.composition import settings_from_stored
from trainers.settings.schema import Settings
from trainers.training import run_folder as runs

NAMES = ("experiment", "recipe")  # which tell the settings that come with them
COLUMNS = ("runs", "seeds", "mean", "low", "high", "worst", "best", "greedy", "limit", "fraction_of_limit")


class Contender(NamedTuple):
    """One policy of a run, tested."""

    settings: Settings
    seed: int
    gains: np.ndarray  # (cells,)
    greedy: np.ndarray  # (cells,)
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
        """What the table says of the group; low and high: 95% interval of the mean, over seeds and cells."""
        interval = mean_interval(np.stack([member.gains for member in self.members]))
        low, high = (None, None) if interval is None else interval
        limits = [member.limit for member in self.members]
        limit = None if None in limits else float(np.mean(limits))  # type: ignore[arg-type]
        return {
            "runs": self.label,
            "seeds": len(self.members),
            "mean": float(self.means.mean()),
            "low": low,
            "high": high,
            "worst": float(self.means.min()),
            "best": float(self.means.max()),
            "greedy": float(np.mean([member.greedy.mean() for member in self.members])),
            "limit": limit,
            "fraction_of_limit": fraction_of_limit(float(self.means.mean()), limit),
        }


def compare(
    folders: Sequence[Path], *, cells: int = 40, seed: int = 0, out: Path | None = None
) -> list[Group]:
    """Test the policies of finished runs on the same cells; writes comparison.csv, comparison.json and
    comparison.png.

    Folders that hold no run are passed over where others do. Raises RunError where none does or a run is not
    finished.
    """
    if out is not None:
        files.check_new_folder(out)
    found = [Path(folder) for folder in folders if runs.is_run_folder(Path(folder))]
    if not found:
        raise runs.RunError(f"compare must name folders of runs, got {' '.join(map(str, folders))}")
    for folder in found:
        if not runs.RunFolder(folder).finished:
            raise runs.RunError(f"{folder} must be finished; to go on with it: swarm train resume={folder}")
    groups = grouped([each for folder in found for each in _tested(folder, cells, seed)])
    if out is not None:
        from swarm import figures

        rows = [group.row() for group in groups]
        with files.new_folder(out) as folder:
            buffer = io.StringIO()
            writer = csv.DictWriter(buffer, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
            (folder / "comparison.csv").write_text(buffer.getvalue(), encoding="utf-8")
            record = {"groups": rows, "runs": [str(path) for path in found], "cells": cells, "seed": seed}
            record |= {"versions": provenance.versions(), "commit": provenance.commit()}
            (folder / "comparison.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
            figures.save(
                figures.groups([(row, group.means) for row, group in zip(rows, groups, strict=True)]),
                folder / "comparison.png",
            )
    return groups


def grouped(contenders: Sequence[Contender]) -> list[Group]:
    """Contenders by all their settings but the seeds, labelled by what differs between groups."""
    described = [_flat(contender.settings) for contender in contenders]
    keys = [key for key in NAMES if _differ(each[key] for each in described)]
    keys += [key for key in described[0] if key not in NAMES and not _told_by_names(key, described)]
    groups: dict[str, list[Contender]] = {}
    for contender, flat in zip(contenders, described, strict=True):
        parts = [str(flat[key]) if key in NAMES else f"{key}={flat[key]}" for key in keys]
        label = " ".join(parts) or f"{contender.settings.experiment} {contender.settings.recipe}"
        groups.setdefault(label, []).append(contender)
    return [Group(label, members) for label, members in groups.items()]


def _differ(values: Iterable[Any]) -> bool:
    return len({str(value) for value in values}) > 1


def _told_by_names(key: str, described: Sequence[dict[str, Any]]) -> bool:
    """Whether experiment and recipe tell a setting: runs that share both have the same value."""
    values: dict[tuple[str, str], list[Any]] = {}
    for flat in described:
        values.setdefault((flat["experiment"], flat["recipe"]), []).append(flat[key])
    return not any(_differ(alike) for alike in values.values())


def table(groups: Sequence[Group]) -> list[list[str]]:
    """A row per group after the row of headings, best first."""
    rows = [["runs", "seeds", "gain", "95% interval", "worst", "best", "greedy", "of the limit"]]
    for row in sorted((group.row() for group in groups), key=lambda each: -each["mean"]):
        interval = "–" if row["low"] is None else f"{row['low']:.2f} … {row['high']:.2f}"
        fraction = "–" if row["fraction_of_limit"] is None else f"{100 * row['fraction_of_limit']:.1f}%"
        numbers = [f"{row[name]:.2f}" for name in ("mean", "worst", "best", "greedy")]
        rows.append([row["runs"], str(row["seeds"]), numbers[0], interval, *numbers[1:], fraction])
    return rows


def _tested(folder: Path, cells: int, seed: int) -> list[Contender]:
    run, stored = runs.RunFolder.open(folder)
    settings = settings_from_stored(stored)
    found = []
    for each in range(settings.seed, settings.seed + settings.n_seeds):  # stored, so there may be any number
        path = run.policy if settings.n_seeds == 1 else run.seed_folder(each) / runs.POLICY
        world = settings.test_world()
        results = population_test(
            world, {"dqn": load_policy(path)}, cells=cells, life=world.life, seed=seed, record=False
        )
        gain = results["gain"]
        found.append(
            Contender(
                settings,
                each,
                gain.sel(policy="dqn").values,
                gain.sel(policy="greedy").values,
                results.attrs.get("limit"),
            )
        )
    return found


def _flat(settings: Settings) -> dict[str, Any]:
    """Settings that decide what is learnt, dotted, without the seeds."""
    import dataclasses

    flat = {"experiment": settings.experiment, "recipe": settings.recipe}
    for section in ("world", "learning", "validation", "evaluation"):
        for key, value in dataclasses.asdict(getattr(settings, section)).items():
            flat[f"{section}.{key}"] = value
    return flat
