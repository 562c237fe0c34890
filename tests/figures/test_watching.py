"""Watching a policy: films and pages are written whole or not at all."""

import subprocess
import sys
from importlib.util import find_spec

import imageio.v2 as imageio
import numpy as np
import pytest
from imageio_ffmpeg import get_ffmpeg_exe

from swarm.figures.film import COLOURS, FORMS
from swarm.figures.page import page
from swarm.figures.watch import check_target, save_page_of, watch
from swarm.physics.world import World
from swarm.policies.strategies import Swinging
from swarm.population.contest import population_test
from swarm.population.results import save_population

SHORT = World(life=1.0)


def film_of(path, height):
    """The pictures (pictures, height, width, 3) of a film that is `height` pixels high."""
    if path.suffix == ".gif":
        return np.stack(imageio.mimread(path, memtest=False, mode="RGB"))
    command = [get_ffmpeg_exe(), "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    data = subprocess.run(command, capture_output=True, check=True).stdout
    return np.frombuffer(data, np.uint8).reshape(-1, height, height * 4 // 3, 3)


@pytest.mark.parametrize(("suffix", "size"), [(".gif", None), (".mp4", None), (".gif", 90), (".mp4", 150)])
def test_a_film_shows_every_decision_in_the_size_that_is_asked_for(tmp_path, suffix, size):
    path, form = tmp_path / f"swim{suffix}", FORMS[suffix]
    world = World.in_space(life=0.1) if size == 90 else SHORT
    watch("greedy", world, cells=2, out=path, size=size)
    height = size or form.height
    assert film_of(path, height).shape == (1 + form.frames * world.max_decisions, height, height * 4 // 3, 3)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_a_gif_of_ten_time_units_is_small_and_keeps_its_colours(tmp_path):
    path = tmp_path / "swim.gif"
    watch("greedy", World(life=10.0), out=path)
    assert path.stat().st_size < 1e6
    colours = np.unique(film_of(path, 360)[::10].reshape(-1, 3), axis=0)
    assert 0.5 * COLOURS < len(colours) <= COLOURS
    assert colours.min(axis=1).max() > 240  # white heads
    assert (colours[:, 0].astype(int) - colours[:, 2]).max() > 100  # yellow trails


def test_a_page_shows_the_policy(tmp_path):
    watch("swinging", SHORT, cells=3, out=tmp_path / "swim.html")
    assert '"name": "swinging"' in (tmp_path / "swim.html").read_text(encoding="utf-8")


def test_a_stored_population_becomes_the_same_page_and_no_film_or_window(tmp_path):
    stored, out = tmp_path / "population.nc", tmp_path / "swim.html"
    results = population_test(World(), {"swinging": Swinging()}, cells=3, life=4.0, limit=False)
    save_population(results, stored)
    save_page_of(stored, out, cells=2)
    expected = page(results, title=f"{tmp_path.name}/population.nc", cells=2)
    assert out.read_text(encoding="utf-8") == expected
    for other in (None, tmp_path / "swim.gif"):
        with pytest.raises(ValueError, match=r"watched on a page: out must end in .html, got"):
            save_page_of(stored, other)


@pytest.mark.parametrize(
    ("out", "size", "message"),
    [
        *(("swim.gif", size, rf"size must be .* (90|720).*, got {size}") for size in (89, 721, 0, -1)),
        (None, 300, r"size must come with a film, .*\.gif.*, got 300"),
        ("swim.html", 300, r"size must come with a film, .*\.gif.*, got 300"),
        ("swim.avi", None, r"out must end in .*swim.avi"),
        ("none/swim.gif", None, "the folder of .* must be there"),
    ],
)
def test_a_target_that_cannot_be_is_refused_before_anything_is_drawn(tmp_path, out, size, message):
    with pytest.raises((ValueError, OSError), match=message):
        watch("nobody", SHORT, out=out and tmp_path / out, size=size)


def test_a_video_without_its_encoder_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ModuleNotFoundError, match=r"than .gif needs .*: pip install 'chemoswarm\[video\]'"):
        check_target(tmp_path / "swim.mp4")
    check_target(tmp_path / "swim.gif")


def test_what_is_there_is_not_overwritten(tmp_path):
    (tmp_path / "swim.gif").write_text("mine")
    with pytest.raises(FileExistsError, match="must be a new file"):
        watch("greedy", SHORT, out=tmp_path / "swim.gif")
    assert (tmp_path / "swim.gif").read_text() == "mine"


@pytest.mark.skipif(find_spec("pygame") is None, reason="a window needs pygame, which is not installed")
def test_without_a_display_nobody_plays_to_an_empty_room(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with pytest.raises(OSError, match=r"a window needs a display.*--out FILE makes a film or a page"):
        watch("greedy", SHORT)


def test_nothing_is_left_of_a_film_that_fails(tmp_path, monkeypatch):
    monkeypatch.setattr("swarm.figures.viewer.Viewer.picture", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        watch("greedy", SHORT, out=tmp_path / "swim.gif")
    assert list(tmp_path.iterdir()) == []
