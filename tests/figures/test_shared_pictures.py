"""Pictures, films and pages show what cells do to the world that they share."""

import re

import numpy as np
import pytest

import swarm
from swarm.figures.page import page, save_page
from swarm.figures.scene import SIZE, Camera, Glance, Scene, Teams, concentration_at
from swarm.figures.style import LOOKS, team_colours
from swarm.figures.watch import watch
from swarm.population.contest import population_test
from swarm.population.results import load_population, save_population
from tests.figures import data_of, in_a_browser, opened, probed, seen

MEDIUM = {"box": ((-5, 15), (-5, 15)), "shape": (160, 160), "uptake": 0.05}
EATING = swarm.World(medium=swarm.Medium(**MEDIUM), start_box=((4, 6), (4, 6)), life=6.0)
RACE = swarm.World(field="radial", first_arrivals=2, start_box=((-3, 3), (-3, 3)), life=40.0)


def square(viewer, **other):
    """The picture of a glance of which something is other than it was."""
    viewer.scene.seen, viewer.glance = None, viewer.glance._replace(**other)
    return viewer.picture()[:, :SIZE].astype(int)


@pytest.mark.parametrize("leaving", ["truncate", "follow", "wrap"])
def test_water_is_darker_where_it_was_eaten(leaving):
    world = EATING.replace(medium=swarm.Medium(**MEDIUM, leaving=leaving))
    viewer, state = seen(world)
    left, places = world.field.concentration(state.position), np.asarray(state.position)
    np.testing.assert_allclose(concentration_at(world, 6.0, places, state.medium), world.concentration(state))
    assert (world.concentration(state) < left).all()
    assert square(viewer).mean() < square(viewer, medium=None).mean() - 0.5


def test_water_is_that_of_the_present_time():
    viewer, _ = seen(swarm.World(flow="oscillating_taylor_green", life=4.0))
    assert not np.array_equal(square(viewer), square(viewer, time=viewer.glance.time - 1.3))


def test_who_has_won_sits_at_the_egg_and_the_egg_is_closed():
    viewer, _ = seen(RACE)
    assert viewer.glance.won.sum() == 2
    assert viewer.glance.closed
    (x, y), radius = RACE.egg
    away = viewer.glance.position[viewer.glance.won] - complex(x, y)
    image = square(viewer)
    for column, row in viewer.camera.pixels(complex(x, y) + radius * away / np.abs(away)).round().astype(int):
        red, _, blue = image[row, column]
        assert red - blue > 100  # gold
    assert not np.array_equal(square(viewer, closed=False), image)


def test_policies_of_one_world_have_colours_of_their_own():
    names = ["greedy", "zoo:a", "zoo:b", "zoo:c", "ppo"]
    assert len(set(team_colours(names))) == len(names)
    assert team_colours(["swinging", "greedy"]) == [LOOKS["swinging"].colour, LOOKS["greedy"].colour]
    teams = Teams(["greedy", "random"], np.arange(8) % 2)
    plain, teamed = (seen(RACE, teams=each, decisions=20)[0].picture() for each in (None, teams))
    assert not np.array_equal(plain[:, :SIZE], teamed[:, :SIZE])
    assert not np.array_equal(plain[400:450, SIZE:], teamed[400:450, SIZE:])  # the legend


@pytest.mark.parametrize(("diameter", "finished", "brighter"), [(0.6, 0, 0.6), (0.1, 0, 0), (0.6, 1, 0)])
def test_disks_of_contact_are_drawn_where_they_are_seen_and_push(diameter, finished, brighter):
    cells, camera = np.array([0j, 3 + 0j]), Camera(0.0, 0.0, 9.0)
    one, over = np.ones(2), np.array([finished > 0, False])
    glance = Glance(cells, 0 * one, one, one, one, over)
    contacts = (), (swarm.Contact(diameter=diameter), swarm.Contact(diameter=0.01))
    plain, touched = (
        Scene(swarm.World(interactions=each)).picture(camera, glance, [], np.zeros((1, 4))).astype(int)
        for each in contacts
    )
    rows = np.flatnonzero((touched != plain).any(axis=2)[:, 345:375].any(axis=1))  # around the first cell
    assert np.ptp(rows) / camera.scale == pytest.approx(brighter, abs=0.04) if brighter else not len(rows)


@in_a_browser
@pytest.mark.parametrize(("start", "outside_is_seen"), [(12.2, False), (13.6, True)])
def test_a_page_shows_disks_of_contact_and_no_water_beyond_its_box(tmp_path, start, outside_is_seen):
    medium = swarm.Medium(box=((-5, 15), (-5, 15)), shape=(160, 160), uptake=0.02)
    world = EATING.replace(medium=medium, interactions=(swarm.Contact(diameter=0.5),), life=3.0)
    world = world.replace(start_box=((start, start), (12.0, 12.6)))
    results = population_test(world, {}, cells=2, life=3.0, limit=False)
    save_page(results, tmp_path / "page.html", world=world)
    code = """
      const pane = shown[0], seen = [], gl = $("water").getContext("webgl2");
      const pen = $("over").getContext("2d");
      Object.assign(camera, { x: 15, y: 13, scale: 60 }); mode = "free"; stale = true;
      for (const id of ["gradient", "ways"]) $(id).checked = false;
      draw(0);
      const at = (x, y) => [pane.width / 2 + 60 * (x - 15), pane.height / 2 - 60 * (y - 13)].map(Math.round);
      for (const x of [14, 15.2, 18]) {
        const pixel = new Uint8Array(4), [column, row] = at(x, 12.3);
        gl.readPixels(column, $("water").height - row, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
        seen.push(pixel[1]);
      }
      pane.lives.place(0, now);
      const [x, y] = onScreen(pane, 0).map(Math.round);
      for (const away of [8, 15, 20]) seen.push(pen.getImageData(x + away, y, 1, 1).data[3]);
      document.body.dataset.seen = seen.join(" ");"""
    probed(tmp_path / "page.html", code)
    dom = opened(tmp_path / "page.html", "#t=1&theme=dark", tmp_path / "profile")
    inside, beyond, far, disk, rim, outside = map(int, re.search(r'data-seen="([\d ]+)"', dom)[1].split())
    assert inside > 50 > beyond  # green
    assert (beyond > far + 15) == outside_is_seen
    assert rim > disk > outside == 0


def test_a_page_holds_frames_of_the_medium_and_stays_small(tmp_path):
    medium = swarm.Medium(shape=(80, 70), uptake=0.02, leaving="wrap")
    world = EATING.replace(medium=medium)
    results = population_test(world, {"swinging": swarm.Swinging()}, cells=8, life=80.0, limit=False)
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
    race = RACE if out.endswith("html") else RACE.replace(life=2.0)
    watch("greedy", race, against="random", share=0.25, cells=8, out=tmp_path / out)
    if out.endswith("html"):
        data = data_of((tmp_path / out).read_text(encoding="utf-8"))
        assert data["teams"]["names"] == ["greedy", "random"]
        assert data["teams"]["cells"].count(0) == 2
        assert sum(data["policies"][0]["won"]) == data["needed"] == 2


def test_a_share_without_a_rival_is_refused(tmp_path):
    with pytest.raises(ValueError, match="share must come with against"):
        watch("greedy", RACE, share=0.5, out=tmp_path / "race.gif")
