"""Pictures show what is there, without a display."""

import importlib.util
import sys

import matplotlib
import numpy as np
import pytest

import swarm
from swarm.envs.gymnasium import SpermSwarmVector
from swarm.figures.scene import PLUM, SEA, SIZE, TRAIL, Camera, Glance, Scene, Segment
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.collocation import swim
from tests.figures import HOSTILE

WORLDS = {
    "linear": {},
    "radial": {"field": "radial", "varying_speed": True},
    "taylor_green": {"flow": "taylor_green", "sense_flow": True},
    "float32 and noise": {"dtype": "float32", "rotational_diffusion": 0.1},
}
needs_pygame = pytest.mark.skipif(
    importlib.util.find_spec("pygame") is None, reason="a window needs pygame, which is not installed"
)


def begun(steps=3, n_swimmers=4, **settings):
    env = swarm.parallel_env(n_swimmers, render_mode="rgb_array", **settings)
    env.reset(seed=0)
    for _ in range(steps):
        env.step(dict.fromkeys(env.agents, 1))
    return env


def square_of(env):
    return env.render()[:, :SIZE].astype(int)


def pixel(env, place):
    """Column and row of a complex place."""
    return env._watch().camera.pixels(np.array(place)).round().astype(int)


@pytest.mark.parametrize("name", WORLDS)
def test_a_picture_depends_on_nothing_but_what_happened_and_changes_nothing(name):
    style, first, second = dict(matplotlib.rcParams), begun(**WORLDS[name]), begun(**WORLDS[name])
    state, image = first.state(), first.render()
    assert image.shape == (720, 960, 3)
    assert image.dtype == np.uint8
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 1000
    np.testing.assert_array_equal(first.render(), image)
    np.testing.assert_array_equal(first.state(), state)
    assert dict(matplotlib.rcParams) == style
    with matplotlib.rc_context(HOSTILE):
        np.testing.assert_array_equal(second.render(), image)


def test_without_a_render_mode_a_warning_says_how_to_get_a_picture():
    env = swarm.parallel_env(2)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match='make the environment with render_mode="rgb_array" or "human"'):
        assert env.render() is None


def test_the_gymnasium_face_gives_every_cell_the_picture_of_the_world_that_they_share():
    env = SpermSwarmVector(3, render_mode="rgb_array", life=0.5)
    env.reset(seed=0)
    before = env.render()
    for _ in range(3):  # lives end and begin
        env.step(np.ones(3, int))
    images = env.render()
    assert len(images) == 3
    assert images[0] is images[1] is images[2]
    assert not np.array_equal(images[0], before[0])


@needs_pygame
def test_human_shows_a_window_also_where_there_is_no_display(monkeypatch):
    import pygame

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = swarm.parallel_env(2, render_mode="human")
    env.reset(seed=0)
    env.step(dict.fromkeys(env.agents, 1))
    assert env.render() is None
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    np.testing.assert_array_equal(shown, env._viewer.picture())
    for _ in range(2):
        env.close()
        env.close()
        assert not pygame.display.get_init()
        env.reset()  # opens it again
        assert pygame.display.get_init()
    env.close()


@needs_pygame
def test_a_window_that_cannot_be_had_is_told_with_the_remedy(monkeypatch):
    env = swarm.parallel_env(2, render_mode="human")
    monkeypatch.setenv("SDL_VIDEODRIVER", "nonesuch")
    with pytest.raises(OSError, match="a window needs a display, got nonesuch not available"):
        env.reset(seed=0)
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(ModuleNotFoundError, match=r"needs pygame: pip install 'chemoswarm\[render\]'"):
        env.reset(seed=0)


@pytest.mark.parametrize("place", [0j, 2 + 1j, -3 - 2j])
def test_a_head_lies_where_the_camera_sees_it_and_points_where_it_swims(place):
    at, one, camera = np.full(1, place), np.ones(1), Camera(0.0, 0.0, 9.0)
    glance = Glance(at, np.pi / 4 * one, one, one, one, one < 0)
    image = Scene(swarm.World()).picture(camera, glance, [], np.zeros((1, 4)))[:640, :SIZE]  # not the scale
    rows, columns = np.nonzero((image > 240).all(axis=-1))
    assert (columns.mean(), rows.mean()) == pytest.approx(tuple(camera.pixels(np.array(place))), abs=0.5)
    assert np.corrcoef(columns, -rows)[0, 1] > 0.3


def test_brighter_water_holds_more():
    """In a linear field brightness grows upwards; strong lines are five levels apart."""
    rows = square_of(begun(steps=0, n_swimmers=1))[:, 600:].sum(axis=(1, 2))
    assert rows[0] > rows[200] > rows[500] > rows[-1]
    raised = rows[1:-1] - (rows[:-2] + rows[2:]) / 2
    lines = np.flatnonzero(raised > 2500)
    assert len(lines) > 5
    assert np.ptp(np.diff(lines)) <= 1
    assert np.ptp(np.diff(np.flatnonzero(raised > 0.7 * raised.max()))) <= 5


@pytest.mark.parametrize("colours", [SEA, PLUM])
def test_colours_of_the_water_can_be_read_without_colours(colours):
    assert (np.diff(colours(np.linspace(0, 1, 50))[:, :3] @ (0.2126, 0.7152, 0.0722)) > 0).all()


def test_the_egg_is_drawn_where_it_is():
    env = begun(steps=0, n_swimmers=1, field="radial", start_box=((2, 2), (0, 0)))
    (column, row), image = pixel(env, 0j), square_of(env)
    egg, water = image[row, column], image[row, column + 200]
    assert egg[0] > egg[2] > 100  # warm
    assert water[0] < water[2]  # cool


def test_water_beyond_the_known_is_dark():
    class Field(swarm.LinearField):
        def inside(self, position):
            return position[..., 0] < 5.0

    env = begun(steps=0, n_swimmers=1, field=Field(), start_box=((4, 4), (0, 0)))
    image, (edge, _) = square_of(env), pixel(env, 5 + 0j)
    assert image[100, : edge - 10].mean() > 2 * image[100, edge + 10 :].mean()


def test_the_camera_keeps_all_living_swimmers_in_view():
    env = begun(steps=0, n_swimmers=30, start_box=((0, 40), (0, 2)))
    for _ in range(30):
        pixels = env._watch().camera.pixels(env.state()[:, :2] @ [1, 1j])
        assert ((pixels > 0) & (pixels < SIZE)).all()
        env.step(dict.fromkeys(env.agents, 1))


def test_a_trail_shows_where_the_swimmer_came_from_and_fades():
    env = begun(steps=0, n_swimmers=1)
    for decision in range(TRAIL):  # circles that drift
        env.step({"swimmer_0": decision // 2 % 2})
    image, warmth = square_of(env), []
    for segment in env._watch().trail:
        column, row = pixel(env, segment.start[0])
        near = image[row - 1 : row + 2, column - 1 : column + 2, 0]
        warmth.append(near.max() - image[row, 700, 0])  # the trail is warm, the water is not
    assert min(warmth[-8:-2]) > 100
    assert 3 < np.mean(warmth[:6]) < 0.5 * np.mean(warmth[-8:-2])


def test_a_new_life_leaves_its_trail_behind():
    env = SpermSwarmVector(2, render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(4):
        env.step(np.ones(2, int))
    env.reset(options={"reset_mask": np.array([True, False])})
    trail = env._watch().trail
    assert [segment.seen.tolist() for segment in trail] == [[False, True]] * 4 + [[False] * 2]
    assert np.isnan(trail[0].places(np.ones(1))[0]).all()
    env.reset()
    assert not env._watch().trail


@pytest.mark.parametrize("turn", [1.9, 3.9, -0.3, 6.2, 0.0, 1e-6])
def test_trails_follow_the_arcs_that_were_swum(turn):
    start = Pose(np.array([[1.0, 2.0]]), np.array([[np.cos(0.7), np.sin(0.7)]]))
    length, one, share = 0.38, np.ones(1), np.array([0.0, 0.2, 0.5, 1.0])
    bend = np.array([turn / length])
    places = np.array([swim(start, bend, one, one * length * part).position[0] @ [1, 1j] for part in share])
    segment = Segment(places[:1], places[-1:] - places[:1], np.array([turn]), one > 0)
    np.testing.assert_allclose(segment.places(share)[0], places, atol=1e-7)


@pytest.mark.parametrize("name", ["linear", "taylor_green", "float32 and noise"])
def test_pictures_between_two_states_lead_from_one_to_the_other(name):
    env = begun(steps=2, n_swimmers=1, **WORLDS[name])
    viewer = env._watch()
    end = viewer.trail[-1].places(np.ones(1))[0]
    np.testing.assert_allclose(end, env.state()[0, :2] @ [1, 1j], atol=1e-6)
    images = [viewer.picture(share) for share in (0.05, 0.5, 1.0)]
    assert len({image.tobytes() for image in images}) == 3
    np.testing.assert_array_equal(images[-1], env.render())
