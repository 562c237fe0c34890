"""Holes in a grid: where data are missing, as on land, in walls, or where no particle was seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

FILLS = ("inside", "nearest", "zero")


def filled(
    values: np.ndarray, how: str | None, spacing: Sequence[float], periodic: Sequence[bool]
) -> np.ndarray:
    """Values (..., points along each axis) without holes: those of the nearest point there is, or 0.

    Raises ValueError where there is nothing to fill from.
    """
    known = np.isfinite(values)
    if how == "zero":
        return np.where(known, values, 0.0)
    result, axes = values.copy(), len(spacing)
    for at in np.ndindex(values.shape[: values.ndim - axes]):
        if not known[at].any():
            raise ValueError(f"data must be finite somewhere, got none of {known[at].size} values")
        if not known[at].all():
            result[at] = values[at][_nearest(known[at], spacing, periodic)]
    return result


def _nearest(known: np.ndarray, spacing: Sequence[float], periodic: Sequence[bool]) -> tuple[np.ndarray, ...]:
    """Index arrays of the nearest known point of each point."""
    from scipy.ndimage import distance_transform_edt

    widths = [length // 2 + 1 if again else 0 for length, again in zip(known.shape, periodic, strict=True)]
    padded = np.pad(known, [(width, width) for width in widths], mode="wrap") if any(widths) else known
    index = distance_transform_edt(~padded, spacing, return_distances=False, return_indices=True)
    inner = tuple(slice(width, width + length) for width, length in zip(widths, known.shape, strict=True))
    parts = zip(index, widths, known.shape, strict=True)
    return tuple((part[inner] - width) % length for part, width, length in parts)


def whole_cells(known: np.ndarray, periodic: Sequence[bool]) -> np.ndarray:
    """Which grid cells have values at all their corners, from points (points along each axis)."""
    for axis, again in enumerate(periodic):
        corners = np.moveaxis(known, axis, 0)
        after = np.roll(corners, -1, 0) if again else corners[1:]
        known = np.moveaxis(after & corners[: len(after)], 0, axis)
    return known
