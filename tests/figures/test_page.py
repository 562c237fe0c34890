"""The page of a population: self-contained, safe to open, and it plays in a browser."""

import re
import shutil
import subprocess

import pytest

from swarm.figures.page import page, save_page
from swarm.physics.world import World
from swarm.policies.strategies import Greedy, Swinging
from swarm.population.contest import population_test

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--window-size=900,700"]
FLAGS += ["--virtual-time-budget=6000", "--dump-dom"]


@pytest.fixture(scope="module")
def results():
    contest = {"greedy": Greedy(), "swinging": Swinging()}
    return population_test(World(), contest, cells=5, life=12.0, seed=1, limit=False)


def opened(path, fragment, profile):
    """The document after the browser has run it for six seconds of its own time."""
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", f"{path.as_uri()}{fragment}"]
    return subprocess.run(command, capture_output=True, text=True, timeout=120).stdout


def test_a_page_loads_nothing_from_elsewhere(results):
    text = page(results)
    assert not re.search(r"https?://|src=|@import|url\(", text)


def test_a_page_without_time_series_is_refused():
    bare = population_test(World(), {}, cells=2, life=8.0, record=False, limit=False)
    with pytest.raises(ValueError, match="time series"):
        page(bare)


def test_a_title_cannot_end_the_script(results):
    text = page(results, title="</script><script>alert(1)</script>")
    assert text.count("<script>") == 1


def test_as_many_cells_as_asked_for_are_shown(results):
    assert '"shape": [2, ' in page(results, cells=2)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_a_browser_shows_time_and_gain(results, tmp_path):
    save_page(results, tmp_path / "page.html", title="Twelve")
    dom = opened(tmp_path / "page.html", "#t=12", tmp_path / "profile")
    assert "<title>Twelve</title>" in dom
    assert "t = 12.0 of 12" in dom
    mean = float(results["gain"].sel(policy="greedy").mean())
    assert f"mean gain {mean:.2f}" in dom


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_a_page_plays_in_a_browser(results, tmp_path):
    save_page(results, tmp_path / "page.html")
    for attempt in range(4):  # a busy machine may get no second frame drawn in time
        dom = opened(tmp_path / "page.html", "#play=1", tmp_path / f"profile{attempt}")
        clock = re.search(r"t = ([\d.]+) of 12", dom)
        assert clock is not None
        if float(clock.group(1)) > 0:
            return
    pytest.fail("the clock of the page stands still")
