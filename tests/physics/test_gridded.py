"""Fields and flows from gridded data: convergence to analytic ones, edges, files, what can be wrong."""

import contextlib
import hashlib
import json
import os
import pickle
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

import swarm
from benchmarks.exact_space import place_and_frame
from benchmarks.exact_space import reference as reference_in_space
from swarm.physics.fields import FIELDS, GaussianPlume, GriddedField, LinearField
from swarm.physics.flows import FLOWS, ABCFlow, GriddedFlow, TaylorGreen, Vortex
from swarm.physics.grids import grid as grids
from swarm.physics.grids.netcdf import checksum, located
from swarm.physics.motion.collocation import TOLERANCE, swim
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from tests.reference import array, place_and_heading, pose, reference, slopes_of, to_numpy

PLUME = GaussianPlume(gradient_scale=2.0, width=4.0, offset=1.0, egg_position=(3.0, -1.0))
FLOW = TaylorGreen(speed_scale=0.3, wavenumber=np.pi / 5)
EDGES = ("periodic", "clamped")
INTERPOLATIONS = ("linear", "cubic")


def places_of(points, edges, low=(0.0, 0.0), size=(10.0, 10.0)):
    """Coordinates x and y of a grid that covers a box."""
    last = edges == "clamped"
    return [
        np.linspace(a, a + length, points + last, endpoint=last) for a, length in zip(low, size, strict=True)
    ]


def sampled(part, x, y):
    """A field or flow as a Dataset on a grid."""
    positions = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    if hasattr(part, "concentration"):
        values = {"c": part.concentration(positions)}
    else:
        velocity = part.velocity(positions)
        values = {"u_x": velocity[..., 0], "u_y": velocity[..., 1], "spin": part.spin(positions)}
    return xr.Dataset({name: (("x", "y"), value) for name, value in values.items()}, coords={"x": x, "y": y})


def on_grid(part, points, edges, low=(0.0, 0.0), size=(10.0, 10.0), **options):
    """A field or flow, interpolated between its values on a grid."""
    make = GriddedField if hasattr(part, "concentration") else GriddedFlow
    return make(sampled(part, *places_of(points, edges, low, size)), edges=edges, **options)


@pytest.fixture
def places():
    return np.random.default_rng(0).uniform(0.0, 10.0, (2000, 2))


def orders(errors):
    return np.log2(np.divide(errors[:-1], errors[1:]))


@pytest.mark.parametrize(("interpolation", "order"), [("linear", 2), ("cubic", 4)])
def test_a_sampled_plume_converges_with_the_order_of_the_interpolation(xp, places, interpolation, order):
    expected = PLUME.concentration(places)
    errors = []
    for points in (16, 32, 64):
        field = on_grid(PLUME, points, "clamped", interpolation=interpolation)
        errors.append(np.abs(to_numpy(field.concentration(array(xp, places))) - expected).max())
    print(f"{interpolation}: errors {errors}, orders {orders(errors)}")
    np.testing.assert_allclose(orders(errors), order, rtol=0, atol=0.5)


@pytest.mark.parametrize(
    ("interpolation", "spin", "velocity_order", "spin_order"),
    [("linear", None, 2, 2), ("linear", "spin", 2, 2), ("cubic", None, 4, 3), ("cubic", "spin", 4, 4)],
)
@pytest.mark.parametrize("edges", EDGES)
def test_a_sampled_taylor_green_flow_converges(
    places, edges, interpolation, spin, velocity_order, spin_order
):
    errors = []
    for points in (16, 32, 64):
        flow = on_grid(FLOW, points, edges, interpolation=interpolation, spin=spin)
        both = (flow.velocity(places), FLOW.velocity(places)), (flow.spin(places), FLOW.spin(places))
        errors.append([np.abs(found - expected).max() for found, expected in both])
    measured = orders(np.array(errors))
    print(f"{edges}, {interpolation}, spin from {spin}: errors {errors}, orders {measured.tolist()}")
    assert np.all(np.abs(measured[:, 0] - velocity_order) < 0.5)
    assert np.all(measured[:, 1] > spin_order - 0.3)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_a_linear_field_is_reproduced_exactly(xp, places, interpolation):
    # its gradient is 1 unit of concentration per unit of length everywhere, and so is what is measured
    field = on_grid(LinearField(), 7, "clamped", interpolation=interpolation)
    concentration = to_numpy(field.concentration(array(xp, places)))
    np.testing.assert_allclose(concentration, LinearField().concentration(places), rtol=0, atol=1e-12)
    assert field.gradient_scale == pytest.approx(1.0, rel=1e-12)
    assert field.max_gradient == pytest.approx(1.0, rel=1e-12)


def test_cubic_spin_is_half_the_vorticity_of_the_interpolant(places):
    flow = on_grid(FLOW, 12, "periodic")
    slope = slopes_of(flow.velocity, places)
    np.testing.assert_allclose(flow.spin(places), 0.5 * (slope[:, 1, 0] - slope[:, 0, 1]), rtol=0, atol=1e-9)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_periodic_data_repeat_in_both_directions(xp, places, interpolation):
    flow = on_grid(FLOW, 16, "periodic", (-3.0, 2.0), (10.0, 20.0), interpolation=interpolation)
    assert flow.inside is None
    np.testing.assert_allclose(flow.box, ((-3.0, 7.0), (2.0, 22.0)))
    here = to_numpy(flow.velocity(array(xp, places)))
    for shift in ([10.0, 0.0], [0.0, 20.0], [-30.0, 40.0]):
        there = to_numpy(flow.velocity(array(xp, places + np.array(shift))))
        np.testing.assert_allclose(there, here, rtol=0, atol=1e-12)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_beyond_a_clamped_edge_the_value_at_the_edge_goes_on(xp, interpolation):
    field = on_grid(PLUME, 10, "clamped", interpolation=interpolation)
    known = np.stack(
        np.meshgrid(*places_of(10, "clamped"), indexing="ij"), axis=-1
    )  # at grid points: the data
    found = to_numpy(field.concentration(array(xp, known)))
    np.testing.assert_allclose(found, PLUME.concentration(known), rtol=0, atol=1e-13)
    outside = array(xp, [[-1.0, 4.0], [11.0, 4.0], [4.0, -5.0], [12.0, 13.0]])
    edge = array(xp, [[0.0, 4.0], [10.0, 4.0], [4.0, 0.0], [10.0, 10.0]])
    np.testing.assert_array_equal(to_numpy(field.concentration(outside)), to_numpy(field.concentration(edge)))
    np.testing.assert_array_equal(to_numpy(field.inside(outside)), [False] * 4)
    np.testing.assert_array_equal(to_numpy(field.inside(edge)), [True] * 4)


def test_a_start_outside_a_clamped_grid_is_an_error_and_on_a_periodic_one_it_is_not(xp):
    position = array(xp, [[1.0, 1.0], [-0.5, 1.0]])
    heading, past = array(xp, [0.0, 0.0]), array(xp, np.zeros((2, 4), int), xp.int64)
    World(flow=on_grid(FLOW, 12, "periodic")).start(position, heading, past)
    with pytest.raises(ValueError, match=r"position must lie inside the domain.*got -0\.5, 1 for cell 1"):
        World(flow=on_grid(FLOW, 12, "clamped")).start(position, heading, past)


@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("spin", [None, "spin"])
def test_a_path_in_a_cubic_flow_is_within_tolerance_of_the_reference(xp, edges, spin):
    flow = on_grid(FLOW, 20, edges, (-5.0, -5.0), (20.0, 20.0), spin=spin)
    rng = np.random.default_rng(0)
    position, angle = rng.uniform(0, 10, (20, 2)), rng.uniform(-3, 3, 20)
    start = pose(np, position, angle)
    ones = array(xp, np.ones(20))
    for duration in (0.78, 0.38, -0.38):
        after = swim(pose(xp, position, angle), 4 * ones, ones, duration * ones, flow)
        expected = reference(position, start.heading, 4.0, 1.0, duration, flow)
        np.testing.assert_allclose(place_and_heading(after), expected, rtol=0, atol=2e-6)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_every_library_and_dtype_interpolates_alike(xp, places, dtype, interpolation):
    flow = on_grid(Vortex(speed_scale=0.3, core=1.5), 25, "clamped", interpolation=interpolation)
    position = array(xp, places.reshape(4, 500, 2), getattr(xp, dtype))
    velocity, spin = flow.velocity(position), flow.spin(position)
    assert velocity.dtype == spin.dtype == getattr(xp, dtype)
    tolerance = 1e-13 if dtype == "float64" else 2e-6
    np.testing.assert_array_equal(flow.velocity(places[7:8])[0], flow.velocity(places)[7])  # one like many
    np.testing.assert_allclose(
        to_numpy(velocity).reshape(-1, 2), flow.velocity(places), rtol=0, atol=tolerance
    )
    np.testing.assert_allclose(to_numpy(spin).ravel(), flow.spin(places), rtol=0, atol=tolerance * 10)


@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_bounds_hold_everywhere(edges, interpolation):
    rng = np.random.default_rng(1)
    x, y = places_of(8, edges)
    data = xr.Dataset(
        {name: (("x", "y"), rng.normal(size=(len(x), len(y)))) for name in ("u_x", "u_y", "c", "spin")},
        coords={"x": x, "y": y},
    )
    field = GriddedField(data, edges=edges, interpolation=interpolation, variable="c")
    places = rng.uniform(-2, 12, (20_000, 2))
    slopes = slopes_of(field.concentration, places, 1e-6)
    assert np.linalg.norm(slopes, axis=-1).max() <= field.max_gradient * (1 + 1e-6)
    for spin in (None, "spin"):
        flow = GriddedFlow(data, edges=edges, interpolation=interpolation, spin=spin)
        assert np.linalg.norm(flow.velocity(places), axis=-1).max() <= flow.max_speed
        assert np.abs(flow.spin(places)).max() <= flow.max_spin * (1 + 1e-12)


def test_scales_are_measured_or_given():
    measured = on_grid(PLUME, 40, "clamped").gradient_scale
    dense = np.stack(np.meshgrid(*places_of(200, "clamped"), indexing="ij"), axis=-1)
    squares = np.sum(slopes_of(PLUME.concentration, dense) ** 2, axis=-1)
    assert measured == pytest.approx(np.sqrt(np.mean(squares)), rel=0.02)
    with pytest.warns(UserWarning, match=f"{measured:.3g} over the grid, got 7"):
        assert on_grid(PLUME, 40, "clamped", gradient_scale=7).gradient_scale == 7.0
    assert on_grid(PLUME, 40, "clamped", gradient_scale=1.9 * measured).gradient_scale == 1.9 * measured
    flow = on_grid(FLOW, 40, "periodic")
    assert flow.speed_scale == pytest.approx(FLOW.speed_scale, rel=1e-3)
    assert flow.spin_scale == pytest.approx(FLOW.spin_scale, rel=1e-3)
    given = on_grid(FLOW, 8, "periodic", speed_scale=1, spin_scale=2)
    assert (given.speed_scale, given.spin_scale) == (1.0, 2.0)


def test_gridded_parts_can_be_pickled_and_shown():
    field = on_grid(PLUME, 8, "clamped")
    field.concentration(np.zeros((1, 2)))
    again = pickle.loads(pickle.dumps(field))
    np.testing.assert_array_equal(again.concentration(np.ones((1, 2))), field.concentration(np.ones((1, 2))))
    assert "9 × 9 points" in repr(again)
    assert "clamped" in repr(World(field=again))


@pytest.mark.parametrize(
    ("part", "options"),
    [
        (PLUME, {"interpolation": "linear", "egg_position": (3.0, -1.0), "egg_radius": 0.5}),
        (FLOW, {"velocity": ("u_x", "u_y"), "spin": "spin", "spin_scale": 0.25}),
    ],
)
def test_what_describes_data_of_a_file_makes_them_again(tmp_path, places, part, options):
    registry, path = (FIELDS if part is PLUME else FLOWS), str(tmp_path / "data.nc")
    sampled(part, *places_of(10, "clamped")).to_netcdf(path, engine="h5netcdf")
    made = registry.make({"type": "gridded", "path": path, "edges": "clamped", **options})
    told = registry.describe(made)
    assert told == json.loads(json.dumps({**told, **options, "path": path, "shape": (11, 11)}))
    assert told["sha256"] == hashlib.sha256((tmp_path / "data.nc").read_bytes()).hexdigest()
    again = registry.make(told)
    assert registry.describe(again) == told
    method = "concentration" if part is PLUME else "velocity"
    np.testing.assert_array_equal(getattr(again, method)(places), getattr(made, method)(places))
    with pytest.raises(ValueError, match=r"shape must be that of the grid, \[11, 11\], got \[11, 12\]"):
        registry.make({**told, "shape": [11, 12]})
    with (tmp_path / "data.nc").open("ab") as file:
        file.write(b"!")
    with pytest.raises(ValueError, match=f"data must be the file {path} with SHA-256 {told['sha256']}, got"):
        registry.make(told)


def test_a_file_is_found_again_by_its_checksum(tmp_path):
    old, moved, other = (str(tmp_path / name) for name in ("old.nc", "moved.nc", "other.nc"))
    for path, content in ((moved, b"data"), (other, b"others")):
        Path(path).write_bytes(content)
    number = checksum(moved)
    assert located(moved, number, [other]) == moved
    assert located(old, number, [other, moved]) == moved
    assert located(other, number, [moved]) == moved  # in its place lies another
    with pytest.raises(FileNotFoundError, match=f"file that exists, got none of {old}, {old}2"):
        located(old, number, [old + "2"])
    with pytest.raises(ValueError, match=f"file {old} with SHA-256 {number}, got {other} with"):
        located(old, number, [other])


def grid(**changes):
    x, y = places_of(6, "clamped")
    return sampled(PLUME, x, y).assign(**changes)


def with_nan():
    data = grid()
    data["c"][2, 5] = np.nan
    return data


def with_x(places):
    return grid().assign_coords(x=places)


@pytest.mark.parametrize(
    ("data", "options", "message"),
    [
        (grid(), {"edges": "clampd"}, "edges must be one of .* got 'clampd'; did you mean 'clamped'"),
        (grid(), {"interpolation": "quintic"}, "interpolation must be one of cubic, linear, got 'quintic'"),
        (grid(), {"variable": "d"}, "variable must be one of c, got 'd'"),
        (grid(d=grid()["c"]), {}, r"variable must be named .* got \['c', 'd'\]"),
        (grid(), {"gradient_scale": 0.0}, r"gradient_scale must be a finite number above 0, got 0"),
        (grid(), {"egg_radius": -1.0}, r"egg_radius must be a finite number above 0, got -1"),
        (grid(c=0.0 * grid()["c"]), {}, "gradient_scale must be given where the field has no gradient"),
        (with_nan(), {}, r"c must be finite everywhere, got nan at x = 3.33333, y = 8.33333 \(index 2, 5"),
        (with_x(np.geomspace(1, 10, 7)), {}, r"x must be evenly spaced, got .* at index \d instead of"),
        (with_x(np.zeros(7)), {}, "x must be evenly spaced, got 0 at index 0"),
        (with_x([0, 1, 2, np.nan, 4, 5, 6]), {}, "x must be finite, got nan"),
        (with_x(list("abcdefg")), {}, "x must hold real numbers"),
        (grid().drop_vars("x"), {}, r"c must have the coordinate x, got \['y'\]"),
        (grid().rename(x="lon"), {"variable": "c"}, r"c must have the dimensions .* no others, got \('lon'"),
        (grid().expand_dims(time=3), {}, r"c must have the coordinate time, got \['x', 'y'\]"),
        (grid(c=grid()["c"].astype(complex)), {}, "c must hold real numbers, got complex128"),
        (grid(c=grid()["c"].astype(str)), {}, "c must hold real numbers"),
        (grid().isel(x=slice(3)), {}, "x must have at least 4 points for cubic interpolation, got 3"),
        (grid().isel(y=slice(1)), {"interpolation": "linear"}, "y must have at least 2 points for linear"),
        (np.zeros((3, 3)), {}, "data must be an xarray Dataset or DataArray, or the path .* got ndarray"),
        (None, {}, "data must be an xarray Dataset or DataArray, or the path .* got None"),
    ],
)
def test_wrong_data_are_errors_that_name_the_variable_the_rule_and_the_value(data, options, message):
    with pytest.raises((TypeError, ValueError), match=message):
        GriddedField(data, **{"edges": "clamped", **options})


def test_a_flow_that_does_not_spin_is_sensed_as_such():
    x, y = places_of(8, "clamped")
    strain = xr.Dataset(
        {"u_x": (("x", "y"), 0.01 * (x[:, None] + 0 * y)), "u_y": (("x", "y"), -0.01 * (y + 0 * x[:, None]))},
        coords={"x": x, "y": y},
    )
    flow = GriddedFlow(strain, edges="clamped")
    assert (flow.spin_scale, flow.max_spin) == (1.0, 0.0)
    assert flow.max_shear == pytest.approx(0.01)
    World(flow=flow, sense_flow=True)
    World(flow=GriddedFlow(strain, edges="clamped", spin_scale=0.01), sense_flow=True)


def with_c(path, shape=(7, 7), dtype="f8", *, x=None, **options):
    """A file of a variable c, of which no number need be stored."""
    with h5py.File(path, "w") as file:
        variable = file.create_dataset("c", shape, dtype, **options)
        for axis, length in enumerate((shape[0] if x is None else x, shape[1])):
            file.create_dataset("xy"[axis], (length,), "f8", chunks=(2,)).make_scale("xy"[axis])
            variable.dims[axis].attach_scale(file["xy"[axis]])


def elsewhere(path):
    (path.parent / "secret").write_bytes(bytes(800))
    with_c(path, external=[(str(path.parent / "secret"), 0, 800)])


def linked(path):
    grid().to_netcdf(path.parent / "data.nc", engine="h5netcdf")
    with h5py.File(path, "w") as file:
        file["c"] = h5py.ExternalLink(str(path.parent / "data.nc"), "c")


def virtual(path):
    with_c(path.parent / "data.nc")
    layout = h5py.VirtualLayout((7, 7), "f8")
    layout[:] = h5py.VirtualSource(str(path.parent / "data.nc"), "c", (7, 7))
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("c", layout)


def cut(path, length):
    grid().to_netcdf(path, engine="h5netcdf")
    path.write_bytes(path.read_bytes()[:length])


def sparse(path):
    with_c(path)
    os.truncate(path, 2**42)


HOSTILE = {
    "numbers": (lambda path: with_c(path, (900, 10**9), chunks=(9, 9)), "at most 67108864 values, got"),
    "places": (lambda path: with_c(path, x=10**12), "x must have at most 16777216 values, got 1000000000000"),
    "bytes": (sparse, "must have at most 8589934592 bytes, got 4398046511104"),
    "external": (elsewhere, "c must be stored in the file itself, got a reference to another file"),
    "virtual": (virtual, "c must be stored in the file itself, got a reference to another file"),
    "linked": (linked, "variable must be one of"),
    "text": (lambda path: with_c(path, dtype=h5py.string_dtype()), "c must hold real numbers, got object"),
    **{f"cut {length}": (partial(cut, length=length), r"my\.nc must be a") for length in (0, 8, 3000)},
    "nowhere": (lambda path: None, r"data must be a file that exists, got .*my\.nc"),
    "folder": (Path.mkdir, "must be an ordinary file"),
    "pipe": (os.mkfifo, "must be an ordinary file"),
    "csv": (
        lambda path: path.write_text("x,y,c"),
        r"my\.nc must be a NetCDF-4 file; open others with xarray",
    ),
    "old": (lambda path: grid().to_netcdf(path, engine="scipy"), "a NetCDF-4 file; open others with xarray"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_broken_or_hostile_file_is_an_error_before_anything_is_loaded(tmp_path, name):
    write, message = HOSTILE[name]
    write(tmp_path / "my.nc")
    for variable in (None, "c") if name == "numbers" else ("c",):
        with pytest.raises((ValueError, FileNotFoundError), match=message):
            GriddedField(tmp_path / "my.nc", edges="clamped", variable=variable)


def test_a_dataset_that_is_too_large_is_an_error_before_it_is_loaded(monkeypatch):
    monkeypatch.setattr(grids, "MAX_VALUES", 40)
    with pytest.raises(ValueError, match="c must have at most 40 values, got 49"):
        GriddedField(grid(), edges="clamped")


def test_variables_that_are_not_asked_for_are_not_read(tmp_path):
    grid().to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    with h5py.File(tmp_path / "data.nc", "a") as file:
        file.create_dataset("other", (10**7, 10**7), "f8", chunks=(100, 100))
    GriddedField(tmp_path / "data.nc", edges="clamped", variable="c")


def test_bytes_flipped_in_a_file_never_raise_anything_but_clear_errors(tmp_path):
    path = tmp_path / "flipped.nc"
    grid().to_netcdf(path, engine="h5netcdf")
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    for _ in range(40):
        broken = bytearray(whole)
        for place in rng.integers(8, len(whole), 8):
            broken[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        with contextlib.suppress(TypeError, ValueError):
            GriddedField(path, edges="clamped")


# --- in space ---


def sampled_in_space(points, edges, **quantities):
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
        flow = GriddedFlow(sampled_in_space(points, edges, **U), edges=edges, velocity=tuple(U))
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
    flow = GriddedFlow(sampled_in_space(8, "periodic", **U), edges="periodic", velocity=tuple(U))
    world = World.in_space(flow=flow, life=1.0)
    state = world.start(*draw_starts(world, 6, 0))
    after, _ = world.step(state, np.zeros(6, int))
    expected = reference_in_space(state.pose, 5.5, 7.7, 2.0, world.intervals[0], flow)
    np.testing.assert_allclose(place_and_frame(after), expected, rtol=0, atol=TOLERANCE)
    assert world.box == ((0.0, pytest.approx(WAVES.period)),) * 3


def test_vorticity_on_a_grid_is_taken_as_given_or_found_by_differences():
    given = {f"w_{axis}": lambda r, i=i: 2 * WAVES.velocity(r)[..., i] for i, axis in enumerate("xyz")}
    options = {"edges": "periodic", "interpolation": "linear", "velocity": tuple(U)}
    place = WAVES.period / 16 * np.random.default_rng(1).integers(16, size=(40, 3))  # points of the grid
    flow = GriddedFlow(sampled_in_space(16, "periodic", **U | given), vorticity=tuple(given), **options)
    np.testing.assert_allclose(flow.vorticity(place), 2 * WAVES.velocity(place), atol=1e-12)
    found = GriddedFlow(sampled_in_space(16, "periodic", **U), **options).vorticity(place)
    np.testing.assert_allclose(found, WAVES.vorticity(place), atol=0.02)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_a_field_on_a_grid_in_space_comes_from_a_file_and_ends_at_its_edges(tmp_path, interpolation):
    egg = {"egg_position": (3.0, 3.0, 3.0), "egg_radius": 0.5}
    path, plume = tmp_path / "plume.nc", GaussianPlume(width=2.0, **egg)
    sampled_in_space(16, "clamped", c=plume.concentration).to_netcdf(path, engine="h5netcdf")
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
    data = sampled_in_space(5, "clamped", c=plume.concentration)
    arrays = {name: each.values for name, each in data.variables.items()}
    bare = GriddedField(arrays, edges="clamped", interpolation=interpolation)
    np.testing.assert_allclose(bare.concentration(np.zeros((1, 3))), plume.concentration(np.zeros((1, 3))))


PLANE, SPACE = sampled(FLOW, *places_of(8, "periodic")), sampled_in_space(5, "periodic", **U)


@pytest.mark.parametrize(
    ("data", "parameters", "message"),
    [
        (
            PLANE,
            {"velocity": ("u_x", "v_y")},
            "variable must be one of spin, u_x, u_y, got 'v_y'; did you mean",
        ),
        (
            PLANE,
            {"velocity": "u_x"},
            "velocity must be the names of two variables, or three in space, got 'u_x'",
        ),
        (PLANE["u_x"], {}, "data must be a Dataset with u_x, u_y, got a DataArray"),
        (PLANE * 0, {}, r"speed_scale must be a finite number above 0, got 0\.0"),
        (SPACE, {}, r"velocity must be the names of 3 variables, got \('u_x', 'u_y'\)"),
        (SPACE, {"velocity": tuple(U), "spin": "u_x"}, "spin must be None in space"),
        (SPACE, {"velocity": tuple(U), "vorticity": ("u_x",)}, "vorticity must be the names of three"),
        (
            SPACE,
            {"velocity": tuple(U), "edges": ("periodic", "clamped")},
            "edges must be given once, or for x and",
        ),
    ],
)
def test_a_flow_on_a_grid_must_be_whole(data, parameters, message):
    with pytest.raises((TypeError, ValueError), match=message):
        GriddedFlow(data, **{"edges": "periodic", **parameters})


def test_a_grid_in_space_is_none_of_the_plane():
    field = GriddedField(sampled_in_space(5, "clamped", c=lambda r: r[..., 0]), edges="clamped")
    with pytest.raises(ValueError, match="field must be one in the plane"):
        World(field=field)


def test_a_grid_in_space_may_change():
    data = sampled_in_space(5, "clamped", c=lambda r: r[..., 2])
    data = xr.concat([data, 2 * data], xr.Variable("time", [0.0, 10.0]), data_vars="all")
    field = GriddedField(data, edges="clamped", outside_time="held")
    place = np.random.default_rng(0).uniform(0, 6, (9, 3))
    np.testing.assert_allclose(field.at(5.0).concentration(place), 1.5 * place[:, 2], atol=1e-12)
    assert field.max_rate == pytest.approx(WAVES.period / 10)
