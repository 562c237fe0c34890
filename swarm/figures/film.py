"""Films: pictures of a swarm -> an animated GIF that stays small, or a sharp video."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from swarm._support.checks import check_count, check_installed
from swarm.figures.scene import SIZE

SMALLEST = 90  # height [pixels]
COLOURS = 96  # of a GIF; few, and never dithered, which keeps it small


class Form(NamedTuple):
    """How a kind of film is made."""

    height: int  # unless another is asked for [pixels]
    fps: int
    frames: int  # pictures of a decision


FORMS = {".gif": Form(360, 12, 1), ".mp4": Form(SIZE, 24, 2)}


def check_film(suffix: str, size: int | None) -> int:
    """The height of a film in pixels; raises ValueError for a `size` that cannot be drawn, and
    ModuleNotFoundError where the package that encodes such films is missing.
    """
    if suffix != ".gif":
        check_installed("a film other than .gif needs", "imageio_ffmpeg", extra="video")
    height = FORMS[suffix].height if size is None else check_count("size", size, at_least=SMALLEST)
    if height > SIZE:
        raise ValueError(f"size must be at most {SIZE} pixels, in which swarms are drawn, got {size}")
    return height


def write_film(path: Path, suffix: str, pictures: Iterator[np.ndarray], height: int) -> None:
    """Encode pictures (height, width, 3) uint8, reduced to `height`."""
    images = (Image.fromarray(picture) for picture in pictures)
    sizes = ((image, (round(image.width * height / image.height), height)) for image in images)
    reduced = (image.resize(size, Image.Resampling.LANCZOS) for image, size in sizes)
    if suffix == ".gif":
        _write_gif(path, reduced)
    else:
        _write_video(path, suffix, reduced)


def _write_gif(path: Path, images: Iterator[Image.Image]) -> None:
    """One palette for all pictures; until it is known they wait compressed."""
    first = next(images)
    packed = [zlib.compress(first.tobytes(), 1), *(zlib.compress(each.tobytes(), 1) for each in images)]

    def opened(data: bytes) -> Image.Image:
        return Image.frombytes("RGB", first.size, zlib.decompress(data))

    some = np.concatenate([np.asarray(opened(data)) for data in packed[:: max(1, len(packed) // 8)]])
    palette = Image.fromarray(some).quantize(COLOURS, Image.Quantize.FASTOCTREE)
    frames = (opened(data).quantize(palette=palette, dither=Image.Dither.NONE) for data in packed)
    duration = round(1000 / FORMS[".gif"].fps)
    next(frames).save(path, "GIF", save_all=True, append_images=frames, duration=duration, loop=0)


def _write_video(path: Path, suffix: str, images: Iterator[Image.Image]) -> None:
    """Encode by imageio, which tells kinds of film by their endings."""
    import imageio.v2 as imageio

    named = path.with_name(path.name + suffix)
    try:
        with imageio.get_writer(named, fps=FORMS[suffix].fps, macro_block_size=2, quality=8) as writer:
            for image in images:
                writer.append_data(np.asarray(image))  # type: ignore[attr-defined]
        named.replace(path)
    finally:
        named.unlink(missing_ok=True)
