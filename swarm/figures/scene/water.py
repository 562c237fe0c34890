"""What cells swim in: the water as it is at a time, lines and streaks in it, the egg, scale and colours."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from contourpy import contour_generator
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from PIL import Image

from swarm.figures.scene.easel import FAINT, INK, LEFT, PAPER, SIZE, Easel, nice_step, signed
from swarm.figures.scene.glance import Camera, Glance
from swarm.figures.style import in_domain
from swarm.physics.crowd.medium import Medium, MediumState
from swarm.physics.motion.clock import frozen
from swarm.physics.world import World

BAR = (430, 690)  # rows of the colour bar
GRID = 180  # places across the square at which field and flow are computed
EGG, YOLK, CLOSED = "#fadbbd", "#db9e80", "#ffffff"
SHALLOW = 0.05  # of the highest concentration that colours run over at least, where a medium is
# They grow brighter all the way: whoever sees no colours reads them too.
SEA = LinearSegmentedColormap.from_list("sea", ["#0b1330", "#10315c", "#145374", "#1f7a83", "#3fa38a"])
PLUM = LinearSegmentedColormap.from_list("plum", ["#0d0f26", "#1f2250", "#38306f", "#57397b", "#7a4681"])


def concentration_at(
    world: World,
    time: float,
    places: np.ndarray,
    held: MediumState | None = None,
    medium: Medium | None = None,
) -> np.ndarray:
    """Concentration (...) that cells sense at places (..., axes) at a time, NaN where none is known.

    `held` is what the medium of one world holds, on the grid of `medium`, by default the world's.
    """
    medium = medium or world.medium

    def sensed(at: np.ndarray) -> np.ndarray:
        if medium is None or held is None:
            return np.asarray(frozen(world.field, time).concentration(at))
        field = np.zeros(len(at)) if medium.carried else frozen(world.field, time).concentration(at)
        return np.where(medium.inside(at, held.origin), medium.sense(held, at, field), np.nan)

    places = np.asarray(places, float)
    return in_domain(world, sensed, places.reshape(-1, places.shape[-1])).reshape(places.shape[:-1])


def velocity_at(world: World, time: float, places: np.ndarray) -> np.ndarray:
    """The flow (..., axes) at places (..., axes) [length / time], 0 where none is known."""

    def velocity(at: np.ndarray) -> np.ndarray:
        return np.asarray(frozen(world.flow, time).velocity(at), float)

    found = in_domain(world, velocity, places)
    return np.nan_to_num(found) if found.shape == places.shape else np.zeros(places.shape)


def speed_at(world: World, time: float, places: np.ndarray) -> np.ndarray:
    """How fast (...) it flows at places (..., axes) [length / time], 0 where it is not known."""
    return np.linalg.norm(velocity_at(world, time, places), axis=-1)


def levels_of(
    values: np.ndarray, ticks: np.ndarray, low: float, high: float, least: float = 0.0
) -> list[tuple[np.ndarray, float]]:
    """Lines (k, 2) of equal values (rows, columns), by `ticks` along both axes, with their opacities.

    Between the lowest and the highest value, which may be those of more than this, `least` apart at least.
    """
    if not high > low:
        return []
    step = nice_step(max(high - low, least) / 8)
    levels = np.arange(math.ceil(low / step), math.floor(high / step) + 1)
    lines: Any = contour_generator(ticks, ticks, np.ma.masked_invalid(values)).multi_lines(levels * step)
    strong = [0.25 if level % 5 == 0 else 0.1 for level in levels]
    return [(line, each) for found, each in zip(lines, strong, strict=True) for line in found]


class Water:
    """Draws what is behind the cells; colours run over all values that have been in view."""

    def __init__(self, world: World, easel: Easel, lower: int) -> None:
        """The colour bar begins so many pixels `lower` than it could."""
        self.world, self.easel, self.top = world, easel, BAR[0] + lower
        self.shows_flow = world.in_flow and world.medium is None
        self.changes = world.medium is not None or not world.is_steady
        self.colours = PLUM if self.shows_flow else SEA
        self.span = (np.inf, -np.inf)  # values over which the colours run

    def draw(self, camera: Any, glance: Glance) -> None:
        """Everything that stands still while cells swim."""
        time, easel = float(glance.time.max()), self.easel
        self._draw_water(camera, time, glance.medium)
        if self.world.in_flow:
            self._draw_streaks(camera, time)
        if self.world.egg is not None:
            place, radius = self.world.egg
            spot = camera.pixels(np.array(complex(*place)))
            self._draw_egg(spot, 2 * radius * camera.scale, glance.closed)
        length = nice_step(camera.width / 5)
        wide = length * camera.scale
        easel.draw(Rectangle((15.5, SIZE - 50.5), wide + 16, 34, color=PAPER, alpha=0.55, linewidth=0))
        easel.draw(Rectangle((23.5, SIZE - 26.5), wide, 3, color=INK, linewidth=0))
        easel.write(24 + wide / 2, SIZE - 33, f"{length:g}", ha="center")
        self._draw_bar()

    def _draw_water(self, camera: Camera, time: float, medium: Any) -> None:
        """Concentration, or the flow's speed, as colour, with lines of equal concentration."""
        offsets = ((np.arange(GRID) + 0.5) / GRID - 0.5) * camera.width
        grid = np.stack(np.meshgrid(camera.x + offsets, camera.y - offsets), axis=-1)
        found = concentration_at(self.world, time, grid, medium)
        known, concentration = np.isfinite(found), np.nan_to_num(found).astype(float)
        shown = speed_at(self.world, time, grid) if self.shows_flow else concentration
        values = shown[known] if known.any() else shown
        self._widen(0.0 if self.shows_flow else float(values.min()), float(values.max()))
        part = (shown - self.span[0]) / max(float(np.ptp(self.span)), 1e-12)
        colours = self.colours(np.arange(256), bytes=True).view(np.uint32).ravel()
        water = colours[_enlarged(255 * np.clip(part, 0, 1))].view(np.uint8).reshape(SIZE, SIZE, 4)
        if not known.all():
            veil = 0.8 / 255 * _enlarged(255 * ~known)[..., None]
            water[..., :3] = (1 - veil) * water[..., :3] + veil * 255 * np.array(to_rgb(PAPER))
        self.easel.show(water, 0, 0)
        held = concentration if self.world.medium is None else found
        low, high = float(np.nanmin(held)), float(np.nanmax(held))
        ticks = np.interp(np.arange(GRID), (0, 1, GRID - 2, GRID - 1), (-1, 5.5, SIZE - 6.5, SIZE))
        lines = levels_of(held, ticks, low, high, SHALLOW * high if self.world.medium else 0.0)
        self.easel.lines([line for line, _ in lines], "#ffffff", [each for _, each in lines], 1.0)

    def _widen(self, low: float, high: float) -> None:
        """Let colours run over these values too."""
        low, high = min(low, self.span[0]), max(high, self.span[1])
        if self.world.medium is not None:  # nor are ripples of rounding shown as waves
            low = min(low, high - SHALLOW * abs(high))
        self.span = low, high

    def _draw_streaks(self, camera: Camera, time: float) -> None:
        """Streaks that brighten in the direction of the flow, the longer the faster it is."""
        step = nice_step(camera.width / 8)  # they stand still while the camera moves
        reach = math.ceil(camera.width / step / 2) + 1
        x, y = (step * np.arange(round(at / step) - reach, round(at / step) + reach + 1) for at in camera[:2])
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        flow = velocity_at(self.world, time, grid) @ [1, 1j]
        fastest = self.span[1] if self.shows_flow else float(np.abs(flow).max())
        streak = flow[:, None] * (0.7 * step / max(fastest, 1e-12))
        lines = (grid @ [1, 1j])[:, None] + streak * np.linspace(-0.5, 0.5, 9)
        self.easel.fade(camera.pixels(lines), INK, np.linspace(0, 0.6, 8), 1.5)

    def _draw_egg(self, spot: np.ndarray, wide: float, closed: bool) -> None:
        """The egg, so many pixels wide, a halo around it and its yolk, each of the two many faint discs; a
        closed one has raised its envelope.
        """
        halo, yolk = np.linspace(1.7, 1.0, 15), np.linspace(0.75, 0.1, 12)
        across = wide * np.concatenate([halo, [1.0], yolk])
        colours = [(EGG, 0.016)] * len(halo) + [(EGG, 0.85)] + [(YOLK, 0.06)] * len(yolk)
        centre = np.tile(spot, (len(across), 1))
        still = np.zeros(len(across))
        self.easel.ellipses(centre, across, across, still, facecolors=colours, linewidths=0)
        if closed:
            shell, rim = np.full(1, across[len(halo)] * 1.25 + 6), {"facecolors": "none", "linewidths": 3.0}
            self.easel.ellipses(centre[:1], shell, shell, still[:1], edgecolors=CLOSED, **rim)

    def _draw_bar(self) -> None:
        (top, bottom), (low, high) = (self.top, BAR[1]), self.span
        shades = self.colours(np.linspace(1, 0, bottom - top), bytes=True)
        self.easel.show(np.repeat(shades[:, None], 16, axis=1), LEFT, top)
        for value in MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(low, high):
            if low <= value <= high and low < high:
                row = bottom - (bottom - top) * (value - low) / (high - low)
                self.easel.draw(Line2D([LEFT + 16, LEFT + 22], [row, row], color=FAINT, linewidth=1))
                self.easel.write(LEFT + 28, row, signed(f"{value:g}"), va="center_baseline")


def _enlarged(values: np.ndarray) -> np.ndarray:
    """Values from 0 to 255 on the grid, smooth and rounded on the pixels of the square."""
    coarse = Image.fromarray(np.rint(values).astype(np.uint8))
    return np.asarray(coarse.resize((SIZE, SIZE), Image.Resampling.BICUBIC))
