"""Figures: what is drawn is what was swum, the same results give the same bytes, nothing global changes."""

import html
import io
import subprocess
import sys

import matplotlib
import numpy as np
import pytest

from swarm import figures
from swarm.figures.style import LOOKS, look, looks
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.collocation import swim
from swarm.physics.world import World
from swarm.policies.strategies import Random, Swinging
from swarm.population.contest import population_test
from tests.figures import HOSTILE
from tests.policies.test_network import make

WORLDS = {
    "linear": World(life=20),
    "varying": World(life=20, varying_speed=True),
    "radial": World(life=20, field="radial", varying_speed=True),
    "flow": World(life=20, flow="taylor_green", sense_flow=True),
    "flow and egg": World(life=20, flow="taylor_green", field="radial"),
    "noise": World(life=20, curvatures=(3.0, 4.0, 5.0), curvature_noise=0.3, rotational_diffusion=0.05),
    "plume": World(life=20, field="gaussian_plume"),
}
POLICIES = {"random": Random(), "swinging": Swinging()}
SLOW = pytest.mark.slow


def lived(world, policies=POLICIES, cells=2, life=20):
    return population_test(world, policies, cells=cells, life=life, limit=False)


@pytest.fixture(scope="module")
def linear():
    return lived(World(), {"dqn": make()} | POLICIES, cells=4)


@pytest.mark.parametrize("name", ["radial", "flow and egg", "plume", pytest.param("noise", marks=SLOW)])
def test_every_figure_can_be_drawn_of_every_world(name):
    before, world = dict(matplotlib.rcParams), WORLDS[name]
    results = lived(world)
    for draw in (figures.centrelines, figures.centrelines_and_gains, figures.comparison):
        draw(results, world).draw_without_rendering()
    for draw in (figures.gains, figures.distribution):
        draw(results).draw_without_rendering()
    figures.comparison(results, world, enlarged=False).draw_without_rendering()
    if world.egg is not None:
        figures.radial(results, world, policy="greedy", cell=1).draw_without_rendering()
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("kind", ["png", pytest.param("pdf", marks=SLOW), pytest.param("svg", marks=SLOW)])
def test_the_same_results_give_the_same_bytes_whatever_the_users_own_style(linear, tmp_path, kind):
    before, path = dict(matplotlib.rcParams), tmp_path / f"drawn.{kind}"
    for draw in (figures.comparison, figures.centrelines_and_gains):
        figures.save(draw(linear, World()), path)
        plain = path.read_bytes()
        with matplotlib.rc_context(HOSTILE):
            figures.save(draw(linear, World()), path)
        assert path.read_bytes() == plain
    assert dict(matplotlib.rcParams) == before


def test_names_are_shown_literally(linear):
    name, world = "$\\frac{$ _a_ & <b>", World()
    renamed = linear.assign_coords(policy=[name, *linear["policy"].values[1:]])
    for draw in (figures.centrelines, figures.comparison, lambda results, _: figures.gains(results)):
        shown = io.StringIO()
        with matplotlib.rc_context({"svg.fonttype": "none"}):
            draw(renamed, world).savefig(shown, format="svg")
        assert f">{name}<" in html.unescape(shown.getvalue())


def test_what_cannot_be_drawn_is_refused(linear, tmp_path):
    with pytest.raises(ValueError, match=r"\.png, \.pdf or \.svg, got .*gains\.bmp"):
        figures.save(figures.gains(linear), tmp_path / "gains.bmp")
    with pytest.raises(ValueError, match="policies must be among dqn, random, swinging, greedy, got 'blind'"):
        figures.gains(linear, policies=("blind",))
    with pytest.raises(ValueError, match="one for each of the results, got 1 and 2"):
        figures.noise_sweep([0.0], [linear, linear], label="noise")


def test_pyplot_is_never_loaded():
    code = "import sys, swarm.figures.watch; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


@pytest.mark.parametrize("name", ["linear", "varying", "flow"])
def test_a_drawn_path_is_the_path_that_was_swum(name):
    world = WORLDS[name]
    results = lived(world)
    life = results.sel(policy="random").isel(cell=1)
    series = (life[key].values.astype(float) for key in ("time", "heading", "curvature", "position"))
    time, angle, curvature, position = (each[np.isfinite(life["time"].values)] for each in series)
    path = figures.path_of(results, world, "random", 1, points=4)
    assert path.shape == (4 * (len(time) - 1) + 1, 2)
    assert np.allclose(path[::4], position, atol=1e-5)
    heading = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    speed = np.interp(curvature, world.curvatures, world.action_speeds)
    half = swim(Pose(position[:-1], heading[:-1]), curvature[1:], speed[1:], np.diff(time) / 2, world.flow)
    assert np.allclose(path[2::4], half.position, atol=2e-5)


def test_a_path_bent_by_noise_still_goes_through_every_place():
    world = WORLDS["noise"]
    results = lived(world)
    position = results["position"].sel(policy="random").isel(cell=0).values
    path = figures.path_of(results, world, "random", 0)
    assert np.allclose(path[::12], position[np.isfinite(position[:, 0])], atol=1e-5)
    assert np.linalg.norm(np.diff(path, axis=0), axis=-1).max() < 2 * max(world.intervals) / 12


def test_a_centreline_runs_through_the_centres_of_curvature(linear):
    lines = [line for line in figures.centrelines(linear, World()).axes[0].lines if len(line.get_xdata()) > 3]
    drawn = [line.get_xydata()[3] for line in lines]
    expected = linear["centre"].values[:, :, 3].reshape(-1, 2)
    assert np.array_equal(np.unique(drawn, axis=0), np.unique(expected, axis=0))
    assert {"-", "--"} <= {line.get_linestyle() for line in lines}


def test_gains_show_every_cell_the_means_and_the_limit(linear):
    axes = figures.gains(linear.assign_attrs(limit=3.25), policies=("dqn", "greedy")).axes[0]
    points = [line.get_ydata() for line in axes.lines if len(line.get_ydata()) == linear.sizes["cell"]]
    gain = linear["gain"].sel(policy=["dqn", "greedy"])
    assert np.array_equal(points, gain)
    assert {3.25, *gain.mean("cell").values} <= {line.get_ydata()[0] for line in axes.lines}
    assert any("limit of the mean\n3.25" in text.get_text() for text in axes.texts)


@pytest.mark.parametrize("name", ["linear", "flow"])
def test_every_policy_is_drawn_unless_some_are_chosen_each_in_its_own_look(name):
    world = WORLDS[name]
    names = ["mine", "yours", "dqn", "ours", "swinging", "theirs", "aware"]
    results = lived(world, dict.fromkeys(names, Random()), life=10)
    drawn = looks(names := [*names, "greedy"])
    labels = [drawn[each].label for each in names]
    assert list(drawn) == names
    assert len({(each.line, each.marker) for each in drawn.values()}) == len(names)
    assert len({each.colour for each in drawn.values()}) == len(names)
    assert drawn["dqn"] == look("dqn")
    lines = figures.gains(results).axes[0].lines
    assert len([line for line in lines if len(line.get_ydata()) == 2 and line.get_marker() != "None"]) == 8
    assert [axes.texts[0].get_text() for axes in figures.comparison(results, world).axes[:8]] == labels
    axes = figures.centrelines(results, world).axes
    legends = [each.get_legend() for each in axes if each.get_legend()]
    legends = [text.get_text() for each in legends for text in each.get_texts()]
    titles = [each.get_title("left").split(")  ")[-1] for each in axes if each.get_title("left")]
    assert (legends or titles) == labels
    assert len(figures.comparison(results, world, policies=names[:2]).axes) == 2 + 2


def test_a_distribution_counts_every_cell_once_however_many_are_read_at_once(linear, monkeypatch):
    monkeypatch.setattr("swarm.figures.plots.populations.AT_ONCE", 3)
    axes = figures.distribution(linear, policies=("greedy", "swinging")).axes[0]
    for steps, name in zip(axes.patches, ("greedy", "swinging"), strict=True):
        density, edges, _ = steps.get_data()
        gain = linear["gain"].sel(policy=name).values
        np.testing.assert_allclose(density * np.diff(edges) * 4, np.histogram(gain, edges)[0], atol=1e-12)


def test_panels_of_a_flow_make_room_for_every_line():
    results = lived(WORLDS["flow"], {"random": Random()}, cells=6)
    figure, centre = figures.centrelines(results, WORLDS["flow"]), results["centre"].values
    for axes in figure.axes[:2]:
        for k, (low, high) in enumerate((axes.get_xlim(), axes.get_ylim())):
            assert low <= np.nanmin(centre[..., k]) <= np.nanmax(centre[..., k]) <= high


def test_training_shows_the_mean_over_seeds_greedy_and_the_limit(tmp_path):
    epoch, gain = np.arange(5), np.array([[0.0, 1, 2, 3, 4], [0.0, 3, 4, 5, 6]])
    curves = {"$N_T = 2$": figures.Curve(epoch, gain, 2.5, 6.5), "$N_T = 4$": figures.Curve(epoch, gain[0])}
    figure = figures.training(curves)
    first, second = figure.axes
    heights = [line.get_ydata() for line in first.lines]
    assert any(np.array_equal(height, gain.mean(axis=0)) for height in heights)
    assert {2.5, 6.5} <= {height[0] for height in heights if len(set(height)) == 1}
    assert len(second.lines) == 1
    figures.save(figure, tmp_path / "training.png")


def test_the_axis_of_a_training_is_logarithmic_where_that_shows_the_learning():
    for gain, scale in (([0, 8, 9, 9, 9.5], "symlog"), ([0, 0.1, 0.2, 0.5, 9], "linear")):
        curve = figures.Curve(np.array([0, 100, 200, 400, 4000]), np.array(gain))
        axes = figures.training(curve, label="decisions").axes[0]
        assert (axes.get_xscale(), axes.get_xlabel()) == (scale, "decisions")


def test_a_noise_sweep_shows_every_level(linear):
    figure = figures.noise_sweep([0.0, 0.5], [linear, linear], label="noise")
    mean = float(linear["gain"].sel(policy="dqn").mean())
    assert figure.axes[0].lines[0].get_xydata().tolist() == [[0.0, mean], [0.5, mean]]


def test_looks_differ_without_colours():
    looks = {name: (str(each.line), each.marker) for name, each in LOOKS.items()}
    assert looks.pop("aware") == looks["dqn"]  # the DQN of a flow
    assert len(set(looks.values())) == len(looks)
    assert look("somebody's").label == "somebody's"
