"""The picture of a swarm: water, egg, swimmers with their trails, and a panel of numbers, drawn by Agg."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from contourpy import contour_generator
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Rectangle
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D, Bbox, IdentityTransform
from PIL import Image

from swarm.figures.style import in_domain, in_style
from swarm.physics.motion.domain import inside_all
from swarm.physics.world import World

SIZE = 720  # of the square that shows the world [pixels]
PANEL = 240  # width of the panel beside it [pixels]
LEFT, RIGHT = SIZE + 26, SIZE + PANEL - 26  # columns between which the panel is filled
CURVE = (190, 290)  # rows of the curve of gains
BAR = (430, 690)  # rows of the colour bar
GRID = 180  # places across the square at which field and flow are computed
TRAIL = 28  # decisions that a trail reaches back
TAIL = 1.1  # decisions that a flagellum reaches back
WAVE, BEAT, BEND = 0.8, 0.8, 0.04  # of a flagellum: decisions a wave, waves a decision, height [length]

INK, FAINT, PAPER, SHADOW = "#edf2f7", "#94a6b8", "#090c14", "#05080f"
GOLD, HEAD, RESTING, EGG, YOLK = "#ffcc6b", "#ffffff", "#99a8bd", "#fadbbd", "#db9e80"
# They grow brighter all the way: whoever sees no colours reads them too.
SEA = LinearSegmentedColormap.from_list("sea", ["#0b1330", "#10315c", "#145374", "#1f7a83", "#3fa38a"])
PLUM = LinearSegmentedColormap.from_list("plum", ["#0d0f26", "#1f2250", "#38306f", "#57397b", "#7a4681"])
DARK = {"figure.dpi": 72, "text.color": INK, "font.size": 12}  # a point is a pixel

PIXELS = Affine2D().scale(1, -1).translate(0.5, SIZE - 0.5)  # Agg's place of a pixel's column and row
SQUARE = Bbox(((0, 0), (SIZE, SIZE)))


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
        """Columns and rows (..., 2) of complex places (...) [length]."""
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
    seen: np.ndarray  # (cells,) bool: swum, and in the cell's present life

    def places(self, share: np.ndarray) -> np.ndarray:
        """Complex places (cells, k) at shares (k,) in [0, 1] of the interval; NaN where nothing is seen.

        z(s) = z₀ + (z₁ − z₀)(e^{iαs} − 1)/(e^{iα} − 1): the arc of angle α through both ends.
        """
        small = np.abs(self.turn) < 1e-4
        turn = np.where(small, 1.0, self.turn)[:, None]
        ratio = np.where(small[:, None], share, np.expm1(1j * turn * share) / np.expm1(1j * turn))
        return np.where(self.seen[:, None], self.start[:, None] + self.chord[:, None] * ratio, np.nan)


class Scene:
    """Draws pictures (720, 960, 3) uint8 of one world.

    Colours run over all values that have been in view. What stands still while the cells swim is drawn once
    for every place of the camera.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.colours = PLUM if world.in_flow else SEA
        self.span = (np.inf, -np.inf)  # values over which the colours run
        self.camera: Camera | None = None
        with in_style(DARK):
            self.figure = Figure(figsize=((SIZE + PANEL) / 72, SIZE / 72), facecolor=PAPER)
            self.canvas = FigureCanvasAgg(self.figure)
            self.canvas.draw()
            shown = "flow speed" if world.in_flow else "concentration"
            for row, label in ((52, "time"), (130, "mean gain"), (340, "swimming"), (416, shown)):
                self._write(LEFT, row, label, fontsize=13, color=FAINT)
            self.paper = self.backdrop = self.canvas.copy_from_bbox(self.figure.bbox)

    def picture(
        self,
        camera: Camera,
        glance: Glance,
        trail: Sequence[Segment],
        curve: np.ndarray,
        *,
        share: float = 1.0,
    ) -> np.ndarray:
        """The cells of a `glance`, `share` of whose latest segment is swum, and their `trail` (oldest first).

        `curve` (decisions, 4) holds time and the mean, least and largest gain.
        """
        with in_style(DARK):
            if camera != self.camera:
                self.canvas.restore_region(self.paper)
                self._draw_backdrop(camera)
                self.camera, self.backdrop = camera, self.canvas.copy_from_bbox(self.figure.bbox)
            self.canvas.restore_region(self.backdrop)
            self._draw_swimmers(camera, glance, trail, len(curve) + share, share)
            self._draw_numbers(curve, glance.finished)
        return np.ascontiguousarray(np.asarray(self.canvas.buffer_rgba())[..., :3])

    # --- what stands still ---

    def _draw_backdrop(self, camera: Camera) -> None:
        self._draw_water(camera)
        if self.world.in_flow:
            self._draw_streaks(camera)
        if self.world.egg is not None:
            self._draw_egg(camera, *self.world.egg)
        length = nice_step(camera.width / 5)
        wide = length * camera.scale
        self._draw(Rectangle((15.5, SIZE - 50.5), wide + 16, 34, color=PAPER, alpha=0.55, linewidth=0))
        self._draw(Rectangle((23.5, SIZE - 26.5), wide, 3, color=INK, linewidth=0))
        self._write(24 + wide / 2, SIZE - 33, f"{length:g}", ha="center")
        self._draw_bar()

    def _draw_water(self, camera: Camera) -> None:
        """Concentration, or the flow's speed, as colour, with lines of equal concentration."""
        world = self.world
        offsets = ((np.arange(GRID) + 0.5) / GRID - 0.5) * camera.width
        grid = np.stack(np.meshgrid(camera.x + offsets, camera.y - offsets), axis=-1)
        concentration = np.nan_to_num(in_domain(world, world.field.concentration, grid).astype(float))
        shown = np.abs(self._flow(grid)) if world.in_flow else concentration
        inside = inside_all(world.domains, grid)
        known = np.ones(shown.shape, bool) if inside is None else np.asarray(inside)
        values = shown[known] if known.any() else shown
        low, high = 0.0 if world.in_flow else float(values.min()), float(values.max())
        self.span = min(low, self.span[0]), max(high, self.span[1])
        part = (shown - self.span[0]) / max(float(np.ptp(self.span)), 1e-12)
        colours = self.colours(np.arange(256), bytes=True).view(np.uint32).ravel()
        water = colours[_enlarged(255 * np.clip(part, 0, 1))].view(np.uint8).reshape(SIZE, SIZE, 4)
        if not known.all():
            veil = 0.8 / 255 * _enlarged(255 * ~known)[..., None]
            water[..., :3] = (1 - veil) * water[..., :3] + veil * 255 * np.array(to_rgb(PAPER))
        self._show(water, 0, 0)
        low, high = float(concentration.min()), float(concentration.max())
        if high <= low:
            return
        step = nice_step((high - low) / 8)
        levels = np.arange(math.ceil(low / step), math.floor(high / step) + 1)
        ticks = np.interp(np.arange(GRID), (0, 1, GRID - 2, GRID - 1), (-1, 5.5, SIZE - 6.5, SIZE))
        found: Any = contour_generator(ticks, ticks, concentration).multi_lines(levels * step)
        strong = [0.25 if level % 5 == 0 else 0.1 for level in levels]
        drawn = [(line, each) for lines, each in zip(found, strong, strict=True) for line in lines]
        self._draw_lines([line for line, _ in drawn], "#ffffff", [each for _, each in drawn], 1.0)

    def _draw_streaks(self, camera: Camera) -> None:
        """Streaks that brighten in the direction of the flow, the longer the faster it is."""
        step = nice_step(camera.width / 8)  # they stand still while the camera moves
        reach = math.ceil(camera.width / step / 2) + 1
        x, y = (step * np.arange(round(at / step) - reach, round(at / step) + reach + 1) for at in camera[:2])
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        streak = self._flow(grid)[:, None] * (0.7 * step / max(self.span[1], 1e-12))
        lines = (grid @ [1, 1j])[:, None] + streak * np.linspace(-0.5, 0.5, 9)
        self._fade(camera.pixels(lines), INK, np.linspace(0, 0.6, 8), 1.5)

    def _draw_egg(self, camera: Camera, place: tuple[float, float], radius: float) -> None:
        """The egg, a halo around it and its yolk, each of the two many faint discs."""
        halo, yolk = np.linspace(1.7, 1.0, 15), np.linspace(0.75, 0.1, 12)
        across = 2 * radius * camera.scale * np.concatenate([halo, [1.0], yolk])
        colours = [(EGG, 0.016)] * len(halo) + [(EGG, 0.85)] + [(YOLK, 0.06)] * len(yolk)
        centre = camera.pixels(np.full(len(across), complex(*place)))
        self._draw_ellipses(centre, across, across, np.zeros(len(across)), facecolors=colours, linewidths=0)

    def _draw_bar(self) -> None:
        (top, bottom), (low, high) = BAR, self.span
        shades = self.colours(np.linspace(1, 0, bottom - top), bytes=True)
        self._show(np.repeat(shades[:, None], 16, axis=1), LEFT, top)
        for value in MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(low, high):
            if low <= value <= high and low < high:
                row = bottom - (bottom - top) * (value - low) / (high - low)
                self._draw(Line2D([LEFT + 16, LEFT + 22], [row, row], color=FAINT, linewidth=1))
                self._write(LEFT + 28, row, _signed(f"{value:g}"), va="center_baseline")

    def _flow(self, grid: np.ndarray) -> np.ndarray:
        def velocity(places: np.ndarray) -> np.ndarray:
            return np.asarray(self.world.flow.velocity(places), float) @ [1, 1j]

        return np.nan_to_num(in_domain(self.world, velocity, grid))

    # --- what moves ---

    def _draw_swimmers(
        self, camera: Camera, glance: Glance, trail: Sequence[Segment], clock: float, share: float
    ) -> None:
        """Fading trails, flagella that beat, and heads; `clock` counts decisions."""
        place, angle = glance.position, glance.angle
        if trail:
            oldest = len(trail) - 1 + share
            lines = camera.pixels(places_behind(trail, share, np.linspace(0, oldest, 8 * len(trail) + 1)))
            age = np.linspace(0, oldest, 2 * len(trail))
            fading = (1 - age / TRAIL) ** 1.5 * np.clip(0.25 + age / TAIL, 0, 1)  # less under the flagellum
            self._fade(lines, GOLD, 0.16 * fading, 6.0)
            self._fade(lines, GOLD, 0.85 * fading, 1.6)
            back = np.linspace(0, min(TAIL, oldest), 25)
            tail = places_behind(trail, share, back)
            phase = back / WAVE - BEAT * clock + 0.38 * np.arange(len(tail))[:, None]  # each its own
            bent = BEND * np.minimum(1, back / 0.5) * np.sin(2 * np.pi * phase)
            along = np.exp(1j * np.angle(np.gradient(tail, axis=1)))
            self._fade(camera.pixels(tail + 1j * along * bent), HEAD, np.linspace(1, 0.2, 12), 1.8)
            latest = trail[-1]
            place = np.where(latest.seen, latest.places(np.array([share]))[:, 0], place)
            angle = angle - np.where(latest.seen, (1 - share) * latest.turn, 0.0)
        first = np.argsort(~glance.finished, kind="stable")  # those at rest lie below
        length = np.full(len(first), 2 * min(max(0.11 * camera.scale, 4.0), 7.0))
        colours = np.where(glance.finished, RESTING, HEAD)[first]
        places, tilt = camera.pixels(place[first]), np.degrees(angle[first])
        rim = {"facecolors": colours, "edgecolors": SHADOW, "linewidths": 1.2}
        self._draw_ellipses(places, length, 0.62 * length, tilt, **rim)

    def _draw_numbers(self, curve: np.ndarray, finished: np.ndarray) -> None:
        """Time, gain, how many swim; mean gain over time between the least and the largest of all cells."""
        time, mean, least, largest = curve.T
        self._write(LEFT, 84, f"{time[-1]:.2f}", fontsize=27, weight="bold")
        self._write(LEFT, 162, _signed(f"{mean[-1]:+z.2f}"), fontsize=27, weight="bold", color=GOLD)
        self._write(LEFT, 366, f"{int((~finished).sum())} of {len(finished)}", fontsize=18)
        ends = min(float(least.min()), 0.0), max(float(largest.max()), 1e-9)
        x = np.interp(time, (0, max(time[-1], 1e-9)), (LEFT, RIGHT))
        zero, mean, least, largest = (np.interp(y, ends, CURVE[::-1]) for y in (0.0, mean, least, largest))
        self._draw(Line2D([LEFT, RIGHT], [zero, zero], color=FAINT, linewidth=0.6))
        band = np.stack([np.append(x, x[::-1]), np.append(largest, least[::-1])], axis=-1)
        self._draw(Polygon(band, color=GOLD, alpha=0.25, linewidth=0))
        self._draw(Line2D(x, mean, color=GOLD, linewidth=1.8))

    # --- how it is drawn: at once, by column and row ---

    def _draw(self, artist: Artist, **options: Any) -> None:
        artist.set(**{"figure": self.figure, "transform": PIXELS, **options})
        artist.draw(self.canvas.get_renderer())

    def _write(self, column: float, row: float, text: str, **options: Any) -> None:
        self._draw(Text(column, row, text, **options))

    def _show(self, image: np.ndarray, column: int, row: int) -> None:
        """An image (height, width, 4) uint8."""
        renderer = self.canvas.get_renderer()
        renderer.draw_image(renderer.new_gc(), column, SIZE - row - len(image), image[::-1])

    def _draw_ellipses(self, places: np.ndarray, *shape: np.ndarray, **colours: Any) -> None:
        """Ellipses at places (k, 2): lengths, widths [pixels] and angles [degrees, counter-clockwise]."""
        drawn = EllipseCollection(*shape, units="dots", offsets=places, offset_transform=PIXELS, **colours)
        self._draw(drawn, clip_box=SQUARE, transform=IdentityTransform())

    def _draw_lines(
        self, lines: Sequence[np.ndarray], colour: str, opacity: Sequence[float] | np.ndarray, width: float
    ) -> None:
        colours = [(*to_rgb(colour), each) for each in opacity]
        drawn = LineCollection(lines, colors=colours, linewidths=width, capstyle="butt", joinstyle="round")
        self._draw(drawn, clip_box=SQUARE)

    def _fade(self, lines: np.ndarray, colour: str, opacity: np.ndarray, width: float) -> None:
        """Lines (n, k, 2), cut across into as many parts as there are opacities; gaps where they are NaN."""
        ends = np.linspace(0, lines.shape[1] - 1, len(opacity) + 1).round().astype(int)
        gap = np.full((len(lines), 1, 2), np.nan)
        parts = [
            np.hstack([lines[:, first : last + 1], gap]).reshape(-1, 2) for first, last in pairwise(ends)
        ]
        self._draw_lines(parts, colour, opacity, width)


def places_behind(trail: Sequence[Segment], share: float, back: np.ndarray) -> np.ndarray:
    """Complex places (cells, k) where cells were `back` (k,) decisions ago, rising from 0."""
    age = np.ceil(back - share).astype(int).clip(0)  # segments that have been swum since
    return np.hstack(
        [segment.places(share + i - back[age == i]) for i, segment in enumerate(reversed(trail))]
    )


def _enlarged(values: np.ndarray) -> np.ndarray:
    """Values from 0 to 255 on the grid, smooth and rounded on the pixels of the square."""
    coarse = Image.fromarray(np.rint(values).astype(np.uint8))
    return np.asarray(coarse.resize((SIZE, SIZE), Image.Resampling.BICUBIC))


def nice_step(span: float) -> float:
    """1, 2 or 5 times a power of ten, not above `span`."""
    power = 10.0 ** math.floor(math.log10(span))
    return next(power * step for step in (5, 2, 1) if power * step <= span * (1 + 1e-9))


def _signed(number: str) -> str:
    return number.replace("-", "−")
