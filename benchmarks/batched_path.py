"""Stepping many worlds at once in torch, against what the arithmetic and the memory cost by themselves.

References, in the same rounds: one sine and one cosine of as many float32 numbers as there are cells, as
torch does it (`torch.sin`, `torch.cos`) and as torch's compiler does it; and copying as many bytes as a
decision writes. Where Intel's library serves torch, how long a sine takes depends on the processor it finds:
for the targets the pass is timed in its portable code, too, in a process of its own (`MKL_CBWR=COMPATIBLE`).
"""

from __future__ import annotations

import functools
import gc
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import torch
from tensordict import TensorDict

from benchmarks.timing import best_times, printed_number, resident_bytes
from swarm._support.compiler import compiled
from swarm.envs.torchrl import GROUP, SwarmEnv
from swarm.physics.world import Outcome, State, World

CELLS = 40  # of a world
CASES: dict[str, dict[str, Any]] = {
    "still water": {},
    "Taylor–Green, flow sensed": {"flow": "taylor_green", "sense_flow": True},
}
AT_MOST = {"still water": 5.0, "Taylor–Green, flow sensed": 20.0}  # sine and cosine passes
ENV_AT_MOST = 1.5  # steps of the world
REFERENCES = ("sin+cos µs", "compiled sin+cos µs", "copy µs")
FLAT = 1.5  # cost per cell, from ten thousand cells to a million
LIFE = 1e6  # nobody's ends

Call = Callable[[], object]


@contextmanager
def threads(number: int) -> Iterator[None]:
    """Within, torch works with so many threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def references(cells: int, written: int) -> dict[str, Call]:
    """The passes over `cells` numbers and the copy of `written` bytes."""
    numbers = torch.rand(cells) * 6
    sines, cosines = torch.empty_like(numbers), torch.empty_like(numbers)
    source, target = torch.zeros(written, dtype=torch.uint8), torch.zeros(written, dtype=torch.uint8)

    def plain() -> None:
        torch.sin(numbers, out=sines)
        torch.cos(numbers, out=cosines)

    fast = compiled(_sine_and_cosine)
    return {"pass": plain, "compiled pass": lambda: fast(numbers), "copy": lambda: target.copy_(source)}


PORTABLE = """
import torch
from benchmarks.batched_path import references
from benchmarks.timing import best_times
torch.set_num_threads(1)
call = references({cells}, 1)["pass"]
print(best_times({{"pass": call}}, seconds=1.0, turn=2e-2)["pass"])
"""


def portable_pass(cells: int) -> float:
    """Seconds of the pass as Intel's library computes on any processor, one thread."""
    return printed_number(PORTABLE.format(cells=cells), MKL_CBWR="COMPATIBLE")


def _sine_and_cosine(numbers: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.sin(numbers), torch.cos(numbers)


def _step(world: World, state: State, action: torch.Tensor) -> tuple[State, Outcome]:
    return world.step(state, action)


def bytes_of(*tensors: torch.Tensor) -> int:
    """Memory that tensors take up."""
    return sum(tensor.untyped_storage().nbytes() for tensor in tensors)


def ways(world: World, worlds: int, fast: bool) -> tuple[dict[str, Call], State, int]:
    """Calls that make one decision of every cell, the state, and the bytes that a decision writes."""
    env = SwarmEnv(worlds, n_swimmers=CELLS, seed=0, world=world, compile_step=fast)
    env.restart()
    step = functools.partial(World.step, world)
    if fast:
        step = compiled(_step, world)
    state = env.state
    assert state is not None
    generator = torch.Generator().manual_seed(0)
    draws = [torch.randint(world.n_actions, (worlds, CELLS), generator=generator) for _ in range(8)]
    after, outcome = step(state, draws[0])
    written = bytes_of(*after, outcome.observation, outcome.reward, outcome.gain)
    bare, advance = itertools.cycle(draws), itertools.cycle(draws)
    packed = itertools.cycle(
        [TensorDict({GROUP: TensorDict({"action": draw}, (worlds, CELLS))}, (worlds,)) for draw in draws]
    )

    def env_step() -> None:
        data = env.step(next(packed))
        del data["next"]  # as in a rollout: TorchRL would merge what is there already

    calls = {
        "world.step": lambda: step(state, next(bare)),
        "SwarmEnv.advance": lambda: env.advance(next(advance)),
        "SwarmEnv.step": env_step,
    }
    return calls, state, written


def measure(case: str, worlds: int, number: int, seconds: float) -> list[dict[str, Any]]:
    """A row for every way to step, plain and compiled."""
    world = World(life=LIFE, **CASES[case])
    cells = worlds * CELLS
    with threads(number), torch.inference_mode():
        calls: dict[str, Call] = {}
        for mode in ("eager", "compiled"):
            made, _, written = ways(world, worlds, mode == "compiled")
            calls |= {f"{mode} {name}": call for name, call in made.items()}
        passes = references(cells, written)
        times = best_times(calls | passes, seconds=seconds, turn=2e-2)
    rows = []
    for name in calls:
        mode, way = name.split(" ", 1)
        rows.append(
            {
                "case": case,
                "worlds": worlds,
                "threads": number,
                "how": mode,
                "call": way,
                "µs": times[name] * 1e6,
                "10⁶ steps/s": cells / times[name] / 1e6,
                "of world.step": times[name] / times[f"{mode} world.step"],
                "of sin+cos": times[name] / times["pass"],
                "of compiled sin+cos": times[name] / times["compiled pass"],
                "of copy": times[name] / times["copy"],
                "sin+cos µs": times["pass"] * 1e6,
                "compiled sin+cos µs": times["compiled pass"] * 1e6,
                "copy µs": times["copy"] * 1e6,
            }
        )
    return rows


def targets(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What was to be reached, at the largest size on one thread, compiled."""
    size = max(row["worlds"] for row in rows)
    chosen = {
        (row["case"], row["call"]): row
        for row in rows
        if (row["worlds"], row["threads"], row["how"]) == (size, 1, "compiled")
    }
    found = []
    portable = portable_pass(size * CELLS) * 1e6
    of_portable = f"of portable sin+cos, {portable:.3g} µs"
    for case, limit in AT_MOST.items():
        step, env = chosen[case, "world.step"], chosen[case, "SwarmEnv.step"]
        step = {**step, of_portable: step["µs"] / portable}
        for measured, reference, at_most in (
            (step, "of sin+cos", limit),
            (step, of_portable, limit),
            (step, "of compiled sin+cos", limit),
            (step, "of copy", None),
            (env, "of world.step", ENV_AT_MOST),
        ):
            found.append(
                {
                    "case": case,
                    "worlds": size,
                    "call": measured["call"],
                    "ratio": reference,
                    "measured": measured[reference],
                    "at most": at_most,
                }
            )
    return found


def growth(sizes: list[int], seconds: float) -> list[dict[str, Any]]:
    """Cost and memory of a cell in populations of different sizes, one thread."""
    rows = []
    for case, fast in itertools.product(CASES, (False, True)):
        world = World(life=LIFE, **CASES[case])
        calls, memory = {}, {}
        with threads(1), torch.inference_mode():
            for cells in sizes:
                made, state, written = ways(world, cells // CELLS, fast)
                calls[cells] = made["world.step"]
                memory[cells] = bytes_of(*state) / cells, written / cells
            times = best_times(
                {str(cells): call for cells, call in calls.items()}, seconds=seconds, turn=2e-2
            )
        for cells in sizes:
            cost = times[str(cells)] / cells
            rows.append(
                {
                    "case": case,
                    "how": "compiled" if fast else "eager",
                    "cells": cells,
                    "ns per cell": cost * 1e9,
                    "of the smallest": cost / (times[str(sizes[0])] / sizes[0]),
                    "at most": FLAT,
                    "bytes of state per cell": memory[cells][0],
                    "bytes written per cell": memory[cells][1],
                }
            )
    return rows


def allocation(steps: int) -> list[dict[str, Any]]:
    """Memory and Python objects after many steps of a small world."""
    rows = []
    for case, settings in CASES.items():
        with threads(1), torch.inference_mode():
            calls, _, _ = ways(World(life=LIFE, **settings), 1, False)
            for name, call in calls.items():
                before = (0, 0)
                for step in range(steps + steps // 10):
                    if step == steps // 10:  # what is allocated once has been
                        gc.collect()
                        before = resident_bytes(), len(gc.get_objects())
                    call()
                gc.collect()
                rows.append(
                    {
                        "case": case,
                        "call": name,
                        "steps": steps,
                        "growth of resident memory, KB": (resident_bytes() - before[0]) / 1024,
                        "new Python objects": len(gc.get_objects()) - before[1],
                    }
                )
    return rows


def run(quick: bool = False) -> dict[str, list[dict[str, Any]]]:
    """All tables by title."""
    seconds = 1.0 if quick else 6.0
    sizes = (1, 32) if quick else (1, 32, 1024)
    rows = [
        row
        for case, worlds, number in itertools.product(CASES, sizes, (1, 2))
        for row in measure(case, worlds, number, seconds)
    ]
    by_size = {(row["case"], row["worlds"], row["threads"]): row for row in rows}
    names = ("case", "worlds", "threads", *REFERENCES)
    return {
        "Targets": targets(rows),
        "All ways to step": [{key: row[key] for key in row if key not in REFERENCES} for row in rows],
        "References": [{name: row[name] for name in names} for row in by_size.values()],
        "Population size": growth([10_000, 100_000] if quick else [10_000, 100_000, 1_000_000], seconds),
        "Allocation": allocation(1000 if quick else 100_000),
    }
