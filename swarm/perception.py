"""Perception: the memory of records, its normalisation, and the reward that is computed from it.

A record holds what a cell knows of one moment, already in the paper's dimensionless units but for the mean of the
concentrations, which changes with every decision: c κ̄/c_k, κ* and, where the flow is sensed, u_x*, u_y*, ω₀*.
Memory is (..., cells, N_T, features), newest record first.
"""

from __future__ import annotations

from typing import Any

from array_api_compat import array_namespace

Array = Any


def record(concentration: Array, curvature: Array, flow: Array | None, scale: float) -> Array:
    """One record (..., features) from c (...) and the normalised κ* (...); `flow` (..., 3) is normalised too.

    `scale` is κ̄/c_k.
    """
    xp = array_namespace(concentration)
    parts = xp.stack([concentration * scale, curvature], axis=-1)
    return parts if flow is None else xp.concat([parts, flow], axis=-1)


def remember(memory: Array, newest: Array) -> Array:
    """Memory shifted by one record: `newest` (..., features) first, the oldest dropped."""
    xp = array_namespace(memory)
    return xp.concat([newest[..., None, :], memory[..., :-1, :]], axis=-2)


def observe(memory: Array) -> Array:
    """Observation (..., N_T · features) in float32: the memory with concentrations measured from their mean.

    c*, κ* (u_x*, u_y*, ω₀*) of the newest record, then of the next older, … (paper: normalisation of the input vector).
    """
    xp = array_namespace(memory)
    concentrations = memory[..., 0]
    mean = xp.sum(concentrations, axis=-1, keepdims=True) / memory.shape[-2]
    centred = (concentrations - mean)[..., None]
    seen = xp.concat([centred, memory[..., 1:]], axis=-1)
    return xp.astype(xp.reshape(seen, (*memory.shape[:-2], memory.shape[-2] * memory.shape[-1])), xp.float32, copy=False)
