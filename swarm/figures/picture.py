"""Drawing in memory, without a display: colours of a field, lines that fade, ellipses, text.

An image is (3, height, width) float32 in [0, 1], red, green and blue, with the first row on top; places on it
are in pixels.
"""

from __future__ import annotations

import functools
import importlib.util
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

INK = (0.93, 0.95, 0.97)
FAINT = (0.58, 0.65, 0.72)
PAPER = (0.035, 0.047, 0.078)
TRAIL = (1.0, 0.80, 0.42)
EGG = (0.98, 0.86, 0.74)
YOLK = (0.86, 0.62, 0.50)
RESTING = (0.60, 0.66, 0.74)
SEA = ("#0b1330", "#10315c", "#145374", "#1f7a83", "#3fa38a")  # of concentrations: low to high
PLUM = ("#0d0f26", "#1f2250", "#38306f", "#57397b", "#7a4681")  # of flow speeds: still to fast


@functools.cache
def palette(colours: Sequence[str]) -> np.ndarray:
    """256 colours (256, 3) that run through the given ones."""
    given = np.array([[int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)] for colour in colours])
    at = np.linspace(0, len(given) - 1, 256)
    return np.stack([np.interp(at, np.arange(len(given)), part) for part in given.T], axis=-1).astype(
        np.float32
    )


def enlarged(values: np.ndarray, size: int) -> np.ndarray:
    """Values on a coarse grid as smooth values (size, size)."""
    return np.asarray(
        Image.fromarray(values.astype(np.float32)).resize((size, size), Image.Resampling.BICUBIC)
    )


def coloured(values: np.ndarray, low: float, high: float, colours: Sequence[str]) -> np.ndarray:
    """The image of values between `low` and `high`."""
    share = (values - low) * (255 / max(high - low, 1e-12))
    return np.take(palette(colours).T, np.clip(share, 0, 255).astype(np.uint8), axis=1)


def lay(image: np.ndarray, colour: Sequence[float], coverage: np.ndarray) -> None:
    """Paint over `image` with a colour, as opaque as `coverage` (height, width) in [0, 1] says."""
    for channel, part in zip(image, colour, strict=True):
        channel += coverage * (np.float32(part) - channel)


def nice_step(span: float) -> float:
    """1, 2 or 5 times a power of ten, not above `span`."""
    power = 10.0 ** math.floor(math.log10(span))
    return next(power * step for step in (5, 2, 1) if power * step <= span * (1 + 1e-9))


def contours(values: np.ndarray, step: float) -> np.ndarray:
    """Coverage of thin lines where values are whole multiples of `step`, every fifth one stronger."""
    level = values / np.float32(step)
    slope = np.hypot(*np.gradient(level))
    nearest = np.round(level)
    near = np.clip(1 - np.abs(level - nearest) / np.maximum(slope, np.float32(1e-9)), 0, 1)
    strength = np.float32(0.09) + np.float32(0.13) * (nearest % 5 == 0)
    return near * strength * (slope < 0.5)


def strokes(places: np.ndarray, weights: np.ndarray, size: int) -> np.ndarray:
    """Coverage (size, size) of lines given as close dots (dots, 2), each with a weight in [0, 1]."""
    inside = ((places > 1) & (places < size - 2)).all(axis=-1)
    places, weights = places[inside], weights[inside]
    corner = np.floor(places).astype(np.int64)
    right, down = (places - corner).T
    index = corner[:, 1] * size + corner[:, 0]
    around = np.concatenate([index, index + 1, index + size, index + size + 1])
    shares = [(1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down]
    density = np.bincount(around, np.concatenate(shares) * np.tile(weights, 4), minlength=size * size)
    coverage = density.astype(np.float32).reshape(size, size)
    for axis in (0, 1):  # two pixels wide
        coverage = 0.5 * coverage + 0.25 * (np.roll(coverage, 1, axis) + np.roll(coverage, -1, axis))
    return 1 - np.exp(-1.6 * coverage)


def ellipses(places: np.ndarray, angles: np.ndarray, length: float, width: float, size: int) -> np.ndarray:
    """Coverage (size, size) of ellipses at places (k, 2) tilted by `angles` [rad, clockwise]."""
    reach = math.ceil(max(length, width)) + 2
    steps = np.arange(-reach, reach + 1)
    corner = np.round(places).astype(np.int64)
    columns = corner[:, 0, None, None] + steps[None, None, :]
    rows = corner[:, 1, None, None] + steps[None, :, None]
    across, down = columns - places[:, 0, None, None], rows - places[:, 1, None, None]
    cosine, sine = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    ahead, aside = (across * cosine + down * sine) / length, (down * cosine - across * sine) / width
    distance = (np.hypot(ahead, aside) - 1) * min(length, width)
    coverage = np.zeros((size, size), np.float32)
    columns, rows = np.broadcast_arrays(columns, rows)
    inside = (columns >= 0) & (columns < size) & (rows >= 0) & (rows < size)
    np.maximum.at(coverage, (rows[inside], columns[inside]), np.clip(0.5 - distance, 0, 1)[inside])
    return coverage


def disc(centre: np.ndarray, radius: float, size: int, *, softness: float = 1.0) -> np.ndarray:
    """Coverage (size, size) of a disc whose edge fades over `softness` pixels."""
    rows, columns = np.ogrid[:size, :size]
    distance = np.hypot(columns - centre[0], rows - centre[1])
    return np.clip(0.5 - (distance - radius) / softness, 0, 1).astype(np.float32)


@functools.cache
def font(size: int, *, bold: bool = False) -> Any:
    """A typeface with Greek letters: the one that Matplotlib brings along."""
    found = importlib.util.find_spec("matplotlib")
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    if found is not None and found.origin is not None:
        path = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf" / name
        if path.exists():
            return ImageFont.truetype(str(path), size)
    return ImageFont.load_default(size)


class Sheet:
    """Text and lines on an image, drawn twice as large and then made smaller so that edges are smooth."""

    scale = 2

    def __init__(self, width: int, height: int) -> None:
        self.size = (width, height)
        self.layer = Image.new("RGBA", (width * self.scale, height * self.scale), (0, 0, 0, 0))
        self.pen = ImageDraw.Draw(self.layer)

    def text(
        self,
        place: Sequence[float],
        text: str,
        size: int,
        colour: Sequence[float] = INK,
        *,
        bold: bool = False,
        anchor: str = "ls",
    ) -> None:
        """Text whose `anchor` (see Pillow) is at `place`."""
        at = (place[0] * self.scale, place[1] * self.scale)
        self.pen.text(at, text, font=font(size * self.scale, bold=bold), fill=_rgba(colour), anchor=anchor)

    def line(self, places: np.ndarray, colour: Sequence[float], width: float = 1.5) -> None:
        """A line through places (k, 2)."""
        points = [(float(x) * self.scale, float(y) * self.scale) for x, y in places]
        self.pen.line(points, fill=_rgba(colour), width=round(width * self.scale), joint="curve")

    def area(self, places: np.ndarray, colour: Sequence[float], opacity: float) -> None:
        """A polygon with corners (k, 2)."""
        points = [(float(x) * self.scale, float(y) * self.scale) for x, y in places]
        self.pen.polygon(points, fill=_rgba(colour, opacity))

    def lay_on(self, image: np.ndarray) -> None:
        """Paint all of it onto `image`."""
        layer = np.asarray(self.layer.resize(self.size, Image.Resampling.BOX), np.float32) / 255
        opacity = layer[..., 3]
        for channel, part in zip(image, np.moveaxis(layer[..., :3], -1, 0), strict=True):
            channel += opacity * (part - channel)


def _rgba(colour: Sequence[float], opacity: float = 1.0) -> tuple[int, ...]:
    return tuple(round(255 * part) for part in (*colour, opacity))
