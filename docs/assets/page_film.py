"""The moving picture of the page that the README opens with: a page -> docs/images/page.gif, by Chromium.

make docs/assets/crowd.html && python docs/assets/page_film.py
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

DOCS = Path(__file__).parents[1]
SIZE, FRAMES, MILLISECONDS, COLOURS = (1040, 600), 60, 100, 160
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-unsafe-swiftshader"]
FLAGS += ["--virtual-time-budget=2500", f"--window-size={SIZE[0]},{SIZE[1]}"]


def picture(page: Path, time: float, folder: Path) -> Image.Image:
    """The page at a time, in a frame, which the browser does not resize while it draws."""
    frame, shot = folder / "frame.html", folder / "shot.png"
    style = f"border:0;position:fixed;left:0;top:0;width:{SIZE[0]}px;height:{SIZE[1]}px"
    source = f"{page.resolve().as_uri()}#t={time:.3f}&theme=dark&view=whole"
    frame.write_text(f"<iframe style='{style}' src='{source}'></iframe>", encoding="utf-8")
    browser = shutil.which("chromium") or "google-chrome"
    command = [browser, *FLAGS, f"--user-data-dir={folder}", f"--screenshot={shot}", frame.as_uri()]
    subprocess.run(command, check=True, capture_output=True)
    return Image.open(shot).convert("RGB")


def main(
    page: str = f"{DOCS}/assets/crowd.html", life: str = "30", out: str = f"{DOCS}/images/page.gif"
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        times = np.linspace(0, float(life), FRAMES + 1)[1:]
        pictures = [picture(Path(page), time, Path(folder)).resize((832, 480)) for time in times]
    some = Image.fromarray(np.concatenate([np.asarray(each) for each in pictures[::12]]))
    palette = some.quantize(COLOURS, Image.Quantize.FASTOCTREE)
    first, *others = (each.quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures)
    first.save(out, save_all=True, append_images=others, duration=MILLISECONDS, loop=0)


if __name__ == "__main__":
    main(*sys.argv[1:])
