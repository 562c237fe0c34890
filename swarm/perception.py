"""Perception: the memory of records, its normalisation, and the reward that is computed from it.

A record holds what a cell knows of one moment, already in the paper's dimensionless units but for the mean of
the concentrations, which changes with every decision: c κ̄/c_k, κ* and, where the flow is sensed, u_x*, u_y*,
ω₀*. Memory is (..., cells, N_T, features), newest record first.
"""

from __future__ import annotations

from typing import Any

from swarm.arrays import join, namespace

Array = Any


def record(concentration: Array, curvature: Array, flow: tuple[Array, ...], scale: float) -> Array:
    """One record (..., features) from c and the normalised κ*, u_x*, u_y*, ω₀*, all (...); `flow` may be
    empty.

    `scale` is κ̄/c_k.
    """
    return join(concentration * scale, curvature, *flow)


def remember(memory: Array, newest: Array) -> Array:
    """Memory shifted by one record: `newest` (..., features) first, the oldest dropped."""
    return namespace(memory).concat([newest[..., None, :], memory[..., :-1, :]], axis=-2)


def observe(memory: Array) -> Array:
    """Observation (..., N_T · features) in float32: the memory with concentrations measured from their mean.

    c*, κ* (u_x*, u_y*, ω₀*) of the newest record, then of the next older, … (paper: normalisation of the
    input vector).
    """
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
