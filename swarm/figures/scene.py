"""What a picture of a swarm shows: the water, the egg, the swimmers with their trails."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from swarm.figures import picture
from swarm.physics.world import World

SIZE = 720  # of the square that shows the world [pixels]
GRID = 180  # places across the square at which field and flow are computed
TRAIL = 28  # decisions that a trail reaches back
TAIL = 0.45  # length of a swimmer's flagellum [length]
DOT = 0.7  # distance from dot to dot of a trail [pixels]
WHITE = (1.0, 1.0, 1.0)
SHADOW = (0.02, 0.03, 0.06)


class Camera(NamedTuple):
    """The square of the world that is in view."""

    x: float  # of its centre [length]
    y: float
    width: float

    @property
    def scale(self) -> float:
        """Pixels per length."""
        return SIZE / self.width

    def pixels(self, places: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of complex places (...) [length]."""
        away = (places - complex(self.x, self.y)) * self.scale
        return np.stack([away.real, -away.imag], axis=-1) + (SIZE - 1) / 2


class Glance(NamedTuple):
    """What of a state is to be seen."""

    position: np.ndarray  # (cells,) complex [length]
    angle: np.ndarray  # (cells,) heading [rad]
    curvature: np.ndarray  # (cells,) of the interval that ended [1 / length]
    time: np.ndarray  # (cells,)
    gain: np.ndarray  # (cells,)
    finished: np.ndarray  # (cells,) bool


class Segment(NamedTuple):
    """The paths of one decision: arcs between two glances."""

    start: np.ndarray  # (cells,) complex [length]
    chord: np.ndarray  # (cells,) complex [length]
    turn: np.ndarray  # (cells,) [rad]
    swum: np.ndarray  # (cells,) [length]; 0 where the cell rested
    seen: np.ndarray  # (cells,) bool: swum, and in the cell's present life

    def places(self, share: np.ndarray) -> np.ndarray:
        """Complex places (cells, k) at shares (k,) in [0, 1] of the interval.

        z(s) = z₀ + (z₁ − z₀)(e^{iαs} − 1)/(e^{iα} − 1): the arc of angle α through both ends.
        """
        small = np.abs(self.turn) < 1e-4
        turn = np.where(small, 1.0, self.turn)[:, None]
        ratio = np.expm1(1j * turn * share) / np.expm1(1j * turn)
        return self.start[:, None] + self.chord[:, None] * np.where(small[:, None], share, ratio)


def colours(world: World) -> tuple[str, ...]:
    """Colours of the water: of the flow's speed where there is a flow, else of the concentration."""
    return picture.PLUM if world.in_flow else picture.SEA


def paint_water(
    square: np.ndarray, world: World, camera: Camera, seen: tuple[float, float] | None
) -> tuple[float, float]:
    """Concentration, or the flow's speed, as colour, with lines of equal concentration.

    Colours run over `seen` and what is in view; returns the values over which they run.
    """
    offsets = ((np.arange(GRID) + 0.5) / GRID - 0.5) * camera.width
    grid = np.stack(np.meshgrid(camera.x + offsets, camera.y - offsets), axis=-1)
    concentration = np.nan_to_num(np.asarray(world.field.concentration(grid), float))
    shown = concentration
    if world.in_flow:
        velocity = np.nan_to_num(np.asarray(world.flow.velocity(grid), float))
        shown = np.hypot(velocity[..., 0], velocity[..., 1])
    known = np.ones(shown.shape, bool)
    for inside in world.domains:
        known &= np.asarray(inside(grid))
    values = shown[known] if known.any() else shown
    low, high = 0.0 if world.in_flow else float(values.min()), float(values.max())
    if seen is not None:
        low, high = min(low, seen[0]), max(high, seen[1])
    square[:] = picture.coloured(picture.enlarged(shown, SIZE), low, high, colours(world))
    span = float(np.ptp(concentration))
    if span > 0:
        lines = picture.contours(picture.enlarged(concentration, SIZE), picture.nice_step(span / 8))
        picture.lay(square, WHITE, lines)
    if not known.all():
        picture.lay(square, picture.PAPER, 0.8 * np.clip(picture.enlarged(1.0 - known, SIZE), 0, 1))
    return low, high


def paint_streaks(square: np.ndarray, world: World, camera: Camera, fastest: float) -> None:
    """Streaks that brighten in the direction of the flow, the longer the faster it is."""
    step = picture.nice_step(camera.width / 8)  # they stand still while the camera moves
    count = math.ceil(camera.width / step / 2) + 1
    ticks = np.arange(-count, count + 1)
    columns, rows = (round(camera.x / step) + ticks) * step, (round(camera.y / step) + ticks) * step
    grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    velocity = np.nan_to_num(np.asarray(world.flow.velocity(grid), float))
    streak = _complex(velocity)[:, None] * (0.7 * step / max(fastest, 1e-12))
    share = np.linspace(0, 1, 40)
    dots = _complex(grid)[:, None] + streak * (share - 0.5)
    spacing = np.abs(streak) * camera.scale / len(share)
    weights = 0.45 * share * np.clip(spacing, 0, 1)
    picture.lay(square, picture.INK, picture.strokes(camera.pixels(dots.ravel()), weights.ravel(), SIZE))


def paint_egg(square: np.ndarray, egg: tuple[tuple[float, float], float], camera: Camera) -> None:
    """The egg and a halo around it."""
    (x, y), radius = egg
    centre, radius = camera.pixels(np.array(complex(x, y))), radius * camera.scale
    halo = picture.disc(centre, 1.35 * radius, SIZE, softness=0.7 * radius)
    core = picture.disc(centre, 0.45 * radius, SIZE, softness=0.5 * radius)
    picture.lay(square, picture.EGG, 0.16 * halo)
    picture.lay(square, picture.EGG, 0.85 * picture.disc(centre, radius, SIZE))
    picture.lay(square, picture.YOLK, 0.5 * core)


def paint_swimmers(
    square: np.ndarray, glance: Glance, trail: Sequence[Segment], camera: Camera, share: float
) -> None:
    """Fading trails, flagella and heads; `share` is how much of the latest segment has been swum."""
    dots, fading, tail_dots, tail_fading = [], [], [], []
    behind = np.zeros(len(glance.position))  # how far back along the path [length]
    for age, segment in enumerate(reversed(trail)):
        part = share if age == 0 else 1.0
        longest = float(segment.swum.max())
        count = max(2, math.ceil(longest * camera.scale / DOT))
        shares = part * (np.arange(count) + 0.5) / count
        places = segment.places(shares)
        visible = np.broadcast_to(segment.seen[:, None], places.shape)
        weight = DOT * segment.swum[:, None] / max(longest, 1e-12)
        back = behind[:, None] + segment.swum[:, None] * (part - shares)
        faded = np.clip(1 - (age + part - shares) / TRAIL, 0, 1) ** 1.5
        tail = visible & (back < TAIL)
        dots.append(places[visible])
        fading.append((weight * faded)[visible])
        tail_dots.append(places[tail])
        tail_fading.append((1.3 * weight * (1 - back / TAIL))[tail])
        behind = behind + part * segment.swum
    for colour, parts, weights in ((picture.TRAIL, dots, fading), (WHITE, tail_dots, tail_fading)):
        if parts:
            places = camera.pixels(np.concatenate(parts))
            picture.lay(square, colour, picture.strokes(places, np.concatenate(weights), SIZE))
    place, angle = glance.position, glance.angle
    if trail:
        latest = trail[-1]
        place = np.where(latest.seen, latest.places(np.array([share]))[:, 0], place)
        angle = angle - np.where(latest.seen, (1 - share) * latest.turn, 0.0)
    _paint_heads(square, camera, place, angle, glance.finished)


def _paint_heads(
    square: np.ndarray, camera: Camera, place: np.ndarray, angle: np.ndarray, finished: np.ndarray
) -> None:
    length = min(max(0.11 * camera.scale, 4.0), 7.0)
    for chosen, colour in ((finished, picture.RESTING), (~finished, WHITE)):
        if chosen.any():
            pixels, tilt = camera.pixels(place[chosen]), -angle[chosen]
            rim = picture.ellipses(pixels, tilt, length + 1.4, 0.62 * length + 1.4, SIZE)
            picture.lay(square, SHADOW, 0.75 * rim)
            picture.lay(square, colour, picture.ellipses(pixels, tilt, length, 0.62 * length, SIZE))


def write_scale(square: np.ndarray, camera: Camera) -> None:
    """A bar that tells how long a length is."""
    length = picture.nice_step(camera.width / 5)
    pixels = length * camera.scale
    sheet = picture.Sheet(math.ceil(pixels) + 16, 34)
    sheet.line(np.array([(8, 24), (8 + pixels, 24)]), picture.INK, 2.5)
    sheet.text((8 + pixels / 2, 17), f"{length:g}", 12, anchor="ms")
    width, height = sheet.size
    corner = square[:, SIZE - 16 - height : SIZE - 16, 16 : 16 + width]
    corner *= 0.6
    sheet.lay_on(corner)


def _complex(vectors: np.ndarray) -> np.ndarray:
    return vectors[..., 0] + 1j * vectors[..., 1]
