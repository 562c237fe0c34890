"""Lives in space are seen as they were swum: in pictures that turn, in figures and on the page."""

import json
import re
import shutil
import subprocess
from importlib import resources

import numpy as np
import pytest

import swarm
from swarm import figures
from swarm.figures.page import page, save_page
from swarm.figures.scene import SIZE, Orbit
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.helix import along_helix, helix
from swarm.population.contest import population_test
from tests.figures import data_of, in_a_browser, opened, probed
from tests.figures import seen as followed

NODE = shutil.which("node")
NOISY = {"curvature_noise": 0.3}


@pytest.fixture(scope="module")
def results():
    return population_test(swarm.World.in_space(**NOISY), {}, cells=3, life=1.6, limit=False)


def seen(**settings):
    return followed(swarm.World.in_space(**settings), cells=3, decisions=11)


def halfway(results, world):
    """Places (cells, 3) in the middle of the second interval, in still water without noise."""
    first = results.isel(policy=0).astype(float)
    pose = Pose(*(first[name].values[:, 1] for name in ("position", "heading")))
    numbers = (first[name].values[:, 2] for name in ("curvature", "torsion"))
    wait = np.diff(first["time"].values[:, 1:3])[:, 0]
    return along_helix(pose, helix(*numbers, world.speed * 0.5 * wait)).position


def test_heads_lie_where_the_view_sees_them_and_the_view_turns():
    viewer, state = seen()
    last, earlier = viewer.picture(), viewer.picture(0.5)
    assert last.shape == (720, 960, 3)
    camera = viewer.camera.turned(len(viewer.curve))
    for column, row in camera.pixels(camera.flat(np.asarray(state.position))).round().astype(int):
        assert last[row - 2 : row + 3, column - 2 : column + 3].min(axis=2).max() > 240
    walls = np.abs(last[:, :SIZE].astype(int) - earlier[:, :SIZE]).sum(axis=2) > 30
    assert walls.mean() > 0.002  # not the cells alone


@pytest.mark.parametrize("axis", range(3))
def test_a_view_shows_near_things_larger_and_places_where_they_are(axis):
    camera = Orbit((1.0, -2.0, 3.0), 4.0, azimuth=0.7)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-15)
    steps = np.array([0.5, -1.0, 0.25])
    place = camera.centre + steps @ camera.axes
    larger = 1 / (1 - steps[2] / 16)
    assert camera.flat(place) == pytest.approx((steps[0] + 1j * steps[1]) * larger)
    assert camera.flat(camera.centre + 1e-9 * camera.axes[axis]) == pytest.approx(0, abs=1e-8)


def test_the_egg_hides_what_is_behind_it_alone():
    camera = Orbit((0.0, 0.0, 0.0), 10.0, ball=((0.0, 0.0, 0.0), 1.0))
    places = np.outer([-3.0, 3.0], camera.axes[2]) + 0.2 * camera.axes[0]
    assert np.isnan(camera.flat(places)).tolist() == [True, False]
    assert np.isfinite(camera.flat(places + 1.5 * camera.axes[1])).all()


def test_trails_are_the_helices_that_were_swum_and_meet_where_noise_led():
    viewer, state = seen(**NOISY)
    for segment, after in zip(viewer.trail, list(viewer.trail)[1:], strict=False):
        ends = segment.places(np.array([0.0, 1.0]))
        np.testing.assert_allclose(ends[:, 0], segment.start.position, atol=1e-12)
        np.testing.assert_allclose(ends[:, 1], after.start.position, atol=1e-12)
    np.testing.assert_allclose(viewer.trail[-1].places(np.ones(1))[:, 0], state.position, atol=1e-12)
    start, _, curvature, torsion, speed, wait, _ = (quiet := seen()[0]).trail[3]
    way = along_helix(start, helix(curvature, torsion, speed * wait)).position
    np.testing.assert_allclose(way, quiet.trail[4].start.position, atol=1e-9)


def test_brighter_walls_hold_more():
    viewer, _ = seen()
    image = viewer.picture()[:, :SIZE].astype(int).sum(axis=2)
    far = np.where(viewer.camera.axes[2] > 0, -0.5, 0.5)
    camera = viewer.camera.turned(len(viewer.curve))
    wall = camera.place(np.stack([[far[0], 0.33, height] for height in (-0.3, 0.0, 0.3)]))
    columns, rows = camera.pixels(camera.flat(wall)).round().astype(int).T
    assert (np.diff(image[rows, columns]) > 10).all()


def test_walls_show_how_fast_it_flows_and_streaks_where_to():
    viewer, _ = seen(flow="abc")
    flowing, (slow, fast) = viewer.picture(), viewer.scene.water.span
    assert slow == 0 < 0.5 * viewer.world.flow.speed_scale < fast < 2 * viewer.world.flow.speed_scale
    viewer.scene.seen, viewer.scene.water.world = None, swarm.World.in_space(flow="shear")
    assert (viewer.picture()[:, :SIZE] != flowing[:, :SIZE]).mean() > 0.1


def test_paths_go_through_all_places_and_have_shadows_on_three_walls(results):
    world = swarm.World.in_space(**NOISY)
    path = figures.path_of(results, world, "greedy", 1, points=5)
    np.testing.assert_allclose(path[::5], results["position"].values[0, 1], atol=1e-6)
    places = figures.comparison(results, world).axes[1]
    assert places.name == "3d"
    line, *shadows, _ = (np.stack(each.get_data_3d()) for each in places.lines)
    np.testing.assert_allclose(line.T, figures.path_of(results, world, "greedy", 0))
    assert [np.ptp(each, axis=1).round(9).tolist().count(0.0) for each in shadows] == [1, 1, 1]
    sides = np.array([np.ptp(getattr(places, f"get_{axis}lim")()) for axis in "xyz"])
    np.testing.assert_allclose(np.ptp(sides / places._box_aspect), 0, atol=1e-12)


@pytest.mark.parametrize("figure", ["centrelines", "centrelines_and_gains", "radial"])
def test_populations_are_drawn_in_space(figure):
    world = swarm.World.in_space(field="radial", start_box=((2, 3),) * 3)
    results = population_test(world, {}, cells=2, life=0.4, limit=False)
    drawn = getattr(figures, figure)(results, world).axes[0]
    assert drawn.name == "3d"
    assert len(drawn.collections) == 1  # the egg
    for side, middle in zip("xyz", world.egg[0], strict=True):
        low, high = getattr(drawn, f"get_{side}lim")()
        assert low < middle - world.egg[1] < middle + world.egg[1] < high


SCRIPT = """
const lives = new SpaceLives(data.policies[0], data), found = [];
for (const t of data.times) for (let cell = 0; cell < lives.n; cell++) {
  lives.place(cell, t);
  const { x, y, z, tx, ty, tz, nx, ny, nz } = lives;
  found.push([x, y, z, Math.hypot(tx, ty, tz), tx * nx + ty * ny + tz * nz]);
}
console.log(JSON.stringify(found));"""


@pytest.mark.skipif(NODE is None, reason="no Node.js on this machine")
@pytest.mark.parametrize("noise", [{}, NOISY], ids=["still", "noise"])
def test_the_page_swims_the_helices_of_the_world(tmp_path, noise):
    world = swarm.World.in_space(**noise)
    results = population_test(world, {}, cells=3, life=0.8, limit=False)
    data, time = data_of(page(results)), results["time"].values[0, 0]
    data["times"] = [float(time[1] + time[2]) / 2, float(time[2]) - 1e-7, float(time[2])]
    assets = resources.files("swarm.figures.page") / "assets"
    names = ("lives.js", "shaders.js", "stage.js", "space.js", "volume.js")
    program = "".join((assets / name).read_text(encoding="utf-8") for name in names)
    (tmp_path / "swim.js").write_text(f"const data = {json.dumps(data)};{program}{SCRIPT}", encoding="utf-8")
    done = subprocess.run([NODE, tmp_path / "swim.js"], capture_output=True, text=True, check=True)
    found = np.array(json.loads(done.stdout)).reshape(3, 3, 5)
    if not noise:
        np.testing.assert_allclose(found[0, :, :3], halfway(results, world), atol=1e-3)
        np.testing.assert_allclose(found[..., 3], 1, atol=1e-3)
        np.testing.assert_allclose(found[..., 4], 0, atol=1e-3)
    for at in (1, 2):
        np.testing.assert_allclose(found[at, :, :3], results["position"].values[0, :, 2], atol=1e-3)


@pytest.mark.slow
@in_a_browser
def test_a_browser_turns_a_page_of_space_until_it_is_touched(results, tmp_path):
    save_page(results, tmp_path / "page.html", title="Space")
    code = """
      const seen = [], angle = () => camera.azimuth.toFixed(4);
      const at = (type, x, y) => box.dispatchEvent(
        new PointerEvent(type, { pointerId: 1, clientX: x, clientY: y, bubbles: true }));
      box.setPointerCapture = () => {};
      seen.push(turning, angle()); draw(1); seen.push(angle());
      for (const [type, x, y] of [["down", 30, 30], ["move", 70, 30], ["move", 110, 50], ["up", 110, 50]])
        at("pointer" + type, x, y);
      seen.push(turning, angle()); draw(1); seen.push(angle());
      const pixel = new Uint8Array(4), gl = $("water").getContext("webgl2"), pane = shown[0];
      const [x, y] = project(pane, [camera.x, camera.y, camera.z]).map(Math.round);
      gl.readPixels(x, $("water").height - y, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
      document.body.dataset.seen = [...seen, ...pixel].join(" ");"""
    probed(tmp_path / "page.html", code)
    dom = opened(tmp_path / "page.html", "#theme=dark", tmp_path / "profile")
    turning, first, spun, touched, turned, still, *pixel = re.search(r'data-seen="([^"]+)"', dom)[1].split()
    assert (turning, touched) == ("true", "false")
    assert float(spun) > float(first)
    assert float(turned) == pytest.approx(float(spun) - 0.008 * 80, abs=0.02)
    assert still == turned
    assert int(pixel[2]) > int(pixel[0])  # the sea
