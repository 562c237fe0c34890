"""Trials: what `swarm evaluate` does with a policy: a population test, levels of noise, or a contest."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from swarm._support.tables import Table
from swarm._support.terminal import Progress
from swarm.figures.evaluation import save_contest, save_evaluation, save_noise_sweep
from swarm.population import contests, evaluation, noise
from trainers.settings.composition import settings_of


class Trial(NamedTuple):
    """What was found."""

    table: Table
    save: Callable[[Path], None]  # into a new folder
    tested: evaluation.Evaluation | None = None  # of a population test


def trial(
    policy: str,
    experiment: str | None,
    *,
    cells: int | None,
    worlds: int | None,
    life: float | None,
    seed: int,
    levels: Sequence[str] = (),
    kind: str | None = None,
    against: str | None = None,
    share: float | None = None,
) -> Trial:
    """Tests a policy by the options of the command; None is an option that was left out.

    Raises ValueError for options that do not go together, and as what tests it does.
    """
    if kind is not None and not levels:
        raise ValueError(f"--noise-kind must come with --noise, got {kind!r} alone")
    if share is not None and against is None:
        raise ValueError(f"--share must come with --against, got {share:g} alone")
    strengths = noise.levels_of(levels)
    if len(strengths) > 1 and against is not None:
        raise ValueError(f"--noise must be one level with --against, got {len(strengths)}")
    settings = settings_of(policy, experiment)
    world, test = settings.test_world(), settings.evaluation
    options: dict[str, Any] = {"life": test.life if life is None else life, "seed": seed}
    usual = (test.cells, test.worlds) if against is None else (40, 40)
    options["cells"] = usual[0] if cells is None else cells
    options["worlds"] = usual[1] if worlds is None else worlds
    kind = kind or "concentration"
    if len(strengths) > 1:
        with Progress("levels of noise", len(strengths)) as bar:
            swept = noise.sweep_noise(policy, world, strengths, kind=kind, progress=bar.show, **options)
        return Trial(swept.table, functools.partial(save_noise_sweep, swept))
    (world,) = noise.check_levels(strengths, kind, world) if strengths else [world]
    if against is not None:
        options["share"] = 0.5 if share is None else share
        with Progress("contest", 1.0) as bar:
            results = evaluation.compete(policy, against, world, **options, progress=bar.show)
        return Trial(contests.table(results), functools.partial(save_contest, results))
    with Progress("population test", 1.0) as bar:
        options["progress"] = bar.show
        tested = evaluation.evaluate(policy, world, experiment=settings.experiment, **options)
    return Trial(tested.table, functools.partial(save_evaluation, tested), tested)
