"""Perception: the memory of records, its normalisation, and the reward that is computed from it.

A record holds what a cell knows of one moment, already in the paper's dimensionless units but for the mean of
the concentrations, which changes with every decision: c κ̄/c_k, κ* and, where the flow is sensed, u_x*, u_y*,
ω₀*. Memory is (..., cells, N_T, features), newest record first.
"""

from __future__ import annotations

from typing import Any

from swarm._support.arrays import is_torch, join, namespace

Array = Any


def record(
    concentration: Array, curvature: Array, flow: tuple[Array, ...], scale: float
) -> tuple[Array, ...]:
    """The numbers of a record from c and the normalised κ*, u_x*, u_y*, ω₀*, all (...).

    `flow` may be empty; `scale` is κ̄/c_k.
    """
    return concentration * scale, curvature, *flow


def memory_of(records: list[tuple[Array, ...]]) -> Array:
    """Memory (..., N_T, features) of records, newest first."""
    memory = join(*(number for numbers in records for number in numbers))
    return namespace(memory).reshape(memory, (*memory.shape[:-1], len(records), len(records[0])))


def renew(memory: Array, newest: tuple[Array, ...]) -> tuple[Array, Array]:
    """Memory with a record more and the oldest dropped, and the observation of it."""
    if not is_torch(memory):
        memory = remember(memory, join(*newest))
        return memory, observe(memory)
    numbers = (*newest, *_numbers(memory)[: -len(newest)])
    return namespace(memory).reshape(join(*numbers), memory.shape), _seen(numbers, len(newest))


def remember(memory: Array, newest: Array) -> Array:
    """Memory shifted by one record: `newest` (..., features) first, the oldest dropped."""
    return namespace(memory).concat([newest[..., None, :], memory[..., :-1, :]], axis=-2)


def observe(memory: Array) -> Array:
    """Observation (..., N_T · features) in float32: the memory with concentrations measured from their mean.

    c*, κ* (u_x*, u_y*, ω₀*) of the newest record, then of the next older, … (paper: normalisation of the
    input vector).
    """
    if is_torch(memory):
        return _seen(_numbers(memory), memory.shape[-1])
    xp = namespace(memory)
    concentrations = memory[..., 0]
    n_records, features = memory.shape[-2:]
    total = concentrations[..., 0]
    for i in range(1, n_records):  # much quicker than a sum over a short axis
        total = total + concentrations[..., i]
    centred = concentrations - (total / n_records)[..., None]
    seen = xp.concat([centred[..., None], memory[..., 1:]], axis=-1)
    flat = xp.reshape(seen, (*memory.shape[:-2], n_records * features))
    return xp.astype(flat, xp.float32, copy=False)


# Torch tensors are worked on number by number, see `join`.


def _numbers(memory: Array) -> tuple[Array, ...]:
    """The numbers (...) of all records, newest first."""
    xp = namespace(memory)
    return xp.unstack(xp.reshape(memory, (*memory.shape[:-2], -1)), axis=-1)


def _seen(numbers: tuple[Array, ...], features: int) -> Array:
    concentrations = numbers[::features]
    mean = sum(concentrations[1:], start=concentrations[0]) / len(concentrations)
    seen = [number if i % features else number - mean for i, number in enumerate(numbers)]
    observation = join(*seen)
    xp = namespace(observation)
    return xp.astype(observation, xp.float32, copy=False)
