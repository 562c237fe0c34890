"""What the commands that test and show policies do; bad input ends in one line, not in a traceback."""

from __future__ import annotations

import dataclasses
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from swarm._support import files
from swarm._support.checks import check_count
from swarm._support.tables import Table
from swarm.physics.world import World
from trainers.cli import fail, file_trouble
from trainers.settings.composition import SettingsError, settings_from, settings_from_stored
from trainers.settings.schema import Settings


@contextmanager
def told(*further: type[Exception]) -> Iterator[None]:
    """Within, bad input, `further` errors, and trouble with files or memory end the command in one line."""
    expected: tuple[type[Exception], ...] = (ValueError, TypeError, MemoryError, *further)
    try:
        yield
    except OSError as error:
        fail(file_trouble(error))
    except expected as error:
        fail(error)


def evaluate_from(
    policy: str,
    *,
    experiment: str | None = None,
    cells: int | None = None,
    life: float | None = None,
    seed: int = 0,
    noise: Sequence[str] = (),
    kind: str | None = None,
    out: Path | None = None,
) -> None:
    """`swarm evaluate`; without an experiment, the world of the test is the policy's own.

    One level of noise is a world to test in; several are a sweep.
    """
    with told():
        levels, kind = noise_levels(noise, kind)
        settings = test_settings(policy, experiment)
        test = settings.evaluation
        options: dict[str, Any] = {
            "cells": test.cells if cells is None else cells,
            "life": test.life if life is None else life,
            "seed": seed,
        }
        if out is not None:
            files.check_new_folder(out)
        if len(levels) > 1:
            swept(policy, settings, levels, kind, options, out)
        else:
            evaluated(policy, settings, levels, kind, options, out)
    if out is not None:
        print(f"results and figures are in {out}")


def noise_levels(words: Sequence[str], kind: str | None) -> tuple[list[float], str]:
    """Levels of noise, rising, and their kind, from the words of `--noise`, with or without commas."""
    if kind is not None and not words:
        raise ValueError(f"--noise-kind must come with --noise, got {kind!r} alone")
    parts = [part.strip() for word in words for part in word.split(",")]
    try:
        return sorted(float(part) for part in parts), kind or "concentration"
    except ValueError:
        raise ValueError(f"--noise must be numbers, separated by commas, got {','.join(words)!r}") from None


def evaluated(
    policy: str,
    settings: Settings,
    levels: Sequence[float],
    kind: str,
    options: dict[str, Any],
    out: Path | None,
) -> None:
    """Test in one world, and print the table."""
    from swarm.population.evaluation import evaluate
    from swarm.population.noise import check_levels

    world = settings.test_world()
    if levels:
        (world,) = check_levels(levels, kind, world)
    done = evaluate(policy, world, experiment=settings.experiment, **options)
    if out is not None:
        from swarm.figures.evaluation import save_evaluation

        save_evaluation(done, out)
    show_table(done.table)
    limit = done.summary["limit"]
    print(
        "limit: none is known for this world"
        if limit is None
        else f"limit: {limit:.2f}, which no policy can exceed"
    )


def swept(
    policy: str,
    settings: Settings,
    levels: Sequence[float],
    kind: str,
    options: dict[str, Any],
    out: Path | None,
) -> None:
    """Test at every level of noise, and print the table of all."""
    from rich.progress import Progress

    from swarm.population.noise import sweep_noise

    with Progress(transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("levels of noise", total=len(levels))
        done = sweep_noise(
            policy,
            settings.test_world(),
            levels,
            kind=kind,
            progress=lambda count: bar.update(task, completed=count),
            **options,
        )
    if out is not None:
        from swarm.figures.evaluation import save_noise_sweep

        save_noise_sweep(done, out)
    show_table(done.table)


def watch_from(
    policy: str,
    *,
    experiment: str | None = None,
    cells: int | None = None,
    life: float | None = None,
    seed: int | None = None,
    out: Path | None = None,
    size: int | None = None,
) -> None:
    """`swarm watch`, of a policy or of a stored population."""
    from swarm.figures import watch as watching

    try:
        with told():
            if Path(policy).suffix.lower() == watching.POPULATION:
                given = {"--experiment": experiment, "--life": life, "--seed": seed, "--size": size}
                stored_lives(policy, out, cells, given)
            else:
                watching.check_target(out, size)
                world = test_settings(policy, experiment).test_world()
                world = world.replace(life=80.0 if life is None else life)
                fresh_lives(policy, world, out, 40 if cells is None else cells, seed or 0, size)
    except ImportError as error:
        fail(f"this needs a further package: {error}")
    if out is not None:
        print(f"written to {out}")


def stored_lives(population: str, out: Path | None, cells: int | None, given: dict[str, Any]) -> None:
    """A page of a stored population; raises ValueError for options that are `given` and choose lives."""
    from swarm.figures import watch as watching

    for option, value in given.items():
        if value is not None:
            raise ValueError(f"{option} must be left out, {population} holds lives as they were: got {value}")
    chosen = None if cells is None else check_count("cells", cells)
    watching.save_page_of(Path(population), out, cells=chosen)


def fresh_lives(policy: str, world: World, out: Path | None, cells: int, seed: int, size: int | None) -> None:
    """A window, a film or a page of lives that are lived for it."""
    from rich.progress import Progress

    from swarm.figures import watch as watching

    with Progress(transient=True, disable=out is None or not sys.stderr.isatty()) as bar:
        task = bar.add_task("drawing", total=None)
        watching.watch(
            policy,
            world,
            cells=cells,
            seed=seed,
            out=out,
            size=size,
            progress=lambda done, most: bar.update(task, completed=done, total=most),
        )


def compare_from(folders: Sequence[Path], cells: int, seed: int, out: Path | None) -> None:
    """`swarm compare`."""
    from trainers.jobs import comparison as comparing
    from trainers.training import run_folder as runs

    with told(runs.RunError):
        groups = comparing.compare(folders, cells=cells, seed=seed, out=out)
    headings, *rows = comparing.table(groups)
    show_table(Table(headings, rows))
    if out is not None:
        print(f"table and figure are in {out}")


def reproduce_from(out: Path, quick: bool, seeds: int, jobs: int | None, publish: Path | None) -> None:
    """`swarm reproduce`."""
    try:
        from trainers.jobs.pool import Stopped
        from trainers.paper import reproduction as reproducing
        from trainers.paper.plan import Plan
    except ImportError as error:
        fail(f"this needs the extra packages of chemoswarm[train]: {error}")
    try:
        plan = Plan(quick=quick, n_seeds=check_count("--seeds", seeds))
        if jobs is not None:
            plan = dataclasses.replace(plan, workers=check_count("--jobs", jobs))
        claims = reproducing.reproduce(plan, out, publish)
    except (reproducing.ReproductionError, SettingsError, Stopped, ValueError) as error:
        fail(error)
    except OSError as error:
        fail(file_trouble(error))
    verdicts = Counter(claim.verdict for claim in claims)
    print(f"{len(claims)} claims: " + ", ".join(f"{count} {name}" for name, count in verdicts.most_common()))
    print(f"the report is {out / 'report.md'}")


def check_from() -> None:
    """`swarm check`; ends with exit code 1 where a check fails."""
    from swarm.envs.conformance import run_checks

    checks = run_checks()
    rows = [
        [each.name, {True: "passed", False: "FAILED", None: "skipped"}[each.passed], each.detail]
        for each in checks
    ]
    show_table(Table(["check", "result", "detail"], rows))
    if any(each.passed is False for each in checks):
        raise SystemExit(1)


def test_settings(policy: str, experiment: str | None) -> Settings:
    """Settings of an experiment, or those a trained policy's card tells of, else of linear_n4."""
    from swarm.policies.network import ZOO, load_policy
    from swarm.population.evaluation import STRATEGIES, named_policy

    if experiment is not None:
        return settings_from([f"experiment={experiment}"])
    if policy in STRATEGIES:
        return settings_from([])
    if not policy.startswith(ZOO) and not Path(policy).exists():
        named_policy(policy, World())  # raises, and suggests what may be meant
    card = load_policy(policy).card
    known = card.get("settings")
    known = known if isinstance(known, dict) else {}
    stored = {name: known[name] for name in ("world", "evaluation") if name in known}
    return settings_from_stored({"experiment": str(card.get("experiment", "own")), **stored})


def show_table(table: Table) -> None:
    """Print rows under their headings."""
    from rich.console import Console
    from rich.table import Table as Printed

    printed = Printed(box=None, pad_edge=False)
    for index, heading in enumerate(table.headings):
        printed.add_column(heading, justify="right" if index else "left", no_wrap=True)
    for row in table.texts:
        printed.add_row(*row)
    console = Console()
    Console(width=max(console.width, 100)).print(printed)
