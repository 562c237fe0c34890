"""Data as people have them: order, periods, rounding, units, holes, time, noise of rounding."""

import h5py
import numpy as np
import pytest
import xarray as xr

from swarm.optimal.problem import problem_of
from swarm.physics.fields import FIELDS, FunctionField, GriddedField, LinearField
from swarm.physics.flows import FunctionFlow, GriddedFlow, UniformFlow
from swarm.physics.grids.units import unit_of
from swarm.physics.starts import draw_record_noise, draw_starts
from swarm.physics.world import World
from swarm.population.contest import population_test
from swarm.population.results import data_of
from tests.reference import array, to_numpy

RNG = np.random.default_rng(0)
PLACES = RNG.uniform(0.5, 8.5, (50, 2))


def dataset(x, y, function=lambda x, y: x**2 + y, **attributes):
    """c over (x, y), with attributes of x."""
    values = function(*np.meshgrid(x, y, indexing="ij"))
    return xr.Dataset({"c": (("x", "y"), values)}, {"x": ("x", x, attributes), "y": y})


def field(data, **options):
    return GriddedField(data, **{"edges": "clamped", **options})


# --- order ---

TEN = np.arange(10.0)


@pytest.mark.parametrize("axis", ["x", "y", "time"])
@pytest.mark.parametrize(
    "order", [np.roll(TEN, 5), TEN[::-1], RNG.permutation(TEN), np.roll(TEN[::-1], 3)], ids=str
)
def test_labelled_data_in_any_order_are_reordered_and_bare_arrays_must_be_in_order(tmp_path, axis, order):
    data = xr.concat([dataset(TEN, TEN) + 3 * t for t in TEN], xr.DataArray(TEN, dims="time", name="time"))
    mixed = data.sel({axis: order})
    mixed.to_netcdf(tmp_path / "mixed.nc", engine="h5netcdf")
    expected = field(data, outside_time="held").at(2.5).concentration(PLACES)
    np.testing.assert_allclose(expected, field(dataset(TEN, TEN)).concentration(PLACES) + 7.5, atol=1e-9)
    for given in (mixed, mixed["c"].transpose("y", "time", "x"), tmp_path / "mixed.nc"):
        found = field(given, outside_time="held").at(2.5).concentration(PLACES)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    bare = {name: mixed[name].values for name in ("x", "y", "time", "c")}
    if np.all(np.diff(order) < 0):
        found = field(bare, outside_time="held").at(2.5).concentration(PLACES)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    else:
        with pytest.raises(ValueError, match=f"{axis} must rise or fall strictly where data are bare arrays"):
            field(bare, outside_time="held")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"c": np.zeros((10, 9))}, r"c must have the shape \(10, 10\) of its axes, got \(10, 9\)"),
        ({"x": np.zeros((10, 1))}, r"x must have one dimension, got \(10, 1\)"),
        ({"y": np.repeat(TEN[::2], 2)}, "y must rise or fall strictly .* got 0 before 0 at index 0"),
        ({"x": np.where(TEN == 3, np.nan, TEN)}, "x must be finite, got nan"),
    ],
)
def test_bare_arrays_that_do_not_fit_are_errors(changes, message):
    with pytest.raises(ValueError, match=message):
        field({"x": TEN, "y": TEN, "c": np.ones((10, 10)), **changes})


# --- periods ---


def waves(x, y):
    return np.sin(np.pi / 10 * x) * (2 + np.cos(np.pi / 10 * y))


def evens(x, y):
    return np.cos(np.pi / 10 * x) * (2 + np.cos(np.pi / 10 * y))


REPEATED, CENTRES, HALOS = 1.25 * np.arange(17), 1.25 * (np.arange(16) + 0.5), 1.25 * np.arange(-1, 18)
ONE_PERIOD = 1.25 * np.arange(16)


def packed(data):
    return xr.decode_cf(
        xr.Dataset(
            {"c": (("x", "y"), np.round(data["c"].values / 1e-3).astype("i2"), {"scale_factor": 1e-3})},
            data.coords,
        )
    )


def noisy_single(data):
    """As a simulation in single precision leaves it: the last bits differ."""
    return data.astype("f4") * (1 + np.float32(1e-7) * RNG.integers(-1, 2, data["c"].shape).astype("f4"))


@pytest.mark.parametrize("store", [lambda data: data, lambda data: data.astype("f4"), packed, noisy_single])
@pytest.mark.parametrize(("x", "period"), [(REPEATED, 20), (HALOS, 20), (1.25 * np.arange(20), 20)])
@pytest.mark.parametrize("function", [waves, evens])
def test_lines_that_repeat_are_found_in_any_precision_and_a_stated_period_drops_them(
    store, x, period, function
):
    data = store(dataset(x, ONE_PERIOD, function))
    rule = f"x of a periodic grid must end .* got the same values; period={period:g} drops them"
    with pytest.raises(ValueError, match=rule):
        GriddedField(data, edges="periodic")
    attributed = data.assign_coords(x=("x", x, {"period": np.float32(20.0)}))
    usual = GriddedField(dataset(ONE_PERIOD, ONE_PERIOD, function), edges="periodic")
    for given, options in ((data, {"period": 20}), (attributed, {}), (data, {"period": {"x": 20}})):
        found = GriddedField(given, edges="periodic", **options)
        assert np.ptp(found.box[0]) == pytest.approx(period)
        np.testing.assert_allclose(
            found.concentration(PLACES), usual.concentration(PLACES), rtol=0, atol=2e-3
        )


@pytest.mark.parametrize(
    ("x", "function"),
    [
        (CENTRES, evens),
        (CENTRES, lambda x, y: np.cos(np.pi / 5 * x) + 0 * y),
        (20 / 45 * (np.arange(45) + 0.5), evens),
        (ONE_PERIOD, lambda x, y: np.sin(np.pi / 5 * x) + 0 * y),  # a finer period within
        (ONE_PERIOD, lambda x, y: np.exp(-((x - 9) ** 2) / 2) + 0 * y),  # nothing at both ends
    ],
)
def test_equal_lines_by_chance_are_no_repetition(x, function):
    for store in (lambda data: data, packed):
        found = GriddedField(store(dataset(x, CENTRES, function)), edges="periodic")
        assert np.ptp(found.box[0]) == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"period": 20.6}, "period along x must be a whole number of spacings, 17 of 1.25 at most, got 20.6"),
        ({"period": 30}, "period along x must be a whole number of spacings, 17 of 1.25 at most, got 30"),
        ({"period": 10}, "x must have lines that repeat after the period 10, got others beyond 8 lines"),
        ({"period": -1.0}, "period must be a finite number above 0, got -1"),
        ({"period": {"z": 1}}, "period must be given for x and y, got 'z'"),
        ({"period": (None, 20), "edges": ("periodic", "clamped")}, "period along y must be None, .* clamped"),
        ({"edges": ("clamped", "periodic")}, "y of a periodic grid must end .* period=20 drops them"),
        ({"edges": ("periodic", "open")}, "edges along y must be one of clamped, periodic, got 'open'"),
    ],
)
def test_a_period_that_does_not_fit_is_an_error(options, message):
    with pytest.raises(ValueError, match=message):
        GriddedField(dataset(REPEATED, REPEATED, waves), **{"edges": "periodic", **options})


@pytest.mark.parametrize("edges", [("periodic", "clamped"), {"x": "periodic", "y": "clamped"}])
@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_a_channel_is_periodic_along_it_and_ends_at_its_walls(xp, edges, interpolation):
    y = np.linspace(0, 2, 9)
    data = dataset(ONE_PERIOD, y, lambda x, y: np.sin(np.pi / 10 * x) * y)
    found = GriddedField(data, edges=edges, interpolation=interpolation)
    assert found.box == ((0.0, 20.0), (0.0, 2.0))
    places = array(xp, [[3.0, 1.1], [23.0, 1.1], [-17.0, 1.1], [3.0, 2.5], [3.0, -0.5]])
    values = to_numpy(found.concentration(places))
    np.testing.assert_allclose(values[1:3], values[0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(to_numpy(found.inside(places)), [True] * 3 + [False] * 2)
    assert found.parameters()["edges"] == ["periodic", "clamped"]


# --- rounded coordinates ---


@pytest.mark.parametrize(
    ("x", "spacing"),
    [
        (np.round(0.645 * np.arange(40), 2), 0.645),
        (np.round(0.12345 * np.arange(60), 4), 0.12345),
        (np.round(50 + 3.3333333 * np.arange(30), 2), 3.3333333),
        (3.0 + 0.5 * np.arange(200) * (1 + 1.5e-4 * np.sin(np.arange(200)) / 200), 0.5),
    ],
)
def test_rounded_coordinates_are_evenly_spaced(x, spacing):
    found = field(dataset(x, TEN, lambda x, y: x + y))
    assert found.spline.lattice.spacing[0] == pytest.approx(spacing, rel=1e-4)
    with pytest.raises(
        ValueError, match=r"x must be evenly spaced, .* a spacing_tolerance above 1e-06 allows more"
    ):
        field(dataset(x, TEN), spacing_tolerance=1e-6)


def test_a_tolerance_is_wide_only_where_it_is_asked_to_be():
    single = field(dataset(np.float32(np.linspace(1000, 1010, 101)), TEN), spacing_tolerance=0.0)
    assert single.box[0] == pytest.approx((1000.0, 1010.0), rel=1e-6)
    rough = dataset(TEN + np.where(TEN == 4, 0.1, 0.0), TEN)
    with pytest.raises(ValueError, match=r"got 4\.1 at index 4 instead of .* spacing_tolerance above 0\.01"):
        field(rough)
    assert field(rough, spacing_tolerance=0.2).parameters()["spacing_tolerance"] == 0.2
    with pytest.raises(ValueError, match=r"spacing_tolerance must be below 0\.5, got 0\.5"):
        field(rough, spacing_tolerance=0.5)


# --- units ---


def flow_in(x, u_x, spin="", y=None, u_y=None, time=None):
    x_, y_ = np.meshgrid(ONE_PERIOD, ONE_PERIOD, indexing="ij")
    values = {"u_x": waves(x_, y_), "u_y": waves(y_, x_), "spin": waves(x_, y_)}
    units = {"x": x, "y": x if y is None else y, "u_x": u_x, "u_y": u_x if u_y is None else u_y, "spin": spin}
    data = xr.Dataset(
        {name: (("x", "y"), each) for name, each in values.items()}, {"x": ONE_PERIOD, "y": ONE_PERIOD}
    )
    if time is not None:
        data = xr.concat([data, data], xr.DataArray([0.0, 1.0], dims="time", name="time"))
        data.time.attrs["units"] = time
    for name, unit in units.items():
        data[name].attrs["units"] = unit
    return GriddedFlow(data, edges="periodic", spin="spin", outside_time="held")


@pytest.mark.parametrize(
    ("units", "length"),
    [
        ({"x": "meters", "u_x": "m s-1", "spin": "rad/s"}, "m"),
        ({"x": "um", "u_x": "\u00b5m/s", "y": "\u03bcm", "u_y": "micron s^-1"}, "µm"),
        ({"x": "micrometers", "u_x": "μm·s⁻¹", "spin": "s**-1"}, "µm"),
        ({"x": "mm", "u_x": "millimetre per minute", "spin": "1/min", "time": "min"}, "mm"),
        ({"x": "px", "u_x": "pixel/s", "y": "pixels"}, "pixel"),
        ({"x": "1e-3 m", "u_x": "mm/s"}, "mm"),
        ({"x": "km", "u_x": "km/h", "u_y": "kph", "time": "hours since 2000-01-01"}, "km"),
        ({"x": b"mm", "u_x": np.array([b"mm/s"]), "y": np.array(["mm"], object), "u_y": ""}, "mm"),
        ({"x": b"\xb5m", "u_x": "µm s-1", "y": "\udcb5m"}, "µm"),
        ({"x": "1", "u_x": "1", "spin": "1"}, "1"),
        ({"x": "body_lengths", "u_x": "body_lengths/s"}, "?body_lengths"),
        ({"x": "mm", "u_x": "whatever", "spin": "rad s-1"}, "mm"),
    ],
)
def test_units_are_compared_as_units(units, length):
    assert flow_in(**units).length_unit == length


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ({"x": "mm", "u_x": "px/frame"}, "u_x must be in mm per time like x and y, got 'px/frame'"),
        ({"x": "m", "u_x": "m s-1", "y": "cm"}, "x and y must have the same units, got 'm' and 'cm'"),
        (
            {"x": "mm", "u_x": "mm/s", "u_y": "m/s"},
            "u_x and u_y must have the same units, got 'mm/s' and 'm/s'",
        ),
        ({"x": "mm", "u_x": "m/s"}, "u_x must be in mm per time like x and y, got 'm/s'"),
        ({"x": "degrees_east", "u_x": "m/s", "y": "degrees_north"}, "u_x must be in degrees_east per time"),
        ({"x": "mm", "u_x": "mm/s", "spin": "Hz"}, "spin must be in radians per time, got 'Hz'"),
        ({"x": "mm", "u_x": "mm/s", "spin": "rpm"}, "spin must be in radians per time, got 'rpm'"),
        ({"x": "mm", "u_x": "mm/s", "spin": "1/min"}, "spin must be in radians per s like u_x, got '1/min'"),
        ({"x": "mm", "u_x": "mm/s", "time": "h"}, "u_x must be in mm per h like time, got 'mm/s'"),
        ({"x": "mm", "u_x": "mm/s", "time": "mm"}, "time must be in a unit of time, got 'mm'"),
        (
            {"x": "mm", "u_x": "9**9**9"},
            r"u_x: units must be names with whole powers, as m s-1, got '9\*\*9\*\*9'",
        ),
        ({"x": "m" * 200, "u_x": "m/s"}, "x: units must be names with whole powers"),
    ],
)
def test_units_that_contradict_each_other_are_errors_by_name(units, message):
    with pytest.raises(ValueError, match=message):
        flow_in(**units)


def test_a_field_and_a_flow_in_one_unit_differently_written_go_together():
    data = dataset(ONE_PERIOD, ONE_PERIOD, waves, units="micron")
    World(field=GriddedField(data, edges="periodic"), flow=flow_in("um", "µm/s"))
    with pytest.raises(ValueError, match="field and flow must have positions in the same unit"):
        World(field=GriddedField(data, edges="periodic"), flow=flow_in("mm", "mm/s"))


@pytest.mark.parametrize(
    "text", ["m/(s)", "m . s-1", "m.s-1", "m s^{-1}", "m s**-1", "m / s", "METER/s", "m × s⁻¹"]
)
def test_units_are_read_as_they_are_written(text):
    assert unit_of(text) == unit_of("m s-1")


# --- files ---


def written(path, edit, **encoding):
    """A file of c = x² + y, edited as HDF5."""
    dataset(TEN, TEN).to_netcdf(path, engine="h5netcdf", encoding={"c": encoding} if encoding else {})
    with h5py.File(path, "r+") as file:
        edit(file)
    return path


def attributed(name, value, of="c", dtype=None):
    def edit(file):
        file[of].attrs.pop(name, None)
        file[of].attrs.create(name, value, dtype=dtype)

    return edit


def unsigned(kind, text):
    """c as unsigned bytes that are stored as signed ones."""

    def edit(file):
        file["c"][...] = np.round(file["c"][...] * 2)
        values = (file["c"][...]).astype("u1").view("i1")
        scales = list(file["c"].dims[0].values()), list(file["c"].dims[1].values())
        del file["c"]
        file["c"] = values
        for dimension, found in zip(file["c"].dims, scales, strict=True):
            dimension.attach_scale(found[0])
        file["c"].attrs.create("_Unsigned", text, dtype=kind)
        file["c"].attrs["scale_factor"] = 0.5

    return edit


PACKED = {"dtype": "i4", "scale_factor": 1e-3, "add_offset": 10.0, "_FillValue": -1, "zlib": True}
VLEN, LATIN = h5py.string_dtype(), b"\xb5m"
READABLE = {
    "unsigned": (unsigned(VLEN, "true"), None),
    "unsigned bytes": (unsigned("S4", b"true"), None),
    "units of bytes": (attributed("units", np.bytes_(b"mm"), "x"), "mm"),
    "units in an array of bytes": (attributed("units", np.array([b"mm"]), "x"), "mm"),
    "units in an array of texts": (attributed("units", np.array(["mm"], object), "x", VLEN), "mm"),
    "empty units": (attributed("units", h5py.Empty("S1"), "x"), None),
    "blank units": (attributed("units", "", "x"), None),
    "Latin-1": (attributed("units", np.bytes_(LATIN), "x"), "µm"),
    "Latin-1 of any length": (attributed("units", LATIN, "x", VLEN), "µm"),
    "packed": (lambda file: None, None),
    "several missing values": (attributed("missing_value", np.array([-1.0, -2.0])), None),
    "a scale in an array": (attributed("scale_factor", np.array([1.0])), None),
    "a scalar time": (lambda file: file.create_dataset("time", data=3.0), None),
    "a time in words": (lambda file: file.create_dataset("time", data=["noon"], dtype=VLEN), None),
}


@pytest.mark.parametrize("name", READABLE)
def test_files_are_decoded_as_xarray_does(tmp_path, name):
    edit, unit = READABLE[name]
    found = field(written(tmp_path / "my.nc", edit, **(PACKED if name == "packed" else {})))
    assert found.length_unit == unit
    np.testing.assert_allclose(
        found.concentration(PLACES), field(dataset(TEN, TEN)).concentration(PLACES), atol=1e-9
    )


def without_coordinate(file):
    del file["x"]
    scale = file.create_dataset("x", data=np.zeros(10, ">f4"))
    scale.make_scale("This is a netCDF dimension but not a netCDF variable.        10")
    file["c"].dims[0].attach_scale(scale)


def replaced(name, **options):
    def edit(file):
        del file[name]
        file.create_dataset(name, **options).make_scale(name)
        file["c"].dims[0].attach_scale(file[name])

    return edit


REFUSED = {
    "a dimension without coordinate": (without_coordinate, r"c must have the coordinate x, got \['y'\]"),
    "coordinates of two dimensions": (
        replaced("x", data=np.zeros((10, 10))),
        r"x must have one dimension, got \(10, 10\)",
    ),
    "a scale in words": (attributed("scale_factor", "two"), "c must be decodable by .*two"),
    "many numbers": (
        attributed("add_offset", np.zeros(40)),
        "attribute add_offset must have at most 16 values, got 40",
    ),
    "times as a unit": (attributed("units", "furlong-", "x"), "x: units must be names with whole powers"),
    "missing": (
        lambda file: file["c"].attrs.create("_FillValue", file["c"][3, 4]),
        r"c must be finite everywhere, got nan at x = 2, y = 9",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_decoded_is_refused_by_name(tmp_path, name):
    edit, message = REFUSED[name]
    with pytest.raises(ValueError, match=message):
        field(written(tmp_path / "my.nc", edit), variable="c")


# --- holes ---


def with_holes(*, edges="clamped", **options):
    """c = x + y on [0, 9]² with land in the middle."""
    data = dataset(TEN, TEN, lambda x, y: x + y)
    data["c"][4:6, 3:7] = np.nan
    return GriddedField(data, edges=edges, **options)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize("edges", ["clamped", "periodic"])
def test_holes_are_a_border_or_filled_as_is_said(xp, interpolation, edges):
    options = {"interpolation": interpolation, "edges": edges}
    with pytest.raises(
        ValueError, match=r"c must be finite .* got nan at x = 4, y = 3 .* 8 in all\); fill, one of"
    ):
        with_holes(**options)
    land, coast, water = [4.4, 4.5], [3.5, 4.5], [2.5, 4.5]
    places = array(xp, [land, coast, water])
    inside = with_holes(fill="inside", **options)
    np.testing.assert_array_equal(to_numpy(inside.inside(places)), [False, False, True])
    assert float(inside.concentration(places)[2]) == pytest.approx(7.0, abs=0.2)
    nearest, zero = (with_holes(fill=fill, **options) for fill in ("nearest", "zero"))
    at = array(xp, [[4.0, 4.0], [5.0, 5.0]])
    np.testing.assert_allclose(to_numpy(nearest.concentration(at)), [7.0, 11.0], atol=1e-12)
    np.testing.assert_allclose(to_numpy(zero.concentration(at)), [0.0, 0.0], atol=1e-12)
    assert nearest.gradient_scale == pytest.approx(zero.gradient_scale, rel=0.9)
    assert nearest.parameters()["fill"] == "nearest"


def test_a_hole_over_the_seam_is_filled_from_the_nearest_on_both_sides():
    data = dataset(TEN, TEN, lambda x, y: np.cos(np.pi / 5 * x) + 0 * y)
    data["c"][[0, 1, 9]] = np.nan
    filled = GriddedField(data, edges=("periodic", "clamped"), fill="nearest", interpolation="linear")
    values = filled.concentration(np.array([[0.0, 2.0], [1.0, 2.0], [9.0, 2.0]]))
    np.testing.assert_allclose(values[1:], np.cos(np.pi / 5 * np.array([2.0, 8.0])), atol=1e-12)
    assert values[0] in values[1:]


def test_what_leaves_nothing_to_swim_in_is_an_error():
    data = dataset(TEN, TEN)
    with pytest.raises(ValueError, match="data must be finite somewhere, got none of 100 values"):
        field(data * np.nan, fill="inside")
    with pytest.raises(ValueError, match="c must be finite at all corners of a grid cell, got none such"):
        field(data.where((data.x + data.y) % 2 == 0), fill="inside")
    with pytest.raises(ValueError, match="fill must be one of inside, nearest, zero, got 'mean'"):
        field(data, fill="mean")


def strict(function, inside):
    """A function that answers inside only, and complains elsewhere."""

    def asked(position):
        assert np.all(to_numpy(inside(position))), "asked outside"
        return function(position)

    return asked


def disc(position):
    return (position[..., 0] - 4.0) ** 2 + (position[..., 1] - 4.0) ** 2 <= 9.0


def half(position):
    return position[..., 0] > 1.0


DOMAINS = {"disc": disc, "half": half, "both": lambda position: disc(position) & half(position)}


@pytest.mark.parametrize(
    ("name", "interval_rule"), [("disc", "truncated"), ("half", "exact"), ("both", "truncated")]
)
def test_fields_and_flows_are_never_asked_outside_and_a_life_ends_with_its_last_valid_values(
    xp, name, interval_rule
):
    inside = DOMAINS[name]
    climb = FunctionField(strict(lambda p: p[..., 1] + 20.0, inside), 1.0, inside=inside)
    drift = FunctionFlow(
        strict(lambda p: 0.1 * p, inside), 0.3, 0.1, strict(lambda p: 0.0 * p[..., 0], inside), inside=inside
    )
    world = World(
        field=climb,
        flow=drift,
        sense_flow=True,
        start_box=((0, 8), (0, 8)),
        life=30.0,
        interval_rule=interval_rule,
    )
    starts = draw_starts(world, 60, 0)
    assert inside(starts.position).all()
    state = world.start(
        array(xp, starts.position), array(xp, starts.heading), array(xp, starts.past, xp.int64)
    )
    left = np.zeros(60, bool)
    for turn in range(world.max_decisions):
        before, over = to_numpy(state.position), to_numpy(state.finished)
        state, outcome = world.step(state, array(xp, np.full(60, turn % 2), xp.int64))
        now = to_numpy(outcome.truncated) & ~over & (turn < world.max_decisions - 1)
        left |= now
        np.testing.assert_array_equal(to_numpy(state.position)[now | over], before[now | over])
        assert np.isfinite(to_numpy(outcome.observation)).all()
        gain = to_numpy(state.position)[:, 1] - starts.position[:, 1]
        np.testing.assert_allclose(to_numpy(outcome.gain), gain, atol=1e-12)
    assert left.sum() > 1


def test_an_egg_that_is_met_on_a_way_out_is_reached():
    inside = half
    egg = FunctionField(
        strict(lambda p: -p[..., 0], inside), 1.0, egg_position=(1.2, 0.0), egg_radius=0.15, inside=inside
    )
    world = World(field=egg, n_records=2, curvatures=(0.2, 0.4), interval_rule="exact")
    position = np.array([[2.0, 0.0]])
    state = world.start(position, np.array([np.pi]), np.zeros((1, 2), int))
    _, outcome = world.step(state, np.array([0]))
    assert outcome.terminated.item()
    assert not outcome.truncated.item()
    assert np.isfinite(outcome.gain).all()


def test_starts_are_drawn_where_the_water_is():
    land = with_holes(fill="inside")
    world = World(field=land)
    assert land.inside(draw_starts(world, 500, 3).position).all()
    np.testing.assert_array_equal(  # and the others are where they were
        *(
            draw_starts(each, 500, 3).position[
                land.inside(draw_starts(World(start_box=land.box), 500, 3).position)
            ]
            for each in (world, World(start_box=land.box))
        )
    )
    with pytest.raises(ValueError, match="start_box must leave room in the domain"):
        draw_starts(world.replace(start_box=((4.2, 4.8), (4.0, 5.0))), 4, 0)


# --- rounding ---


@pytest.mark.parametrize("value", [0.1, 1e6 / 3, -7e-9, 1e-200])
@pytest.mark.parametrize("edges", ["clamped", "periodic"])
@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_a_constant_has_no_gradient_and_no_spin(xp, value, edges, interpolation):
    options = {"edges": edges, "interpolation": interpolation}
    data = dataset(ONE_PERIOD, ONE_PERIOD, lambda x, y: value + 0 * x)
    with pytest.raises(ValueError, match="gradient_scale must be given where the field has no gradient"):
        GriddedField(data, **options)
    uniform = GriddedFlow(data.assign(u=data["c"] * 2), velocity=("c", "u"), **options)
    assert (uniform.spin_scale, uniform.max_spin) == (UniformFlow().spin_scale, 0.0)
    assert not to_numpy(uniform.spin(array(xp, PLACES))).any()
    if abs(value) < 1:
        world = World(flow=uniform, sense_flow=True)
        starts = draw_starts(world, 5, 0)
        assert not world.observation(world.start(*starts)).reshape(5, 4, 5)[..., 4].any()


def test_a_small_gradient_is_measured_and_still_water_is_an_error():
    assert field(dataset(TEN, TEN, lambda x, y: 1 + 1e-6 * x)).gradient_scale == pytest.approx(1e-6, rel=1e-6)
    still = dataset(TEN, TEN, lambda x, y: 0 * x)
    with pytest.raises(ValueError, match=r"speed_scale must be a finite number above 0, got 0\.0"):
        GriddedFlow(still.assign(u=still["c"]), velocity=("c", "u"), edges="clamped")


# --- time ---

TIMES = np.array([0.0, 1.0, 4.0, 5.0])


def changing(kind=GriddedField, outside_time="held", **options):
    """sin(t)-weighted waves at uneven times."""
    x, y = np.meshgrid(ONE_PERIOD, ONE_PERIOD, indexing="ij")
    values = {"c": waves(x, y), "u_x": waves(y, x), "u_y": evens(x, y)}
    over = {
        name: (("time", "x", "y"), np.sin(TIMES)[:, None, None] * each + each)
        for name, each in values.items()
    }
    data = xr.Dataset(over, {"time": TIMES, "x": ONE_PERIOD, "y": ONE_PERIOD})
    options |= {"variable": "c"} if kind is GriddedField else {}
    return kind(data, edges="periodic", outside_time=outside_time, **options)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_data_in_time_are_linear_between_their_times_and_held_outside(xp, interpolation):
    moving, flow = (changing(kind, interpolation=interpolation) for kind in (GriddedField, GriddedFlow))
    steady = GriddedField(
        dataset(ONE_PERIOD, ONE_PERIOD, waves), edges="periodic", interpolation=interpolation
    )
    places = array(xp, PLACES)
    unit = to_numpy(steady.concentration(places))
    for time in (-3.0, 0.0, 0.3, 1.0, 2.5, 4.0, 4.9, 5.0, 77.0, 2):
        expected = unit * (1 + np.interp(time, TIMES, np.sin(TIMES)))
        np.testing.assert_allclose(
            to_numpy(moving.at(time).concentration(places)), expected, rtol=0, atol=1e-12
        )
        times = array(xp, np.full((3, 1), float(time)))
        for view in (moving.at(times), moving.at(np.float64(time)), moving.at(times[0, 0])):
            found = to_numpy(view.concentration(places))
            np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=0, atol=1e-12)
    several = array(xp, RNG.uniform(-1, 6, (4, 50)))
    velocity, spin = flow.at(several).velocity(places), flow.at(several).spin(places)
    assert velocity.shape == (4, 50, 2)
    assert spin.shape == (4, 50)
    alone = flow.at(float(several[2, 7]))
    np.testing.assert_allclose(to_numpy(velocity)[2, 7], to_numpy(alone.velocity(places))[7], atol=1e-12)
    np.testing.assert_allclose(to_numpy(spin)[2, 7], to_numpy(alone.spin(places))[7], atol=1e-12)
    np.testing.assert_array_equal(
        to_numpy(moving.concentration(places)), to_numpy(moving.at(0.0).concentration(places))
    )


def test_a_view_shares_scales_box_and_domain_and_knows_its_largest_rate():
    moving = changing()
    view = moving.at(2.0)
    assert (view.gradient_scale, view.box, view.inside) == (moving.gradient_scale, moving.box, moving.inside)
    times = np.linspace(0, 5, 4001)[:, None]
    rates = np.diff(moving.at(times).concentration(PLACES), axis=0) / np.diff(times, axis=0)
    assert 0.5 * moving.max_rate < np.abs(rates).max() <= moving.max_rate
    assert not hasattr(GriddedField(dataset(TEN, TEN), edges="clamped"), "at")
    assert "4 times" in repr(moving)
    assert moving.parameters()["shape"] == [4, 16, 16]


def test_outside_its_times_data_are_an_error_where_that_is_asked_for():
    ending = changing(outside_time="error")
    ending.at(5.0).concentration(PLACES)
    for time in (-0.1, 5.1, np.array([1.0, 6.0]), np.inf):
        with pytest.raises(ValueError, match=r"time must lie within that of the data, 0 to 5, got .*'held'"):
            ending.at(time)
    World(field=ending, life=5.0)
    with pytest.raises(
        ValueError, match=r"field must have data for all times from 0 to the life 6, .* got 0 to 5"
    ):
        World(field=ending, life=6.0)
    with pytest.raises(
        ValueError, match="outside_time must be one of error, held where data have a time, got None"
    ):
        changing(outside_time=None)


def test_traced_times_work_and_give_nan_where_an_error_cannot_be_raised():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    jnp = jax.numpy
    places = jnp.asarray(PLACES)
    for kind in ("held", "error"):
        moving = changing(outside_time=kind)
        at = jax.jit(lambda time, moving=moving: moving.at(time).concentration(places))
        expected = moving.at(2.5).concentration(PLACES)
        np.testing.assert_allclose(at(2.5), expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(at(jnp.full(50, 2.5)), expected, rtol=0, atol=1e-12)
        assert bool(jnp.isnan(at(9.0)).all()) == (kind == "error")


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0, 1, 1, 2], "time must have every moment once, got 1 twice"),
        ([0, 1, np.nan, 2], "time must be finite, got nan"),
        (np.array([0, 1, 2, 3], "M8[s]"), "time must hold real numbers, got datetime64"),
        (np.array([0, 1, 2, 3], "m8[s]"), "time must hold real numbers, got timedelta64"),
    ],
)
def test_times_that_are_none_are_errors(times, message):
    data = xr.concat([dataset(TEN, TEN)] * 4, xr.DataArray(times, dims="time", name="time"))
    with pytest.raises(ValueError, match=message):
        field(data, outside_time="held")


def test_one_moment_is_steady():
    data = dataset(TEN, TEN).expand_dims(time=[3.0])
    assert not hasattr(field(data), "at")
    np.testing.assert_array_equal(
        field(data).concentration(PLACES), field(dataset(TEN, TEN)).concentration(PLACES)
    )


# --- records ---


@pytest.mark.parametrize("stored", [True, False])
def test_results_carry_what_their_grid_was(tmp_path, stored):
    data = dataset(TEN, TEN)
    data.to_netcdf(tmp_path / "c.nc", engine="h5netcdf")
    made = field(str(tmp_path / "c.nc") if stored else data, fill="nearest", spacing_tolerance=0.1)
    results = population_test(World(field=made), {}, cells=2, life=2, limit=False)
    told = data_of(results)["field"]
    assert told["shape"] == [10, 10]
    assert told["edges"] == "clamped"
    assert len(told["sha256"]) == 64
    assert (told["gradient_scale"], told["fill"]) == (made.gradient_scale, "nearest")
    assert data_of(population_test(World(), {}, cells=1, life=1, limit=False)) == {}


def test_data_in_memory_are_known_by_their_numbers():
    one, other = field(dataset(TEN, TEN)), field(dataset(TEN, TEN) + 1e-12)
    told = FIELDS.describe(one)
    assert (told["path"], len(told["sha256"]), told["shape"]) == (None, 64, [10, 10])
    with pytest.raises(TypeError, match="or the path of a NetCDF file, or bare arrays by name, got NoneType"):
        FIELDS.make(told)
    numbers = [each.parameters()["sha256"] for each in (one, other, field(dataset(TEN[::-1], TEN)))]
    assert numbers[0] == numbers[2] != numbers[1]
    field(dataset(TEN, TEN), sha256=numbers[0])
    with pytest.raises(ValueError, match=f"data must have the SHA-256 {numbers[1]}, got {numbers[0]}"):
        field(dataset(TEN, TEN), sha256=numbers[1])


# --- perturbations ---


@pytest.mark.parametrize(("n_records", "strength"), [(2, 0.3), (4, 0.05), (8, 2.0)])
def test_the_memory_that_a_life_starts_with_is_as_noisy_as_what_is_recorded_later(n_records, strength):
    quiet = World(n_records=n_records, field=LinearField(offset=0.0))
    loud = quiet.replace(concentration_noise=strength)
    starts = draw_starts(loud, 2000, 5)
    numbers = draw_record_noise(loud, 2000, 5)
    noise = (loud.start(*starts, noise=numbers).memory - quiet.start(*starts).memory)[
        ..., 0
    ] / loud.record_scale
    np.testing.assert_allclose(noise, strength * numbers, rtol=0, atol=1e-9)
    assert np.std(numbers) == pytest.approx(1.0, rel=0.05)
    np.testing.assert_array_equal(draw_record_noise(loud, 3, 5), numbers[:3])
    assert draw_record_noise(quiet, 3, 5) is None
    assert loud.start(*starts).start_concentration == pytest.approx(quiet.start(*starts).start_concentration)


@pytest.mark.parametrize(
    "options",
    [{"n_records": 2}, {"n_records": 8}, {"n_records": 4, "speed": 2.0}, {"varying_speed": True}],
    ids=str,
)
def test_a_curvature_diffusion_turns_headings_alike_however_often_cells_decide(options):
    world = World(curvature_diffusion=0.02, life=20.0, **options)
    quiet, cells = world.replace(curvature_diffusion=0.0), 3000
    starts = draw_starts(world, cells, 1)
    state, still = world.start(*starts), quiet.start(*starts)
    for turn in range(int(8.0 / max(world.intervals))):
        action, noise = np.full(cells, turn % 2), RNG.standard_normal((cells, 3))
        state, still = world.step(state, action, noise)[0], quiet.step(still, action)[0]
    cosine = (state.heading * still.heading).sum(-1).mean()
    assert -np.log(cosine) / world.time(state)[0] == pytest.approx(0.02, rel=0.08)
    both = world.replace(curvature_noise=0.3)
    interval, speed = both.intervals[0], both.action_speeds[0]
    assert both.curvature_spreads[0] ** 2 == pytest.approx(0.3**2 + 2 * 0.02 / (speed**2 * interval))
    assert problem_of(world) is None
