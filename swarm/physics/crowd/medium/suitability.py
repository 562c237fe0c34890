"""Whether a medium suits a world: fine enough, stable, and where its cells are."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from swarm._support.checks import check_memory
from swarm.physics.crowd.medium.mesh import Box
from swarm.physics.crowd.medium.transport import ADVECTION_LIMIT
from swarm.physics.fields import Field
from swarm.physics.flows import Flow, StillWater
from swarm.physics.motion.clock import frozen

Medium = Any  # a `swarm.Medium`

EDGE = 1e-6  # of the highest concentration: more at the edges is not nothing
COARSE = 0.1  # of the concentration's change over a mesh: more lost between nodes makes gradients wrong
MOST_SUBSTEPS = 1000


def substeps(medium: Medium, flow: Flow, speed: float, interval: float) -> int:
    """Substeps of a decision: a cell of `speed` passes at most one mesh in each, and advection is stable.

    The medium's own number where it has one. Raises ValueError where that makes advection unstable, or where
    more than a thousand were needed.
    """
    fastest = _fastest_wave(medium, flow) * interval
    if medium.substeps is not None:
        if medium.substeps > MOST_SUBSTEPS:
            raise ValueError(f"medium.substeps must be at most {MOST_SUBSTEPS}, got {medium.substeps}")
        if fastest > ADVECTION_LIMIT * medium.substeps:
            needed = math.ceil(fastest / ADVECTION_LIMIT)
            rule = (
                f"substeps must be at least {needed} in this flow for decisions of {interval:g} to be stable"
            )
            raise ValueError(f"medium.{rule}, got {medium.substeps}")
        return int(medium.substeps)
    meshes = speed * interval / min(medium.mesh.spacing)
    count = max(1, math.ceil(meshes - 1e-9), math.ceil(fastest / ADVECTION_LIMIT - 1e-9))
    if count > MOST_SUBSTEPS:
        rule = f"shape must be so coarse that {MOST_SUBSTEPS} substeps of a decision are enough"
        raise ValueError(f"medium.{rule}, got {medium.shape}, for which it takes {count}")
    return count


def _fastest_wave(medium: Medium, flow: Flow) -> float:
    """Bound of |k u| for the shortest waves of what is carried [1 / time]."""
    if not medium.carried or isinstance(flow, StillWater):
        return 0.0
    shortest = math.pi / np.asarray(medium.mesh.spacing)
    bound = getattr(flow, "max_speed", None)
    if bound is not None:
        return float(bound * np.hypot(*shortest))
    velocity = frozen(flow, 0.0).velocity(medium.mesh.places(medium.mesh.corner(np.zeros(2))))
    return float((np.abs(velocity) @ shortest).max())


def check(
    medium: Medium,
    field: Field,
    flow: Flow,
    *,
    start_box: Box,
    interval: float,
    speed: float,
    curvature: float,
) -> None:
    """Raises ValueError where the medium does not suit a world, in one line that names what, rule and value.

    `interval`, `speed` and `curvature` are the longest, highest and tightest of the world's cells. Warns
    where what is carried meets itself at the edges.
    """
    rows, columns = medium.shape  # a matrix spreads along each axis, with waves and slopes
    needed = 8.0 * (8 * rows * columns + 5 * (rows**2 + columns**2))
    check_memory(needed, f"medium.shape must be of nodes that fit into memory, got {medium.shape}")
    substeps(medium, flow, speed, interval)
    _check_box(medium, start_box)
    widest = max(medium.mesh.spacing)
    if widest > 1 / curvature:
        rule = f"shape must put nodes at most {1 / curvature:g} apart, the radius of the tightest circle"
        raise ValueError(f"medium.{rule}, got {medium.shape}, which are {widest:g} apart")
    field = frozen(field, 0.0)
    origin = medium.mesh.corner(np.zeros(2))
    concentration = np.asarray(field.concentration(medium.mesh.places(origin))).reshape(medium.shape)
    lowest = float(concentration.min())
    if not np.isfinite(concentration).all():
        raise ValueError(f"medium.box must lie where the field is finite, got {medium.box}")
    if medium.uptake > 0 and lowest < 0:
        rule = "medium.uptake must be 0 where the field is negative, because nobody eats less than nothing"
        raise ValueError(f"{rule}, got a concentration of {lowest:g} in the box")
    if medium.carried:
        _check_resolved(medium, field, concentration)
        _check_edges(medium, flow, concentration)


def _check_box(medium: Medium, start_box: Box) -> None:
    if medium.leaving == "follow":
        widths = [high - low for low, high in start_box]
        if any(size < 2 * width for size, width in zip(medium.mesh.size, widths, strict=True)):
            rule = f"box must be at least twice as wide as the start box {start_box}, whose mean it follows"
            raise ValueError(f"medium.{rule}, got {medium.box}")
    elif any(
        start[0] < low or start[1] > high for start, (low, high) in zip(start_box, medium.box, strict=True)
    ):
        raise ValueError(f"medium.box must contain the start box {start_box}, got {medium.box}")


def _check_resolved(medium: Medium, field: Field, concentration: np.ndarray) -> None:
    """Raises where meshes are too coarse for the field's gradient, outside the egg."""
    corner, spacing = np.asarray(medium.box)[:, 0], np.asarray(medium.mesh.spacing)
    x, y = (corner[i] + np.arange(2, medium.shape[i] - 1) * spacing[i] for i in (0, 1))
    between = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    seen = medium.mesh.footprint(between, corner)
    error = np.abs(seen.by_cell(seen.weight * seen.read(concentration)) - field.concentration(between))
    radius = getattr(field, "egg_radius", None)
    if radius is not None:
        centre = np.asarray(getattr(field, "egg_position", (0.0, 0.0)))
        error = error[np.hypot(*(between - centre).T) > radius]
    allowed = COARSE * field.gradient_scale * min(spacing)
    worst = float(error.max(initial=0.0))
    if worst > allowed:
        rule = f"shape must resolve the field's gradient: between nodes at most {allowed:.3g} may be lost"
        raise ValueError(f"medium.{rule}, got {worst:.3g} with {medium.shape}")


def _check_edges(medium: Medium, flow: Flow, concentration: np.ndarray) -> None:
    """Warns where the flow, or the field itself, does not go on beyond the edges."""
    edges = np.concatenate([concentration[[0, -1]].ravel(), concentration[:, [0, -1]].ravel()])
    nothing = EDGE * float(np.abs(concentration).max())
    highest = float(np.abs(edges).max())
    across = [np.abs(concentration.take(0, axis) - concentration.take(-1, axis)).max() for axis in (0, 1)]
    within = [np.abs(np.diff(concentration, axis=axis)).max() for axis in (0, 1)]
    if highest > nothing and not _goes_on(medium, flow):
        rule = "a field that vanishes at the edges, because the flow does not go on there"
        warnings.warn(f"medium.carried needs {rule}, got a concentration of {highest:.3g}", stacklevel=4)
    elif medium.mesh.periodic and any(np.greater(across, nothing + 2 * np.array(within))):
        rule = "a field that goes on beyond periodic edges"
        warnings.warn(f"medium.carried needs {rule}, got a step of {max(across):.3g} there", stacklevel=4)


def _goes_on(medium: Medium, flow: Flow) -> bool:
    """Whether the flow is the same at opposite edges, or passes none where nothing may."""
    coordinates = medium.mesh.coordinates(medium.mesh.corner(np.zeros(2)))
    for axis, (low, high) in enumerate(medium.box):
        places = np.empty((2, medium.shape[1 - axis], 2))
        places[..., 1 - axis], places[..., axis] = coordinates[1 - axis], [[low], [high]]
        velocity = frozen(flow, 0.0).velocity(places)
        stray = velocity[0] - velocity[1] if medium.mesh.periodic else velocity[..., axis]
        if np.abs(stray).max() > EDGE * max(flow.speed_scale, float(np.abs(velocity).max())):
            return False
    return True
