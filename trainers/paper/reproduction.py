"""Reproducing the paper: what is trained and tested, and in which order.

Training runs are ordinary run folders in OUT/runs/RECIPE/EXPERIMENT; a reproduction that was stopped goes on
with them. Every other file of OUT is written again at the end, the report last.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swarm.optimal import physical_limit as optimal
from swarm.physics.starts import draw_starts
from swarm.policies import network
from swarm.policies.network import Network, load_policy
from swarm.policies.policy_file import PolicyError
from trainers.jobs.executors import Task, executor_for, run_tasks
from trainers.paper.claims import Claim
from trainers.paper.curves import Curves, metrics, shipped_curves, trained_curves
from trainers.paper.measurements import Case, Circle, Measured, Stack, measure, swinging_circle
from trainers.paper.plan import TESTS, Plan, Training, expected_seconds, learnt, trainings
from trainers.paper.statements import EGG, RECORDS, VORTICES, Evidence, TrainingGains
from trainers.settings.composition import SettingsError, settings_from_stored
from trainers.settings.schema import Settings
from trainers.training import run_folder as runs
from trainers.training.run_folder import RunError, RunFolder

if TYPE_CHECKING:
    from trainers.paper.illustrations import Drawing


class ReproductionError(RunError):
    """A reproduction that cannot go on as asked; the message says why and what can be done."""


def find_limits(plan: Plan, planned: Iterable[Training]) -> None:
    """Have the limits in flows at hand, which take a while, before several processes ask for them at once."""
    wanted = [plan.test_world(VORTICES)]
    for each in planned:
        wanted.append(each.settings.training_world().replace(life=each.settings.validation.life))
    for world in wanted:
        if world.in_flow:
            optimal.limit(world, draw_starts(world, 1, plan.seed))


# --- training -----------------------------------------------------------------------------------------------


def train_all(plan: Plan, planned: Iterable[Training]) -> None:
    """Train whatever is not there; raises ReproductionError where a training fails."""
    folders: dict[Path, Training] = {}
    for each in planned:
        folders.setdefault(each.folder, each)
    wanted = [each for each in folders.values() if not _is_done(each)]
    if len(wanted) < len(folders):
        print(f"{len(folders) - len(wanted)} of {len(folders)} trainings are finished", flush=True)
    tasks = [
        Task(
            f"{each.recipe}/{each.experiment}",
            train_one,
            (each.settings, each.folder),
            expected_seconds(each.settings),
            part_done=_PartDone(each.folder, each.settings.learning.epochs),
        )
        for each in wanted
    ]
    results = run_tasks(tasks, executor_for(plan.workers), title="training")
    failed = [
        f"{task.label}: {result}"
        for task, result in zip(tasks, results, strict=True)
        if isinstance(result, Exception)
    ]
    if failed:
        raise ReproductionError(
            f"{len(failed)} of {len(tasks)} trainings failed: {'; '.join(failed)}; "
            "the same command goes on with them"
        )


def train_one(settings: Settings, folder: Path) -> None:
    """One run, from its newest checkpoint if it was begun; then its checkpoints are no longer needed."""
    from trainers.training import run as running

    running.train_in(folder, settings)
    shutil.rmtree(folder / runs.CHECKPOINTS, ignore_errors=True)


def _is_done(training: Training) -> bool:
    """Whether the run is finished and valid; one with other settings or damaged files is set aside."""
    folder = training.folder
    if not runs.is_run_folder(folder):
        return False
    try:
        run, stored = RunFolder.open(folder)
        if learnt(settings_from_stored(stored)) == learnt(training.settings):
            if run.finished:
                policies_of(run, training.settings)
                metrics(run, training.settings)
            return run.finished
        reason = "has other settings"
    except (RunError, SettingsError, PolicyError) as error:
        reason = str(error)
    count = 1
    while (aside := folder.with_name(f"{folder.name}-set-aside-{count}")).exists():
        count += 1
    folder.rename(aside)
    print(f"{folder} is trained again: what was there ({reason}) is now {aside}", flush=True)
    return False


class _PartDone:
    """The part of a run's epochs that are over, read off its metrics."""

    def __init__(self, folder: Path, epochs: int) -> None:
        self.folder, self.epochs = folder, epochs

    def __call__(self) -> float:
        try:
            with (self.folder / runs.TIMINGS).open("rb") as file:
                return max(0, sum(1 for _ in file) - 1) / self.epochs
        except OSError:
            return 0.0


# --- what was trained ---------------------------------------------------------------------------------------


def policies_of(run: RunFolder, settings: Settings) -> list[Network]:
    """The kept policy of every seed."""
    if settings.n_seeds == 1:
        return [load_policy(run.policy)]
    return [load_policy(run.seed_folder(seed) / runs.POLICY) for seed in settings.seeds]


def trained_stacks(planned: Iterable[Training]) -> dict[tuple[str, str], Stack]:
    """Policies of every training by recipe and experiment; the kind is to be named."""
    stacks = {}
    for each in planned:
        policies = policies_of(RunFolder(each.folder), each.settings)
        gains = [policy.card["validation"]["gain"] for policy in policies]
        chosen, seeds = int(np.argmax(gains)), tuple(each.settings.seeds)
        stack = Stack(each.recipe, "", each.experiment, seeds, tuple(policies), chosen)
        stacks[each.recipe, each.experiment] = stack
    return stacks


def shipped_stacks(plan: Plan) -> dict[tuple[str, str], Stack]:
    """The shipped policies, as stacks of one seed; raises ReproductionError where there are none."""
    stacks = {}
    for name in network.zoo_names():
        if name in plan.experiments:
            policy = load_policy(network.ZOO + name)
            recipe, seed = str(policy.card["recipe"]), int(policy.card["seed"])
            stacks[recipe, name] = Stack(recipe, "", name, (seed,), (policy,), 0)
    if not stacks:
        raise ReproductionError("no policies are shipped with this copy: leave out --quick to train them")
    return stacks


def training_gains(planned: Iterable[Training]) -> dict[tuple[str, str], TrainingGains]:
    """Gains of the training cells in every epoch."""
    found = {}
    for each in planned:
        gain = metrics(RunFolder(each.folder), each.settings)["training_gain"]
        found[each.recipe, each.experiment] = TrainingGains(tuple(each.settings.seeds), gain)
    return found


# --- tests --------------------------------------------------------------------------------------------------


def cases(plan: Plan, stacks: dict[tuple[str, str], Stack]) -> list[Case]:
    """Every test for which there are policies."""
    found = []
    for name, kinds in TESTS.items():
        tested = tuple(
            stack._replace(kind=kind)
            for (_, experiment), stack in sorted(stacks.items(), key=lambda item: item[0][0] != "swarm")
            for kind, wanted in kinds.items()
            if experiment == wanted
        )
        if tested and next(iter(kinds.values())) in plan.experiments:
            cells = plan.radial_cells if name == EGG else plan.cells
            found.append(Case(name, plan.test_world(name), tested, cells, plan.seed))
    return found


def test_all(plan: Plan, tests: list[Case]) -> dict[str, Measured]:
    """Outcome of every test; raises ReproductionError where one fails."""
    tasks = [Task(case.name, measure, (case,), _test_seconds(case)) for case in tests]
    outcomes = run_tasks(tasks, executor_for(plan.workers), title="test")
    for case, outcome in zip(tests, outcomes, strict=True):
        if isinstance(outcome, Exception):
            raise ReproductionError(f"the test {case.name} failed: {outcome}")
    return {case.name: outcome for case, outcome in zip(tests, outcomes, strict=True)}


def _test_seconds(case: Case) -> float:
    policies = 2 + sum(len(stack.policies) + 1 for stack in case.stacks)
    return policies * case.world.max_decisions * (5e-3 if case.world.in_flow else 1e-3)


def circles(plan: Plan, tests: list[Case]) -> dict[str, Circle]:
    """What swinging does for each N_T."""
    return {
        case.name: swinging_circle(case.world, cells=plan.swinging_cells, seed=plan.seed)
        for case in tests
        if case.name in RECORDS
    }


# --- all of it ----------------------------------------------------------------------------------------------


def reproduce(plan: Plan, out: Path, publish: Path | None = None) -> list[Claim]:
    """Train, test, judge, draw and report into `out`, with a copy of all but the runs in `publish`.

    Raises ReproductionError, SettingsError, KeyboardInterrupt or OSError.
    """
    from trainers.paper import outputs as reporting

    folders = [out] if publish is None else [out, publish]
    for folder in folders:
        check_folder(folder)
    planned = [] if plan.quick else trainings(plan, out)
    find_limits(plan, planned)
    if planned:
        train_all(plan, planned)
    stacks = shipped_stacks(plan) if plan.quick else trained_stacks(planned)
    tests = cases(plan, stacks)
    evidence = Evidence(test_all(plan, tests), circles(plan, tests), training_gains(planned), plan.seed)
    curves = shipped_curves(stacks) if plan.quick else trained_curves(planned)
    with reporting.staging(out) as staged:
        drawn = draw_all(plan, tests, curves, staged)
        found = reporting.write(staged, plan, tests, evidence, planned, drawn)
        for folder in reversed(folders):
            reporting.put_in_place(staged, folder)
    return found


def check_folder(folder: Path) -> None:
    """Raises ReproductionError where `folder` cannot be written to, or holds files that this would overwrite
    and did not write.
    """
    from trainers.paper.outputs import FILES, RECORD

    there = next(path for path in (folder, *folder.parents) if path.exists() or path.is_symlink())
    if not there.is_dir():
        raise ReproductionError(f"{folder} must be a folder, but {there} is a file")
    if not os.access(there, os.W_OK):
        raise ReproductionError(f"{folder} must be a folder to write to, but {there} is read-only")
    mine = [name for name in FILES if (folder / name).exists()]
    if mine and RECORD not in mine:
        raise ReproductionError(
            f"{folder} must be a new folder or that of an earlier reproduction: {folder / mine[0]} is "
            f"there, but no {RECORD}"
        )


def draw_all(plan: Plan, tests: Sequence[Case], curves: Curves, folder: Path) -> list[Drawing]:
    """Every figure of the paper under every recipe; raises ReproductionError where one cannot be drawn."""
    from trainers.paper.illustrations import draw_tests, draw_training

    recipes = list(dict.fromkeys(stack.recipe for case in tests for stack in case.stacks))
    drawn = [each for recipe in recipes for each in draw_training(recipe, curves, folder)]
    tasks = []
    for recipe in recipes:
        mine = [
            (case, plan.radial_figure_cells if case.name == EGG else plan.figure_cells)
            for case in tests
            if any(stack.recipe == recipe for stack in case.stacks)
        ]
        tasks.append(Task(recipe, draw_tests, (mine, recipe, folder), 1.0))
    results = run_tasks(tasks, executor_for(plan.workers), title="figures")
    for task, result in zip(tasks, results, strict=True):
        if isinstance(result, Exception):
            raise ReproductionError(f"the figures of {task.label} could not be drawn: {result}")
        drawn += result
    return sorted(drawn, key=lambda each: (recipes.index(each.recipe), each.number))
