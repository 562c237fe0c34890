"""The panel beside a picture of a swarm: time, gain, how many swim, what the colours mean."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from swarm.figures import picture

MARGIN = 26  # [pixels]
COLOURS = (430, 690)  # first and last row of the colour bar


def write_panel(
    panel: np.ndarray,
    curve: Sequence[tuple[float, float, float, float]],
    finished: np.ndarray,
    shown: str,
    seen: tuple[float, float],
    colours: Sequence[str],
) -> None:
    """Write on the image `panel`.

    `curve` holds time and the mean, least and largest gain; `colours` run over the values `seen` of what is
    `shown`.
    """
    sheet = picture.Sheet(panel.shape[2], panel.shape[1])
    left, right = MARGIN, panel.shape[2] - MARGIN
    time, mean, *_ = curve[-1]
    sheet.text((left, 52), "time", 13, picture.FAINT)
    sheet.text((left, 84), f"{time:.2f}", 27, bold=True)
    sheet.text((left, 130), "mean gain", 13, picture.FAINT)
    sheet.text((left, 162), _signed(f"{mean:+.2f}"), 27, picture.TRAIL, bold=True)
    _draw_curve(sheet, np.array(curve), left, right, 190, 290)
    sheet.text((left, 340), "swimming", 13, picture.FAINT)
    sheet.text((left, 366), f"{int((~finished).sum())} of {len(finished)}", 18)
    top, bottom = COLOURS
    shades = picture.palette(colours)[np.linspace(255, 0, bottom - top).astype(int)]
    panel[:, top:bottom, left : left + 16] = shades.T[..., None]
    sheet.text((left, top - 14), shown, 13, picture.FAINT)
    _label_colours(sheet, left + 16, top, bottom, *seen)
    sheet.lay_on(panel)


def _draw_curve(
    sheet: picture.Sheet, curve: np.ndarray, left: float, right: float, top: float, bottom: float
) -> None:
    """Mean gain over time, between the least and the largest of all cells."""
    time, mean, least, largest = curve.T
    low, high = min(least.min(), 0.0), max(largest.max(), 1e-9)
    x = left + (right - left) * time / max(time[-1], 1e-9)

    def line(values: np.ndarray) -> np.ndarray:
        return np.stack([x, bottom - (bottom - top) * (values - low) / (high - low)], axis=-1)

    zero = line(np.zeros_like(time))[0, 1]
    sheet.line(np.array([(left, zero), (right, zero)]), picture.FAINT, 0.6)
    if len(time) > 1:
        sheet.area(np.concatenate([line(largest), line(least)[::-1]]), picture.TRAIL, 0.25)
        sheet.line(line(mean), picture.TRAIL, 1.8)


def _label_colours(
    sheet: picture.Sheet, left: float, top: float, bottom: float, low: float, high: float
) -> None:
    if high <= low:
        return
    step = picture.nice_step((high - low) / 3)
    for value in np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1) * step:
        y = bottom - (bottom - top) * (value - low) / (high - low)
        sheet.line(np.array([(left, y), (left + 6, y)]), picture.FAINT, 1.0)
        sheet.text((left + 12, y), _signed(f"{value:g}"), 12, anchor="lm")


def _signed(number: str) -> str:
    return number.replace("-", "−")
