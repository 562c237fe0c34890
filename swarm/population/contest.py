"""Population tests: the same starts for every policy, and the lives that follow."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any, get_args

from swarm._support import streams
from swarm._support.checks import check_count, check_memory, check_name
from swarm.optimal import physical_limit
from swarm.optimal.problem import Progress
from swarm.physics.world import World
from swarm.policies.policy import AnyPolicy, check_policy, fingerprint
from swarm.policies.strategies import Greedy
from swarm.population.blocks.block import PopulationTest, Record, blocks_of, each_lived, memory_needed
from swarm.population.blocks.storage import Storage, joined
from swarm.population.results import RIVAL, origin
from swarm.population.statistics import Tally, tally

if TYPE_CHECKING:
    import xarray as xr


def population_test(
    world: World,
    policies: Mapping[str, AnyPolicy],
    *,
    cells: int = 40,
    worlds: int = 1,
    life: float = 200.0,
    seed: int = 0,
    record: Record | bool = "all",
    limit: bool = True,
    population: streams.Population = "test",
    episode: int = 0,
    out: str | os.PathLike | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Lives of `cells` cells in each of `worlds` worlds under each policy, all from the same starts and with
    the same random numbers.

    Per (policy, cell): gain, maximal_gain, arrived, lifetime, decisions: the "ends"; recording "all" (True)
    adds per decision, from the start (0) on and NaN after the end: time, position, heading, curvature, centre
    (of curvature), concentration; "thinned" those of at most 48 decisions. In a race arrival_time and won are
    added, in a medium eaten (per decision), and `medium` at up to 48 times. With several worlds, those of one
    episode after the other, they are per (policy, world, cell). "statistics" keeps no cell, but what
    [`statistics`][swarm.population.statistics.statistics] finds of all.

    Large populations live block by block, in the processes of an `executor` where one is given, see the
    [module][swarm.population.blocks.block]. `out` is a NetCDF file to write them to, with which a call that
    was killed goes on; it is then opened, and numbers are read when they are asked for. `progress` is called
    with the part of all decisions that is over.

    Attributes: seed, life, settings of the world (JSON), versions, commit, `coupled` (1) where what one cell
    does can matter to another, the limit where there is one and `limit` is asked for, and of several blocks
    their size and `statistics` (JSON). "greedy" is added where it is missing. Raises ValueError for a field
    or flow that returns NaN, and FileExistsError where `out` holds something else.
    """
    policies = _with_rival(policies)
    check_count("cells", cells)
    check_count("worlds", worlds)
    seed = streams.check_seed(seed)
    if isinstance(record, bool):
        record = "all" if record else "ends"
    check_name("record", record, get_args(Record))
    world = world.replace(life=life)
    test = PopulationTest(world, policies, cells, worlds, seed, population, episode, record)
    blocks = blocks_of(test)
    kept = blocks[:1] if out is not None or record == "statistics" else blocks
    held = sum(block.cells * block.worlds for block in kept)
    needed = memory_needed(world, held, len(policies) if test.has_series else 0, every=test.every)
    check_memory(needed, f"cells must be fewer, or life shorter, got {cells * worlds} and {life:g}")
    test = test._replace(bounds=physical_limit.bounds_of(world) if limit else None)
    return _in_memory(test, executor, progress) if out is None else _in_file(test, out, executor, progress)


def _in_memory(test: PopulationTest, executor: Executor | None, progress: Progress | None) -> xr.Dataset:
    import xarray as xr

    blocks, tallies, parts = blocks_of(test), dict[int, Tally](), dict[int, xr.Dataset]()
    for block, found, part in each_lived(test, blocks, executor, progress):
        tallies[block.number] = found
        if part is not None:
            parts[block.number] = part
    about = _attributes(test, [tallies[block.number] for block in blocks])
    if test.record == "statistics":
        return xr.Dataset(coords={"policy": list(test.policies)}, attrs=about)
    if len(parts) == 1:
        return parts[0].drop_attrs(deep=False).assign_attrs(about)
    return joined((parts.pop(block.number) for block in blocks), test.sizes, about)


def _in_file(
    test: PopulationTest, out: str | os.PathLike, executor: Executor | None, progress: Progress | None
) -> xr.Dataset:
    """Writes every block as it is done, those that are there being left alone, then puts them together."""
    blocks, storage = blocks_of(test), Storage(out, _identity(test))
    if storage.is_whole:
        return storage.opened()
    with storage.owned():
        left = [block for block in blocks if not storage.has(block.number)]
        tallies: dict[int, Tally] = {}
        for block, found, part in each_lived(test, left, executor, progress):
            assert part is not None
            storage.write(block.number, part)
            tallies[block.number] = found

        def parts() -> Iterator[xr.Dataset]:
            for block in blocks:
                part = storage.part(block.number)
                if block.number not in tallies:
                    tallies[block.number] = tally(part, test.bounds, coupled=test.world.is_shared)
                yield part

        storage.join(
            parts(), test.sizes, lambda: _attributes(test, [tallies[each.number] for each in blocks])
        )
    return storage.opened()


def _attributes(test: PopulationTest, tallies: Sequence[Tally]) -> dict[str, Any]:
    whole = functools.reduce(Tally.merged, tallies)
    limit = whole.limit
    about: dict[str, Any] = {
        "title": "Population test: the same starts for every policy",
        "population": test.population,
        **origin(test.world, test.seed),
        **({"coupled": 1} if test.world.is_shared else {}),
        **({} if limit is None else {"limit": limit}),
    }
    if len(tallies) > 1 or test.record == "statistics":
        found = {"cells": whole.cells.number, "policies": whole.statistics(list(test.policies), limit)}
        about |= {"block": streams.BLOCK, "blocks": len(tallies), "statistics": json.dumps(found)}
    return about


def _identity(test: PopulationTest) -> dict[str, Any]:
    """What must be the same for blocks to belong together."""
    policies = {name: fingerprint(policy) for name, policy in test.policies.items()}
    return {
        "cells": test.cells,
        "worlds": test.worlds,
        "population": test.population,
        "episode": test.episode,
        "record": test.record,
        "limit": test.bounds is not None,
        "block": streams.BLOCK,
        "policies": policies,
        **{key: value for key, value in origin(test.world, test.seed).items() if key != "commit"},
    }


def _with_rival(policies: Mapping[str, AnyPolicy]) -> dict[str, AnyPolicy]:
    for name, policy in policies.items():
        if not isinstance(name, str) or not name:
            raise TypeError(f"policies must be named by text, got {name!r}")
        check_policy(name, policy)
    if not isinstance(policies.get(RIVAL, Greedy()), Greedy):
        raise ValueError(f"policy {RIVAL!r} must be the greedy strategy, got {policies[RIVAL]!r}")
    return dict(policies) if RIVAL in policies else {**policies, RIVAL: Greedy()}
