"""The easel: pictures of one size, drawn at once by column and row of their pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Affine2D, Bbox, IdentityTransform

SIZE = 720  # of the square that shows the world [pixels]
PANEL = 240  # width of the panel beside it [pixels]
LEFT, RIGHT = SIZE + 26, SIZE + PANEL - 26  # columns between which the panel is filled
INK, FAINT, PAPER = "#edf2f7", "#94a6b8", "#090c14"
DARK = {"figure.dpi": 72, "text.color": INK, "font.size": 12}  # a point is a pixel

PIXELS = Affine2D().scale(1, -1).translate(0.5, SIZE - 0.5)  # Agg's place of a pixel's column and row
SQUARE = Bbox(((0, 0), (SIZE, SIZE)))


class Easel:
    """What is drawn on; to be made and used within the style `DARK`."""

    def __init__(self) -> None:
        self.figure = Figure(figsize=((SIZE + PANEL) / 72, SIZE / 72), facecolor=PAPER)
        self.canvas = FigureCanvasAgg(self.figure)
        self.canvas.draw()

    def kept(self) -> Any:
        """What is drawn so far, to come back to by `restore`."""
        return self.canvas.copy_from_bbox(self.figure.bbox)

    def restore(self, kept: Any) -> None:
        """Begin again with what was kept."""
        self.canvas.restore_region(kept)

    def image(self) -> np.ndarray:
        """The picture (720, 960, 3) uint8."""
        return np.ascontiguousarray(np.asarray(self.canvas.buffer_rgba())[..., :3])

    def draw(self, artist: Artist, **options: Any) -> None:
        artist.set(**{"figure": self.figure, "transform": PIXELS, **options})
        artist.draw(self.canvas.get_renderer())

    def write(self, column: float, row: float, text: str, **options: Any) -> None:
        self.draw(Text(column, row, text, **options))

    def show(self, image: np.ndarray, column: int, row: int) -> None:
        """An image (height, width, 4) uint8."""
        renderer = self.canvas.get_renderer()
        renderer.draw_image(renderer.new_gc(), column, SIZE - row - len(image), image[::-1])

    def ellipses(self, places: np.ndarray, *shape: np.ndarray, **colours: Any) -> None:
        """Ellipses at places (k, 2): lengths, widths [pixels] and angles [degrees, counter-clockwise]."""
        drawn = EllipseCollection(*shape, units="dots", offsets=places, offset_transform=PIXELS, **colours)
        self.draw(drawn, clip_box=SQUARE, transform=IdentityTransform())

    def lines(self, lines: Sequence[np.ndarray], colour: str, opacity: Any, width: float) -> None:
        """Lines (k, 2), each of its opacity."""
        colours = [(*to_rgb(colour), each) for each in opacity]
        drawn = LineCollection(lines, colors=colours, linewidths=width, capstyle="butt", joinstyle="round")
        self.draw(drawn, clip_box=SQUARE)

    def fade(self, lines: np.ndarray, colour: str, opacity: np.ndarray, width: float) -> None:
        """Lines (n, k, 2), cut across into as many parts as there are opacities; gaps where they are NaN."""
        ends = np.linspace(0, lines.shape[1] - 1, len(opacity) + 1).round().astype(int)
        gap = np.full((len(lines), 1, 2), np.nan)
        parts = [
            np.hstack([lines[:, first : last + 1], gap]).reshape(-1, 2) for first, last in pairwise(ends)
        ]
        self.lines(parts, colour, opacity, width)


def nice_step(span: float) -> float:
    """1, 2 or 5 times a power of ten, not above `span`."""
    power = 10.0 ** math.floor(math.log10(span))
    return next(power * step for step in (5, 2, 1) if power * step <= span * (1 + 1e-9))


def signed(number: str) -> str:
    """A number with a proper minus."""
    return number.replace("-", "−")
