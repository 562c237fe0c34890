"""Axes of a grid: points that are evenly spaced, and where a grid that repeats begins again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from swarm._support.checks import check_number
from swarm.physics.grids.spline import MIN_POINTS, Lattice
from swarm.physics.grids.units import AXES, SPACE

SPACING_TOLERANCE = 0.01  # of the spacing, by which points may be off: coordinates are stored rounded


def axes_of(*values: Any) -> tuple[str, ...]:
    """x and y, and z where one of the values is given for it."""
    sizes = [len(value) for value in values if isinstance(value, Sequence) and not isinstance(value, str)]
    names = any(isinstance(value, Mapping) and "z" in value for value in values)
    return SPACE if names or len(SPACE) in sizes else AXES


def per_axis(
    name: str, value: Any, check: Callable[[str, Any], Any], axes: Sequence[str] = AXES
) -> tuple[Any, ...]:
    """What is given for each axis, checked: for all, in their order, or by name."""
    if isinstance(value, Mapping):
        unknown = [key for key in value if key not in axes]
        if unknown:
            raise ValueError(f"{name} must be given for {' and '.join(axes)}, got {unknown[0]!r}")
        value = [value.get(axis) for axis in axes]
    if isinstance(value, str) or not isinstance(value, Sequence):
        return (check(name, value),) * len(axes)
    if len(value) != len(axes):
        raise ValueError(f"{name} must be given once, or for {' and '.join(axes)}, got {value!r}")
    return tuple(check(f"{name} along {axis}", each) for axis, each in zip(axes, value, strict=True))


def check_numbers(name: str, numbers: Any) -> None:
    """Raises ValueError unless an array holds real numbers."""
    if numbers.dtype.kind not in "fiu":
        hint = "; give numbers of the world's unit of time" if numbers.dtype.kind in "mM" else ""
        raise ValueError(f"{name} must hold real numbers, got {numbers.dtype}{hint}")


def check_points(name: str, points: np.ndarray, fewest: int, purpose: str) -> None:
    """Raises ValueError unless there are enough points, all finite."""
    if len(points) < fewest:
        raise ValueError(f"{name} must have at least {fewest} points{purpose}, got {len(points)}")
    if not np.all(np.isfinite(points)):
        raise ValueError(f"{name} must be finite, got {points[~np.isfinite(points)][0]:g}")


def check_strict(name: str, points: np.ndarray) -> None:
    """Raises ValueError unless points rise or fall strictly: arrays without labels are taken as they are."""
    steps = np.diff(points)
    if not (np.all(steps > 0) or np.all(steps < 0)):
        towards = 1 if len(steps) and steps[0] > 0 else -1
        at = int(np.argmin(steps * towards > 0))
        pair = f"{points[at]:g} before {points[at + 1]:g} at index {at}"
        raise ValueError(f"{name} must rise or fall strictly where data are bare arrays, got {pair}")


def lattice_of(arrays: Mapping[str, Any], values: np.ndarray, reading: Any) -> tuple[Lattice, np.ndarray]:
    """Where the points are, and the values without lines that a stated period repeats."""
    first, fewest = next(iter(arrays.values())), MIN_POINTS[reading.interpolation]
    finest = np.array([_precision(*pair) for pair in zip(arrays.values(), values, strict=True)])
    purpose, leading = f" for {reading.interpolation} interpolation", 2
    unit = finest.reshape(-1, *(1,) * (values.ndim - 1))
    origin: list[Any] = []
    spacings: list[Any] = []
    for i, axis in enumerate(axis for axis in SPACE if axis in first.dims):
        points = np.asarray(first[axis].values, np.float64)
        check_points(axis, points, fewest, purpose)
        start, spacing = _regular(axis, points, reading.spacing_tolerance)
        if reading.edges[i] == "periodic":
            numbers = np.where(np.isfinite(values), values, 0.0) / unit
            lines = np.moveaxis(numbers, leading + i, 0)
            period = _stated_period(first[axis], reading.period[i])
            if period is None:
                _check_period(axis, spacing, lines, list(arrays))
            else:
                count = _lines_of(axis, period, spacing, lines)
                check_points(axis, points[:count], fewest, purpose)
                values, spacing = np.take(values, range(count), axis=leading + i), period / count
        origin.append(start)
        spacings.append(spacing)
    periodic = tuple(edge == "periodic" for edge in reading.edges)
    return Lattice(tuple(origin), tuple(spacings), values.shape[leading:], periodic), values


def _precision(array: Any, values: np.ndarray) -> float:
    """By how much numbers that were the same may differ as they are stored."""
    known = values[np.isfinite(values)]
    if not known.size:
        return 1.0
    largest, spread = float(np.abs(known).max()), float(np.ptp(known))
    packed = np.ravel(array.encoding.get("scale_factor", 0.0))[0]
    with np.errstate(over="ignore"):
        single = np.array_equal(known.astype(np.float32), known)
    dtype = array.dtype if array.dtype.kind == "f" else np.dtype(np.float64)
    epsilon = np.finfo(np.float32 if single and dtype.itemsize > 4 else dtype).eps
    return max(1e-9 * spread, 1.01 * abs(float(packed)), 8 * float(epsilon) * largest, 1e-300)


def _regular(axis: str, points: np.ndarray, tolerance: float) -> tuple[float, float]:
    """First point and spacing of rising points; raises ValueError unless they are evenly spaced but for a
    `tolerance`, in spacings.
    """
    count = np.arange(len(points))
    start, spacing = float(points[0]), float(points[-1] - points[0]) / (len(points) - 1)
    error = np.abs(points - (start + spacing * count))
    # single precision coordinates are evenly spaced but for their rounding
    slack = min(1e-6 * spacing + 4e-7 * float(np.abs(points).max()), 0.1 * spacing)
    if spacing > 0 and error.max() > slack:  # of rounded points the ends are rounded too
        spacing, start = (float(number) for number in np.polyfit(count, points, 1))
        error, slack = np.abs(points - (start + spacing * count)), max(slack, tolerance * spacing)
    worst = int(error.argmax())
    if spacing <= 0 or error[worst] > slack:
        share = f" ({error[worst] / spacing:.2g} of the spacing)" if spacing > 0 else ""
        raise ValueError(
            f"{axis} must be evenly spaced, got {points[worst]:g} at index {worst} instead of "
            f"{start + spacing * worst:g}{share}; "
            f"a spacing_tolerance above {tolerance:g} allows more"
        )
    return start, spacing


def _stated_period(coordinate: Any, given: float | None) -> float | None:
    """The length after which a coordinate repeats: as given, else as its attribute `period` or `modulo` has
    it."""
    if given is not None:
        return given
    for name in ("period", "modulo"):
        stated = np.ravel(np.asarray(coordinate.attrs.get(name)))
        if stated.size == 1 and stated.dtype.kind in "fiu":
            return check_number(f"{name} of {coordinate.name}", stated[0].item(), above=0.0)
    return None


def _lines_of(axis: str, period: float, spacing: float, lines: np.ndarray) -> int:
    """How many of the lines (points, ...), each in what its numbers are precise to, make up a period.

    Further ones are dropped. Raises ValueError where there are too few, or where they do not repeat the
    first.
    """
    exact, points = period / spacing, len(lines)
    count = round(exact)
    if abs(exact - count) > 0.1 or not 1 < count <= points:
        rule = f"period along {axis} must be a whole number of spacings, {points} of {spacing:g} at most"
        raise ValueError(f"{rule}, got {period:g}")
    error = max((_distance(lines[i], lines[i - count]) for i in range(count, points)), default=0.0)
    if error > max(2.0, 1e-3 * float(np.ptp(lines))):
        raise ValueError(
            f"{axis} must have lines that repeat after the period {period:g}, got others beyond {count} lines"
        )
    return count


def _check_period(axis: str, spacing: float, lines: np.ndarray, names: Sequence[str]) -> None:
    """Raises ValueError where the last lines of a periodic grid state its first ones again."""
    if again := _repeated(lines):
        which = "line" if again == 1 else f"{again} lines"
        raise ValueError(
            f"{axis} of a periodic grid must end one spacing before its period: the last {which} of "
            f"{', '.join(names)} must not repeat the first, got the same values; period="
            f"{(len(lines) - again) * spacing:g} drops them, period={len(lines) * spacing:g} keeps them"
        )


def _repeated(lines: np.ndarray) -> int:
    """How many of the last lines (points, ...) are the first ones again; numbers are equal within 1.

    That may be chance: where lines do not vary, where they repeat within the grid, and where a grid mirrors
    itself and is smoother with its last line than without.
    """
    points, mirrored = len(lines), False
    for again in range(1, points // 2 + 1):
        if _distance(lines[-again], lines[0]) > 1:
            continue
        if any(_distance(lines[i - again], lines[i]) > 1 for i in range(1, again)):
            continue
        if all(_distance(lines[i], lines[0]) <= 2 for i in range(1, max(again, 2))):
            continue
        if all(_distance(lines[i], lines[i - again]) <= 1 for i in range(again, points)):
            continue
        if again > 1 or not _mirrored(lines):
            return again
        mirrored = _seam(lines[:-1]) < _seam(lines)
    return int(mirrored)


def _distance(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max())


def _mirrored(lines: np.ndarray) -> bool:
    return all(_distance(lines[i], lines[-1 - i]) <= 1 for i in range(len(lines) // 2))


def _seam(lines: np.ndarray) -> float:
    """How much of the shortest waves a grid that begins again after its last line holds: a seam has many."""
    waves = np.fft.rfft(lines - lines.mean(axis=0), axis=0) / len(lines)
    return float((np.abs(waves[len(lines) // 4 :]) ** 2).sum())
