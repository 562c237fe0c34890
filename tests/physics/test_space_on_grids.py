"""Fields and flows on grids in three dimensions."""

import numpy as np
import pytest
import xarray as xr

import swarm
from benchmarks.exact_space import place_and_frame, reference
from swarm.physics.fields import GaussianPlume
from swarm.physics.flows import ABCFlow, GriddedFlow
from swarm.physics.motion.collocation import TOLERANCE
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from tests.reference import array, to_numpy


def sampled(points, edges, **quantities):
    """Functions of positions on a regular grid of so many points a side over one period of `WAVES`."""
    along = np.linspace(0.0, WAVES.period, points + (edges == "clamped"), endpoint=edges == "clamped")
    place = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1)
    over = {name: (("x", "y", "z"), function(place)) for name, function in quantities.items()}
    return xr.Dataset(over, dict.fromkeys(("x", "y", "z"), along))


WAVES = ABCFlow((0.3, 0.2, 0.1), 1.0)
U = {f"u_{axis}": lambda r, i=i: WAVES.velocity(r)[..., i] for i, axis in enumerate("xyz")}


@pytest.mark.parametrize("edges", ["periodic", "clamped"])
def test_a_flow_on_a_grid_in_space_is_what_it_samples(xp, edges):
    errors = []
    for points in (12, 24):
        flow = GriddedFlow(sampled(points, edges, **U), edges=edges, velocity=tuple(U))
        place = np.random.default_rng(0).uniform(0, WAVES.period, (300, 3))
        velocity, vorticity = (to_numpy(each(array(xp, place))) for each in (flow.velocity, flow.vorticity))
        differences = velocity - WAVES.velocity(place), vorticity - WAVES.vorticity(place)
        errors.append([np.abs(each).max() for each in differences])
    orders = np.log2(np.divide(*errors))
    assert (orders > [3.4, 2.4]).all(), (orders, errors)  # of fourth and of third order
    assert np.linalg.norm(vorticity, axis=-1).max() <= 2 * flow.max_spin
    assert flow.speed_scale <= flow.max_speed <= 1.2 * WAVES.max_speed
    assert (flow.inside is None) == (edges == "periodic")


def test_a_flow_on_a_grid_in_space_is_swum_within_tolerance():
    flow = GriddedFlow(sampled(8, "periodic", **U), edges="periodic", velocity=tuple(U))
    world = World.in_space(flow=flow, life=1.0)
    state = world.start(*draw_starts(world, 6, 0))
    after, _ = world.step(state, np.zeros(6, int))
    expected = reference(state.pose, 5.5, 7.7, 2.0, world.intervals[0], flow)
    np.testing.assert_allclose(place_and_frame(after), expected, rtol=0, atol=TOLERANCE)
    assert world.box == ((0.0, pytest.approx(WAVES.period)),) * 3


def test_vorticity_on_a_grid_is_taken_as_given_or_found_by_differences():
    given = {f"w_{axis}": lambda r, i=i: 2 * WAVES.velocity(r)[..., i] for i, axis in enumerate("xyz")}
    options = {"edges": "periodic", "interpolation": "linear", "velocity": tuple(U)}
    place = WAVES.period / 16 * np.random.default_rng(1).integers(16, size=(40, 3))  # points of the grid
    flow = GriddedFlow(sampled(16, "periodic", **U | given), vorticity=tuple(given), **options)
    np.testing.assert_allclose(flow.vorticity(place), 2 * WAVES.velocity(place), atol=1e-12)
    found = GriddedFlow(sampled(16, "periodic", **U), **options).vorticity(place)
    np.testing.assert_allclose(found, WAVES.vorticity(place), atol=0.02)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_a_field_on_a_grid_in_space_comes_from_a_file_and_ends_at_its_edges(tmp_path, interpolation):
    egg = {"egg_position": (3.0, 3.0, 3.0), "egg_radius": 0.5}
    path, plume = tmp_path / "plume.nc", GaussianPlume(width=2.0, **egg)
    sampled(16, "clamped", c=plume.concentration).to_netcdf(path, engine="h5netcdf")
    field = {"type": "gridded", "path": str(path), "edges": "clamped", "interpolation": interpolation, **egg}
    world = World.in_space(field=field, life=2.0)
    place = np.random.default_rng(0).uniform(1, 5, (50, 3))
    allowed = {"linear": 0.06, "cubic": 2e-3}[interpolation]
    np.testing.assert_allclose(world.field.concentration(place), plume.concentration(place), atol=allowed)
    assert np.array_equal(world.field.inside(place + 9.0), np.zeros(50, bool))
    policies = {"greedy": swarm.Greedy()}
    gain = swarm.population_test(world, policies, cells=12, limit=False)["gain"].values
    assert np.isfinite(gain).all()
    assert World(**world.described()).described() == world.described()
    data = sampled(5, "clamped", c=plume.concentration)
    arrays = {name: each.values for name, each in data.variables.items()}
    bare = swarm.GriddedField(arrays, edges="clamped", interpolation=interpolation)
    np.testing.assert_allclose(bare.concentration(np.zeros((1, 3))), plume.concentration(np.zeros((1, 3))))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"velocity": ("u_x", "u_y")}, r"velocity must be the names of 3 variables, got \('u_x', 'u_y'\)"),
        ({"velocity": tuple(U), "spin": "u_x"}, "spin must be None in space"),
        ({"velocity": tuple(U), "vorticity": ("u_x",)}, "vorticity must be the names of three"),
        (
            {"velocity": tuple(U), "edges": ("periodic", "clamped")},
            "edges must be given once, or for x and y and z",
        ),
    ],
)
def test_a_flow_on_a_grid_in_space_must_be_whole(parameters, message):
    with pytest.raises(ValueError, match=message):
        GriddedFlow(sampled(5, "periodic", **U), **{"edges": "periodic", **parameters})


def test_a_grid_in_space_is_none_of_the_plane():
    field = swarm.GriddedField(sampled(5, "clamped", c=lambda r: r[..., 0]), edges="clamped")
    with pytest.raises(ValueError, match="field must be one in the plane"):
        World(field=field)


def test_a_grid_in_space_may_change():
    data = sampled(5, "clamped", c=lambda r: r[..., 2])
    data = xr.concat([data, 2 * data], xr.Variable("time", [0.0, 10.0]), data_vars="all")
    field = swarm.GriddedField(data, edges="clamped", outside_time="held")
    place = np.random.default_rng(0).uniform(0, 6, (9, 3))
    np.testing.assert_allclose(field.at(5.0).concentration(place), 1.5 * place[:, 2], atol=1e-12)
    assert field.max_rate == pytest.approx(WAVES.period / 10)
