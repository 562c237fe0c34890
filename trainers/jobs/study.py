"""Studies: a grid of settings, seeds and tests in one file, and one dataset of all that was found.

A study is a folder: its file, ordinary runs, population tests, the dataset with named axes, table and
figures. Runs are known by their settings and seeds, wherever in the grid they are: what is there is neither
trained nor tested again, what is asked for no longer stays, but is not in the dataset.
"""

import dataclasses
import hashlib
import itertools
import json
import os
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from swarm._support import files, provenance
from swarm._support.tables import Table
from swarm._support.terminal import dispensable
from swarm.physics.world import World
from swarm.policies.network import load_policy
from swarm.policies.policy import AnyPolicy, fingerprint
from swarm.population.contest import population_test
from swarm.population.results import save_population
from trainers.jobs.cluster import HERE, Where, launched
from trainers.jobs.executors import Task, run_tasks
from trainers.jobs.statistics import beside, readable, summary
from trainers.jobs.study_dataset import Tested, Tests, as_dataset
from trainers.jobs.study_figure import Request, axes_of, lives_at, panels, request_of
from trainers.jobs.study_plan import Plan, learnt, name_of, plan_of, stacks
from trainers.jobs.sweep import MAX_NAME, trainings
from trainers.settings.composition import SettingsError, settings_from_stored
from trainers.settings.schema import Settings
from trainers.training.run import check_machine
from trainers.training.run_folder import RunError, RunFolder, is_run_folder

FILE, DATASET, TABLE = "study.yaml", "study.nc", "study.csv"
RUNS, TESTS, FIGURES = "runs", "tests", "figures"


class Found(NamedTuple):
    """What a study found."""

    folder: Path
    results: xr.Dataset
    table: Table  # a row per place of the grid and test


def study(
    source: Path, out: Path | None = None, *, figures: Sequence[str] = (), where: Where = HERE
) -> Found:
    """Do what a study's file, or that of a study's folder, asks for: train and test what is missing, computed
    as `launched(*where)` says, and write dataset, table and figures.

    By default the folder is runs/NAME of the file. Raises SettingsError, PolicyError, ValueError,
    ClusterError or OSError before anything is written, RunError where something did not finish.
    """
    source = files.expanded(source)
    if source.is_dir() and out is not None:
        raise ValueError(f"--out must come with a study's file, {source} is a folder of one: got {out}")
    file = source / FILE if source.is_dir() else source
    folder = source if source.is_dir() else files.expanded(out or Path("runs") / source.stem)
    plan = plan_of(file, figures)
    for point in plan.points:
        check_machine(point.settings)
    if not (folder / FILE).is_file():
        files.check_new_folder(folder)
    with launched(*where):  # a cluster that begins here stays until all is done
        folder.mkdir(parents=True, exist_ok=True)
        with files.owned(folder):
            files.write_text(folder / FILE, plan.text)
            runs = _trained(folder, plan, where)
            return _written(folder, plan, _tested(folder, plan, runs, where))


def draw(folder: Path, wanted: Sequence[str]) -> list[Path]:
    """Draw figures of a study that is done into its folder; raises RunError where it is not, ValueError for a
    figure that cannot be.
    """
    folder = files.expanded(folder)
    if not (folder / DATASET).is_file():
        raise RunError(f"{folder} must hold {DATASET}, as swarm study {shlex.quote(str(folder))} writes it")
    with xr.open_dataset(folder / DATASET, engine="h5netcdf") as stored:
        results = stored.load()
    requests = [request_of(each, axes_of(results)) for each in wanted]
    return [_draw(folder, results, request) for request in requests]


def _draw(folder: Path, results: xr.Dataset, request: Request) -> Path:
    from swarm.figures import save, sweeps

    path = folder / FIGURES / f"{request.name}.png"
    path.parent.mkdir(exist_ok=True)
    save(sweeps(panels(results, request)), path)
    return path


# --- training -----------------------------------------------------------------------------------------------

Runs = dict[tuple[str, int], tuple[Path, Settings]]  # by what is learnt and the seed


def _trained(folder: Path, plan: Plan, where: Where) -> Runs:
    """The run of every place and seed, trained."""
    there = known_runs(folder / RUNS)
    new = _new_runs(folder / RUNS, plan, there)
    runs = _by_seed(new) | there
    runs = {(point.learnt, seed): runs[point.learnt, seed] for point in plan.points for seed in plan.seeds}
    wanted = dict(runs.values())
    left = {path: settings for path, settings in wanted.items() if not RunFolder(path).finished}
    done, begun = len(wanted) - len(left), len(left) - len(new)
    print(f"{len(wanted)} runs in {folder}: {done} are trained, {begun} begun, {len(new)} new")
    if left:
        (folder / RUNS).mkdir(exist_ok=True)
        tasks, executor = trainings(left, launched(*where))
        _done(folder, run_tasks(tasks, executor, title="trainings"), "runs")
    return runs


def known_runs(folder: Path) -> Runs:
    """The run that trains a seed, by what is learnt and the seed, of those in a folder."""
    found: dict[Path, Settings] = {}
    for path in sorted(folder.iterdir(), reverse=True) if folder.is_dir() else ():
        if is_run_folder(path):
            with suppress(RunError, SettingsError):  # of another version, or a stranger
                found[path] = settings_from_stored(RunFolder.open(path)[1], path)
    return _by_seed(found)


def _by_seed(runs: Mapping[Path, Settings]) -> Runs:
    return {
        (learnt(settings), seed): (path, settings)
        for path, settings in runs.items()
        for seed in settings.seeds
    }


def _new_runs(folder: Path, plan: Plan, there: Runs) -> dict[Path, Settings]:
    """Runs that are to be begun, by their folders."""
    found: dict[Path, Settings] = {}
    planned = set(there)
    for point in plan.points:
        missing = [seed for seed in plan.seeds if (point.learnt, seed) not in planned]
        planned |= {(point.learnt, seed) for seed in missing}
        for first, count in stacks(missing, plan.stack):
            settings = dataclasses.replace(point.settings, seed=first, n_seeds=count)
            check_machine(settings)
            name = name_of(plan.axes, point, first, count)
            if len(os.fsencode(name)) > MAX_NAME:
                name = hashlib.sha256(name.encode()).hexdigest()[:16]
            path, again = folder / name, 1
            while path.exists() or path in found:
                again += 1
                path = folder / f"{name}-{again}"
            found[path] = settings
    return found


def _done(folder: Path, outcomes: Sequence[Any], what: str) -> None:
    failed = [each for each in outcomes if isinstance(each, BaseException)]
    if failed:
        again = f"swarm study {shlex.quote(str(folder))} goes on with them"
        raise RunError(f"{len(failed)} of {len(outcomes)} {what} did not finish ({failed[0]}); {again}")


# --- tests --------------------------------------------------------------------------------------------------


def _tested(folder: Path, plan: Plan, runs: Runs, where: Where) -> Tests:
    """The file of every test, which is there."""
    found: Tests = {}
    tasks: dict[Path, Task] = {}
    for place, point in enumerate(plan.points):
        for path, settings in dict(runs[point.learnt, seed] for seed in plan.seeds).items():
            own = {f"seed {seed}": load_policy(each) for seed, each in RunFolder(path).policies(settings)}
            for test, (world, sizes) in point.tests.items():
                policies = own | point.references[test]
                file = folder / TESTS / f"{test}-{_digest(world, policies, sizes)}.nc"
                for seed in plan.seeds:
                    if runs[point.learnt, seed][0] == path:
                        found[place, seed, test] = Tested(file, f"seed {seed}", path.name)
                if not file.exists():
                    how: dict[str, Any] = {**sizes, "life": world.life, "record": False}
                    lived, keep = partial(population_test, **how), partial(save_population, path=file)
                    seconds = float(world.max_decisions * sizes["cells"] * sizes["worlds"] * len(policies))
                    tasks[file] = Task(f"{path.name} {test}", lived, (world, policies), seconds, keep=keep)
    if tasks:
        (folder / TESTS).mkdir(exist_ok=True)
        _done(folder, run_tasks(list(tasks.values()), launched(*where), title="tests"), "tests")
    return found


def _digest(world: World, policies: Mapping[str, AnyPolicy], sizes: Mapping[str, int]) -> str:
    told = {name: fingerprint(policy) for name, policy in policies.items()}
    plain = json.dumps([world.described(), sizes, told, provenance.versions()], default=str)
    return hashlib.sha256(plain.encode()).hexdigest()[:16]


# --- what is written ----------------------------------------------------------------------------------------


def _written(folder: Path, plan: Plan, tests: Tests) -> Found:
    results = as_dataset(plan, tests)
    with files.replacing(folder / DATASET) as temporary:
        results.to_netcdf(temporary, engine="h5netcdf")
    axes = {name: values for name, values in axes_of(results).items() if name != "seed"}
    places = list(itertools.product(*axes.values()))
    rows = [summary(lives_at(results, dict(zip(axes, each, strict=True)))) for each in places]
    files.write_text(folder / TABLE, beside(list(axes), places, Table.of(rows)).as_csv())
    for request in plan.figures:
        with dispensable(f"{request.name}.png"):
            _draw(folder, results, request)
    return Found(folder, results, beside(list(axes), places, readable(rows)))
