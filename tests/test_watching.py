"""Watching a policy: films and pages are written whole or not at all."""

from __future__ import annotations

import imageio.v2 as imageio
import numpy as np
import pytest

from swarm.population import population_test
from swarm.strategies import Greedy, Random
from swarm.world import World
from trainers.watching import FRAMES, check_target, states, watch


def test_a_film_shows_every_decision(tmp_path):
    world = World(life=2.0)
    watch("greedy", world, cells=3, out=tmp_path / "swim.gif")
    film = imageio.mimread(tmp_path / "swim.gif", memtest=False)
    assert len(film) == 1 + FRAMES * world.max_decisions
    assert list(tmp_path.iterdir()) == [tmp_path / "swim.gif"]


def test_a_page_shows_the_policy(tmp_path):
    watch("swinging", World(life=2.0), cells=3, out=tmp_path / "swim.html")
    assert '"name": "swinging"' in (tmp_path / "swim.html").read_text(encoding="utf-8")


def test_a_life_is_followed_to_its_end_with_noise():
    world = World(life=30.0, concentration_noise=0.1)
    seen = list(states(world, Greedy(), 3, 0))
    assert len(seen) == world.max_decisions + 1
    assert seen[-1].finished.all()


def test_a_watched_life_is_the_tested_one():
    world = World(life=30.0, concentration_noise=0.1, curvature_noise=0.1)
    last = list(states(world, Random(), 5, 3))[-1]
    gain = world.field.concentration(last.position) - last.start_concentration
    tested = population_test(world, {"random": Random()}, cells=5, life=30.0, seed=3, record=False)
    np.testing.assert_array_equal(gain, tested["gain"].sel(policy="random"))


def test_other_endings_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"out must end in .*swim.avi"):
        check_target(tmp_path / "swim.avi")


def test_what_is_there_is_not_overwritten(tmp_path):
    (tmp_path / "swim.gif").write_text("mine")
    with pytest.raises(FileExistsError, match="must be a new file"):
        watch("greedy", World(life=2.0), out=tmp_path / "swim.gif")
    assert (tmp_path / "swim.gif").read_text() == "mine"


def test_nothing_is_left_of_a_film_that_fails(tmp_path, monkeypatch):
    monkeypatch.setattr("swarm.render.Viewer.picture", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        watch("greedy", World(life=2.0), out=tmp_path / "swim.gif")
    assert list(tmp_path.iterdir()) == []
