"""Runs side by side: the same test for every policy, grouped by what differs besides the seed."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarm._support import files, provenance
from swarm._support.checks import check_name
from swarm._support.tables import Table
from swarm._support.terminal import dispensable
from swarm.physics.world import World
from swarm.policies.network import Network, load_policy
from swarm.population.contest import population_test
from swarm.population.results import RIVAL
from swarm.population.statistics import times_to_egg
from trainers.jobs.cluster import HERE, Where, launched
from trainers.jobs.executors import Task, run_tasks
from trainers.jobs.statistics import CELLS, Lives, beside, readable, summary
from trainers.settings import schema
from trainers.settings.composition import by_value, differing, settings_from_stored
from trainers.settings.schema import Settings
from trainers.training.run_folder import RunError, RunFolder, is_run_folder

NAMES = ("experiment", "recipe", "algorithm")  # which tell the settings that come with them
SYMBOLS = {  # of settings in tables and figures; others are told by their keys
    "world.n_records": "N_T",
    "world.life": "t_life",
    "world.time_step": "Δt",
    "world.curvatures": "κ",
    "learning.discount": "γ",
    "learning.learning_rate": "α",
}
TABLES = {"md": Table.as_markdown, "tex": Table.as_latex}
PICTURES = ("png", "pdf", "svg")


class Contender(NamedTuple):
    """One policy of a run, tested."""

    settings: Settings
    seed: int
    lives: Lives
    life: float


class Group(NamedTuple):
    """Runs that differ in nothing but the seed."""

    label: str
    members: list[Contender]

    @property
    def lives(self) -> Lives:
        """Those of all seeds."""
        every = [member.lives for member in self.members]
        times = None if every[0].times is None else np.concatenate([each.times for each in every])
        return every[0]._replace(gain=np.concatenate([each.gain for each in every]), times=times)

    def row(self) -> dict[str, Any]:
        """What comparison.csv says of the group."""
        return {"runs": self.label, **summary(self.lives), "life": self.members[0].life}


def compare(
    folders: Sequence[Path],
    *,
    cells: int | None = None,
    worlds: int | None = None,
    life: float | None = None,
    seed: int = 0,
    out: Path | None = None,
    formats: Sequence[str] = ("png",),
    where: Where = HERE,
) -> list[Group]:
    """Test the policies of finished runs on the same cells, so many in each of `worlds` worlds; writes
    comparison.csv, comparison.json, and the table and the figure in the `formats`: md, tex; png, pdf, svg.

    By default 40 cells of one world, where cells are coupled as many as the runs' own tests have, and the
    life of the runs. Tests are computed as `launched(*where)` says.

    Folders that hold no run are passed over where others do. Raises RunError where none does or a run is not
    finished.
    """
    for each in formats:
        check_name("format", each, dict.fromkeys((*TABLES, *PICTURES)))
    if out is not None:
        files.check_new_folder(out)
    known = {folder.resolve(): folder for folder in map(files.expanded, reversed(folders))}  # each one once
    found = [folder for folder in reversed(known.values()) if is_run_folder(folder)]
    if not found:
        raise RunError(f"compare must name folders of runs, got {' '.join(map(str, folders))}")
    for folder in found:
        if not RunFolder(folder).finished:
            raise RunError(f"{folder} must be finished; to go on with it: swarm train resume={folder}")
    with launched(*where) as executor:
        tests = [_test_of(folder, cells, worlds, life, seed) for folder in found]
        outcomes = run_tasks(
            [Task(folder.name, tested, each) for folder, each in zip(found, tests, strict=True)],
            executor,
            title="tests",
        )
    for outcome in outcomes:
        if isinstance(outcome, BaseException):
            raise outcome
    groups = grouped([each for contenders in outcomes for each in contenders])
    if out is not None:
        _write(out, groups, {"runs": [str(path) for path in found], "seed": seed}, formats)
    return groups


def _write(out: Path, groups: Sequence[Group], about: dict[str, Any], formats: Sequence[str]) -> None:
    rows = [group.row() for group in groups]
    record = {"groups": rows, **about, **provenance.origin()}
    with files.new_folder(out) as folder:
        (folder / "comparison.csv").write_text(Table.of(rows).as_csv(), encoding="utf-8")
        (folder / "comparison.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
        for each in formats:
            if each in TABLES:
                (folder / f"comparison.{each}").write_text(TABLES[each](table(groups)), encoding="utf-8")
                continue
            with dispensable(f"comparison.{each}"):
                from swarm import figures

                drawn = [
                    ({**row, "runs": in_symbols(group.label)}, group.lives.gain.mean(axis=CELLS))
                    for row, group in zip(rows, groups, strict=True)
                ]
                figures.save(figures.groups(drawn), folder / f"comparison.{each}")


def grouped(contenders: Sequence[Contender]) -> list[Group]:
    """Contenders by all their settings but the seeds, labelled by what differs between groups.

    The same settings with the same seed are one training, wherever and however often they are named: they
    count once.
    """
    told, decisive = [by_value(each.settings) for each in contenders], NAMES + schema.SECTIONS
    described = [{key: each[key] for key in each if key.split(".")[0] in decisive} for each in told]
    alike: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for each in described:
        alike.setdefault(tuple(each[name] for name in NAMES), []).append(each)
    # the names that differ, and what differs between runs that share them
    which = {key for key in differing(described) if key in NAMES}
    which |= {key for runs in alike.values() for key in differing(runs)}
    keys = [key for key in dict.fromkeys(key for each in described for key in each) if key in which]
    groups: dict[str, dict[int, Contender]] = {}
    for contender, each in zip(contenders, described, strict=True):
        parts = [each[key] if key in NAMES else f"{key}={_short(each[key])}" for key in keys if key in each]
        label = " ".join(parts or [each[name] for name in NAMES])
        groups.setdefault(label, {}).setdefault(contender.seed, contender)
    return [Group(label, list(members.values())) for label, members in groups.items()]


def _short(value: Any) -> str:
    """A setting in few words: parts of a world by type and what they state, checksums by their beginning."""
    if not isinstance(value, Mapping):
        return str(value)
    stated = {key: each for key, each in value.items() if each is not None and key != "type"}
    told = [f"{key} {str(each)[:8] if key == 'sha256' else _short(each)}" for key, each in stated.items()]
    kind = [value["type"]] if "type" in value else []
    return " ".join([*kind, *([f"({', '.join(told)})"] if told else [])])


def in_symbols(label: str) -> str:
    """A group's label with the field's symbols in place of the keys of settings."""
    for key, symbol in SYMBOLS.items():
        label = re.sub(rf"(?<!\S){re.escape(key)}=", f"{symbol}=", label)
    return label


def table(groups: Sequence[Group]) -> Table:
    """A row per group, best first."""
    rows = sorted((group.row() for group in groups), key=lambda row: -row["mean"])
    return beside(["runs"], [[in_symbols(row["runs"])] for row in rows], readable(rows))


def _test_of(
    folder: Path, cells: int | None, worlds: int | None, life: float | None, seed: int
) -> tuple[Settings, World, dict[str, Network], dict[str, Any]]:
    """What `tested` takes of a finished run."""
    run, stored = RunFolder.open(folder)
    settings = settings_from_stored(stored, run.path)
    policies = {str(each): load_policy(path) for each, path in run.policies(settings)}
    world, own = settings.test_world(), settings.evaluation
    usual = (own.cells, own.worlds) if world.is_shared else (schema.CELLS, 1)
    sizes: dict[str, Any] = {"cells": usual[0] if cells is None else cells}
    sizes |= {"worlds": usual[1] if worlds is None else worlds, "seed": seed}
    return settings, world, policies, sizes | {"life": world.life if life is None else life}


def tested(
    settings: Settings, world: World, policies: Mapping[str, Network], sizes: Mapping[str, Any]
) -> list[Contender]:
    """Every seed's policy on the same cells."""
    results = population_test(world, policies, **sizes, record=False)
    shape = len(results["policy"]), sizes["worlds"], sizes["cells"]
    gain, names = results["gain"].values.reshape(shape), results["policy"].values.tolist()
    times = None if world.egg is None else times_to_egg(results).values.reshape(shape)
    greedy, limit = gain[names.index(RIVAL)], results.attrs.get("limit", np.nan)
    return [
        Contender(
            settings,
            int(name),
            Lives(gain[[i]], greedy, None if times is None else times[[i]], limit, world.is_shared),
            sizes["life"],
        )
        for i, name in enumerate(names)
        if name != RIVAL
    ]
