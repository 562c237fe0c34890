"""Trials: what `swarm evaluate` does with a policy: a population test, levels of noise, or a contest."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swarm._support import files
from swarm._support.checks import check_name
from swarm._support.streams import BLOCK
from swarm._support.tables import Table
from swarm._support.terminal import Progress, tell
from swarm.figures.evaluation import (
    POPULATION,
    SUMMARY,
    save_contest,
    save_evaluation,
    save_noise_sweep,
    save_summary,
)
from swarm.physics.world import World
from swarm.population import contests, evaluation, noise
from swarm.population.blocks.block import needed
from swarm.population.blocks.storage import parts_of
from trainers.jobs.cluster import HERE, Needs, Ray, Where, launched
from trainers.settings.composition import settings_of


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
    record: str | None = None,
    out: Path | None = None,
    where: Where = HERE,
) -> evaluation.Evaluation | Table:
    """Tests a policy by the options of the command, and writes what it finds to a new folder `out`; None is
    an option that was left out. Returns a population test, or the table of something else.

    Where something is recorded by name, the lives go block by block to `out`, computed as `launched(*where)`
    says, and what is there already is gone on with. Raises ValueError for options that do not go together,
    and as what tests it does.
    """
    if kind is not None and not levels:
        raise ValueError(f"--noise-kind must come with --noise, got {kind!r} alone")
    if share is not None and against is None:
        raise ValueError(f"--share must come with --against, got {share:g} alone")
    strengths = noise.levels_of(levels)
    if len(strengths) > 1 and against is not None:
        raise ValueError(f"--noise must be one level with --against, got {len(strengths)}")
    if record is not None and (against is not None or len(strengths) > 1):
        raise ValueError(f"--record must come without --against and several levels of --noise, got {record}")
    if record is None and where != (None, None, None):
        raise ValueError("--launcher, --jobs and --address must come with --record, got them alone")
    if out is not None and record is None:
        files.check_new_folder(out)
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
        if out is not None:
            save_noise_sweep(swept, out)
        return swept.table
    (world,) = noise.check_levels(strengths, kind, world) if strengths else [world]
    if against is not None:
        options["share"] = 0.5 if share is None else share
        with Progress("contest", 1.0) as bar:
            raced = evaluation.compete(policy, against, world, **options, progress=bar.show)
        if out is not None:
            save_contest(raced, out)
        return contests.table(raced)
    options["experiment"] = settings.experiment
    if record is not None:
        return _recorded(policy, world, record, out, where, options)
    with Progress("population test", 1.0) as bar:
        tested = evaluation.evaluate(policy, world, **options, progress=bar.show)
    if out is not None:
        save_evaluation(tested, out)
    return tested


def _recorded(
    policy: str, world: World, record: str, out: Path | None, where: Where, options: dict[str, Any]
) -> evaluation.Evaluation:
    """Tests a population of any size, telling what it needs before it begins; one that is complete in its
    folder is only read.
    """
    cells = options["cells"] * options["worlds"]
    check_name("--record", record, ("ends", "thinned", "all"))
    file = None if out is None else _place(out)
    complete = file is not None and (file.parent / SUMMARY).exists()
    kept: Any = record if file else "statistics"
    longer = world.replace(life=options["life"])
    with launched(*where) as executor, Progress("cells", cells) as bar:
        memory, disk = needed(longer, kept, cells, workers=getattr(executor, "workers", 1))
        if file and not file.exists():
            files.check_room(file, disk - sum(part.stat().st_size for part in parts_of(file).glob("*")))
        on_disk = f", {disk / 2**20:,.0f} MiB in {out}" if file else "; no cell is kept without --out"
        if not complete:
            bar.say(f"{cells:,} cells, {BLOCK:,} at once: about {memory / 2**20:,.0f} MiB of memory{on_disk}")
        if isinstance(executor, Ray):
            executor = executor.needing(Needs(memory=needed(longer, kept, cells, workers=1)[0]))

        def progress(part: float) -> None:
            bar.show(part * cells, text=f"{part * cells:,.0f}/{cells:,}")

        own = {"record": kept, "out": file, "executor": executor, "progress": progress}
        found = evaluation.evaluate(policy, world, **options, **own)
    if complete:
        tell(f"{out} is complete: nothing was computed again")
    elif file is not None:
        save_summary(found, file.parent)
    return found


def _place(out: Path) -> Path:
    """The file of a population in its folder; raises FileExistsError unless that is new or holds one, whole
    or in parts.
    """
    folder = files.expanded(out)
    file = folder / POPULATION
    if not (file.exists() or parts_of(file).exists()):
        files.check_new_folder(folder)
    return file
