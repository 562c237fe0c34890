"""Pictures, films and pages show what cells do to the world that they share."""

import json
import re

import numpy as np
import pytest

import swarm
from swarm.figures.page import page
from swarm.figures.scene import SIZE, Teams, concentration_at
from swarm.figures.style import LOOKS, team_colours
from swarm.figures.viewer import Viewer
from swarm.figures.watch import watch
from swarm.physics.starts import draw_starts
from swarm.population.contest import population_test
from swarm.population.results import load_population, save_population
from swarm.population.rollout import rollout

MEDIUM = {"box": ((-5, 15), (-5, 15)), "shape": (160, 160), "uptake": 0.05}
EATING = swarm.World(medium=swarm.Medium(**MEDIUM), start_box=((4, 6), (4, 6)), life=6.0)
RACE = swarm.World(field="radial", first_arrivals=2, start_box=((-3, 3), (-3, 3)), life=40.0)


def seen(world, teams=None, cells=8):
    """The viewer and the state at the end of all lives."""
    viewer = Viewer(world, teams=teams)
    for moment in rollout(world, swarm.Greedy(), draw_starts(world, cells, 1), 1):
        viewer.follow(moment.state)
    return viewer, moment.state


@pytest.mark.parametrize("leaving", ["truncate", "follow", "wrap"])
def test_water_is_darker_where_it_was_eaten(leaving):
    world = EATING.replace(medium=swarm.Medium(**MEDIUM, leaving=leaving))
    viewer, state = seen(world)
    left, places = world.field.concentration(state.position), np.asarray(state.position)
    np.testing.assert_allclose(concentration_at(world, 6.0, places, state.medium), world.concentration(state))
    assert (world.concentration(state) < left).all()
    brightness = []
    for held in (state.medium, None):
        viewer.scene.seen, viewer.glance = None, viewer.glance._replace(medium=held)
        brightness.append(viewer.picture()[:, :SIZE].astype(float).mean())
    assert brightness[0] < brightness[1] - 0.5


def test_water_is_that_of_the_present_time():
    world = swarm.World(flow="oscillating_taylor_green", life=4.0)
    viewer, _ = seen(world)
    now = viewer.picture()
    viewer.glance = viewer.glance._replace(time=viewer.glance.time - 1.3)
    assert not np.array_equal(viewer.picture()[:, :SIZE], now[:, :SIZE])


def test_who_has_won_sits_at_the_egg_and_the_egg_is_closed():
    viewer, _ = seen(RACE)
    assert viewer.glance.won.sum() == 2
    assert viewer.glance.closed
    (x, y), radius = RACE.egg
    away = viewer.glance.position[viewer.glance.won] - complex(x, y)
    image = viewer.picture()
    for place in complex(x, y) + radius * away / np.abs(away):
        column, row = viewer.camera.pixels(np.array(place)).round().astype(int)
        red, _, blue = image[row, column].astype(int)
        assert red - blue > 100  # gold
    viewer.scene.seen, viewer.glance = None, viewer.glance._replace(closed=False)
    assert not np.array_equal(viewer.picture()[:, :SIZE], image[:, :SIZE])


def test_policies_of_one_world_have_colours_of_their_own():
    names = ["greedy", "zoo:a", "zoo:b", "zoo:c", "ppo"]
    assert len(set(team_colours(names))) == len(names)
    assert team_colours(["swinging", "greedy"]) == [LOOKS["swinging"].colour, LOOKS["greedy"].colour]
    plain, teamed = (
        seen(RACE, teams)[0].picture() for teams in (None, Teams(["greedy", "random"], np.arange(8) % 2))
    )
    assert not np.array_equal(plain[:, :SIZE], teamed[:, :SIZE])
    assert not np.array_equal(plain[400:450, SIZE:], teamed[400:450, SIZE:])  # the legend


def data_of(text):
    return json.loads(re.search(r"const data = (.*);\n", text)[1])


def test_a_page_holds_frames_of_the_medium_and_stays_small(tmp_path):
    medium = swarm.Medium(shape=(80, 70), uptake=0.02, leaving="wrap")
    world = EATING.replace(medium=medium)
    results = population_test(world, {"swinging": swarm.Swinging()}, cells=40, life=80.0, limit=False)
    save_population(results, tmp_path / "population.nc")
    assert load_population(tmp_path / "population.nc").identical(results)
    assert results["medium"].sizes["x"] <= 64
    text = page(results)
    assert len(text) < 3e6
    films = data_of(text)["background"]["layers"][0]["films"]
    assert len(films) == 2
    assert all(10 < len(film["times"]) <= 48 and film["times"][-1] == 80.0 for film in films)
    assert (np.diff(results["eaten"].values, axis=-1) >= 0).all()


@pytest.mark.parametrize("out", ["race.html", "race.gif"])
def test_a_contest_is_watched(tmp_path, out):
    watch("greedy", RACE, against="random", share=0.25, cells=8, out=tmp_path / out)
    if out.endswith("html"):
        data = data_of((tmp_path / out).read_text(encoding="utf-8"))
        assert data["teams"]["names"] == ["greedy", "random"]
        assert data["teams"]["cells"].count(0) == 2
        assert sum(data["policies"][0]["won"]) == data["needed"] == 2


def test_a_share_without_a_rival_is_refused(tmp_path):
    with pytest.raises(ValueError, match="share must come with against"):
        watch("greedy", RACE, share=0.5, out=tmp_path / "race.gif")
