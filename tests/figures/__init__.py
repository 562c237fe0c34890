"""What tests of figures share: a style that none may take over, crowds that are seen, pages in a browser."""

import json
import re
import shutil
import subprocess
from itertools import islice

import pytest

import swarm
from swarm.figures.viewer import Viewer
from swarm.physics.starts import draw_starts
from swarm.population.rollout import rollout

HOSTILE = {  # of a user's matplotlibrc
    **dict.fromkeys(
        ("text.usetex", "savefig.transparent", "axes.grid", "figure.constrained_layout.use"), True
    ),
    **dict.fromkeys(("lines.antialiased", "axes.unicode_minus", "axes.spines.left"), False),
    **dict.fromkeys(("axes.facecolor", "figure.facecolor", "savefig.facecolor", "text.color"), "red"),
    **dict.fromkeys(("savefig.dpi", "figure.dpi", "font.size", "lines.linewidth"), 30),
    "font.family": "monospace",
    "image.interpolation": "nearest",
    "path.sketch": (3, 30, 5),
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
}
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--enable-unsafe-swiftshader"]
FLAGS += ["--allow-file-access-from-files"]
in_a_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")


def seen(world, *, teams=None, cells=8, decisions=None):
    """The viewer of a greedy crowd after some decisions, by default all, and the state then."""
    viewer = Viewer(world, teams=teams)
    moments = rollout(world, swarm.Greedy(), draw_starts(world, cells, 1), 1)
    for moment in islice(moments, decisions):
        viewer.follow(moment.state)
    return viewer, moment.state


def data_of(text):
    """What a page holds."""
    return json.loads(re.search(r"const data = (.*);\n", text)[1])


def probed(path, code):
    """The page with a script of ours at its end."""
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("</body>", f"<script>{code}</script></body>"), encoding="utf-8")


def opened(path, fragment, profile, *flags):
    """The document after the browser has run it for six seconds of its own time."""
    virtual = ["--virtual-time-budget=6000", "--window-size=900,700", "--dump-dom"]
    command = [CHROMIUM, *FLAGS, *virtual, *flags, f"--user-data-dir={profile}", f"{path.as_uri()}{fragment}"]
    return subprocess.run(command, capture_output=True, text=True, timeout=120).stdout
