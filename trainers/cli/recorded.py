"""Recorded populations: tests of any size, block by block, which go on where they were stopped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from swarm._support import files
from swarm._support.checks import check_name
from swarm._support.streams import BLOCK
from swarm._support.terminal import Progress, tell
from swarm.figures.evaluation import POPULATION, SUMMARY, save_summary
from swarm.physics.world import World
from swarm.population.blocks.block import needed
from swarm.population.blocks.storage import parts_of
from swarm.population.evaluation import Evaluation, evaluate
from trainers.jobs.cluster import Needs, Ray, Where, launched


def recorded(
    policy: str, world: World, record: str, out: Path | None, where: Where, **options: Any
) -> Evaluation:
    """Tests a policy as `evaluate` does with these options, computed as `launched(*where)` says, telling
    beforehand what it takes. The lives go to the folder `out`: what is there is gone on with, a population
    that is complete is only read. Raises FileExistsError where something else is there, OSError for a disk
    that has no room.
    """
    check_name("--record", record, ("ends", "thinned", "all"))
    cells, longer = options["cells"] * options["worlds"], world.replace(life=options["life"])
    file = None if out is None else files.expanded(out) / POPULATION
    if file is not None and not (file.exists() or parts_of(file).exists()):
        files.check_new_folder(file.parent)
    complete = file is not None and file.with_name(SUMMARY).exists()
    kept: Any = record if file else "statistics"
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
        found = evaluate(policy, world, **options, **own)
    if complete:
        tell(f"{out} is complete: nothing was computed again")
    elif file is not None:
        save_summary(found, file.parent)
    return found
