"""Errors of parameters: each names the thing, the rule and the value."""

import functools
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm._support.checks import (
    check_box,
    check_cells,
    check_count,
    check_flag,
    check_function,
    check_methods,
    check_name,
    check_number,
    check_pair,
)
from swarm.physics.fields import DiffusingSource, FunctionField, GaussianPlume, LinearField, RadialField
from swarm.physics.flows import FunctionFlow, PoiseuilleFlow, ShearFlow, StillWater, TaylorGreen, Vortex
from swarm.physics.world import World
from tests.reference import array


def error_of(make):
    """The error that `make` raises, or None; anything but TypeError and ValueError passes through."""
    try:
        make()
    except (TypeError, ValueError) as error:
        return error
    return None


ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.text(max_size=5),
    st.binary(max_size=3),
    st.complex_numbers(),
    st.lists(st.floats(), max_size=4),
    st.dictionaries(st.text(max_size=2), st.integers(), max_size=2),
    st.floats(),
    st.integers(),
    st.builds(object),
)


@given(ANYTHING)
def test_whatever_is_no_finite_number_is_an_error_that_shows_it(value):
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        if math.isfinite(value):
            for number in (value, np.float64(value)):
                checked = check_number("thing", number)
                assert (type(checked), checked) == (float, float(value))
            return
        with pytest.raises(ValueError, match=r"^thing must be a finite number, got") as caught:
            check_number("thing", value)
    else:
        with pytest.raises(TypeError, match=r"^thing must be a finite number, got") as caught:
            check_number("thing", value)
    assert str(caught.value).endswith(repr(value))


@pytest.mark.parametrize(
    ("bounds", "bad", "message"),
    [
        ({"above": 0.0}, 0.0, "thing must be a finite number above 0, got 0.0"),
        ({"above": 0.0}, -math.inf, "thing must be a finite number above 0, got -inf"),
        ({"at_least": 2.0}, 1.5, "thing must be a finite number of at least 2, got 1.5"),
        ({}, 10**400, "thing must be a finite number, got 1000"),
        ({}, math.nan, "thing must be a finite number, got nan"),
    ],
)
def test_numbers_out_of_bounds_are_errors(bounds, bad, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        check_number("thing", bad, **bounds)
    assert check_number("thing", 2, at_least=2.0) == 2.0
    assert check_number("thing", 5e-324, above=0.0) == 5e-324


KNOWN = functools.partial(check_name, known=["linear", "radial"])
WATER = functools.partial(check_methods, methods=["velocity", "spin"], attributes=["speed_scale"])
COUNT, FLAG = r"a whole number of at least 1, got ", "True or False, got "
BOX = r"\(\(x_low, x_high\), \(y_low, y_high\)\) with low <= high, got "


@pytest.mark.parametrize(
    ("check", "values", "error", "rule"),
    [
        (check_count, (True, 1.0, "1", None, [1]), TypeError, COUNT),
        (check_count, (0, -1), ValueError, COUNT),
        (check_count, (10**20,), ValueError, f"at most {2**63 - 1}, got {10**20}"),
        (check_flag, (1, 0, "yes", None), TypeError, FLAG),
        (KNOWN, ("lineal",), ValueError, r"one of linear, radial, got 'lineal'; did you mean 'linear'\?$"),
        (KNOWN, ("zzz",), ValueError, "one of linear, radial, got 'zzz'$"),
        (KNOWN, (3,), TypeError, "one of linear, radial, got 3"),
        (check_box, (3, [1, 2], ((0, 1), (2, 1)), ((0, 1),), "ab"), ValueError, BOX),
        (check_box, (((0, math.nan), (0, 1)), ((0, 1, 2), (0, 1))), ValueError, BOX),
    ],
)
def test_a_check_names_the_rule_and_the_value(check, values, error, rule):
    for value in values:
        with pytest.raises(error, match=f"^thing must be {rule}") as caught:
            check("thing", value)
        assert f"{value!r}" in str(caught.value)


def test_what_lacks_methods_is_told_which():
    with pytest.raises(
        TypeError, match=r"thing must have velocity\(position\), .*, speed_scale, got <object"
    ):
        WATER("thing", object())
    with pytest.raises(TypeError, match=r"must be an object, not a class.*did you mean StillWater\(\)"):
        WATER("thing", StillWater)


def test_a_check_returns_plain_values():
    assert check_count("thing", np.int32(3)) == 3
    assert check_function("thing", len) is len
    assert check_pair("thing", [1, np.float32(2)]) == (1.0, 2.0)
    assert check_box("thing", [[0, 1], (2, 2)]) == ((0.0, 1.0), (2.0, 2.0))


def test_the_first_bad_cell_is_named(xp):
    good = array(xp, [[True, True, True], [True, False, False]])
    value = array(xp, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    with pytest.raises(ValueError, match=r"^thing must be good, got 5 for cell 1$"):
        check_cells("thing", "be good", value, good)
    check_cells("thing", "be good", value, array(xp, np.ones((2, 3), bool)))


NUMBERS = {
    "life": "above 0",
    "speed": "above 0",
    "time_step": "above 0",
    "concentration_noise": "of at least 0",
    "curvature_noise": "of at least 0",
    "rotational_diffusion": "of at least 0",
    "curvature_diffusion": "of at least 0",
}


@pytest.mark.parametrize("name", NUMBERS)
@given(value=ANYTHING)
def test_any_value_of_a_number_makes_a_world_or_a_clear_error(name, value):
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    error = error_of(lambda: World(**{name: value}))
    if error is None:
        assert number
        assert getattr(World(**{name: value}), name) == float(value)
    elif number:
        assert isinstance(error, ValueError)
        assert name in str(error)
    else:
        assert isinstance(error, TypeError)
        assert str(error) == f"{name} must be a finite number {NUMBERS[name]}, got {value!r}"


@pytest.mark.parametrize("name", ["n_records", "sense_flow", "varying_speed", "interval_rule", "start_box"])
@given(value=ANYTHING)
def test_any_value_of_another_parameter_makes_a_world_or_an_error_that_names_it(name, value):
    error = error_of(lambda: World(**{name: value}))
    assert error is None or name in str(error)


@pytest.mark.parametrize("name", ["field", "flow"])
@given(value=ANYTHING)
def test_what_is_no_field_or_flow_is_an_error(name, value):
    with pytest.raises((TypeError, ValueError), match=f"^{name} must "):
        World(**{name: value})


@given(st.lists(st.one_of(st.floats(), st.floats(0.1, 10.0), st.integers(-3, 8)), max_size=5))
def test_curvatures_rise_evenly_or_are_an_error(values):
    error = error_of(lambda: World(curvatures=tuple(values)))
    if error is None:
        curvatures = World(curvatures=tuple(values)).curvatures
        assert len(curvatures) >= 2
        assert curvatures[0] > 0
        np.testing.assert_allclose(np.diff(curvatures), np.diff(curvatures)[0], rtol=1e-6)
    else:
        assert isinstance(error, ValueError)
        assert any(word in str(error) for word in ("curvature", "κ̄"))


STEERED, NEIGHBOURS = {"action": "continuous"}, "memory_with_neighbours"


class Scaled:
    """A flow of which all scales and bounds can be set."""

    max_speed = max_spin = max_shear = 0.1

    def __init__(self, speed_scale=0.1, spin_scale=0.1):
        self.speed_scale, self.spin_scale = speed_scale, spin_scale

    def velocity(self, position):
        return 0.1 + 0.0 * position

    def spin(self, position):
        return 0.0 * position[..., 0]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"curvatures": (5.0, 3.0)}, r"curvatures must rise and be positive, got \(5\.0, 3\.0\)"),
        ({"curvatures": (1.0, 2.0, 4.0)}, r"curvatures must be evenly spaced, got \(1\.0, 2\.0, 4\.0\)"),
        ({"curvatures": (3.0,)}, r"curvatures must be two or more numbers, got \(3\.0,\)"),
        ({"curvatures": (0.0, 3.0)}, r"curvatures must rise and be positive, got \(0\.0, 3\.0\)"),
        ({"curvatures": (0.001, 0.002, 0.0030001)}, "curvatures must be evenly spaced, got"),
        ({"curvatures": "35"}, r"curvatures must be two or more numbers, got '35'"),
        ({"speeds": (1.0, -1.0)}, r"speeds must be two positive numbers, got \(1\.0, -1\.0\)"),
        ({"speeds": 1.0}, r"speeds must be two positive numbers, got 1\.0"),
        ({"n_records": 1}, "n_records must be a whole number of at least 2, got 1"),
        ({"n_records": 100}, "n_records must leave at least one time_step per decision.*got n_records = 100"),
        ({"time_step": 1.0}, "n_records must leave at least one time_step per decision.*time_step = 1"),
        ({"time_step": 1e-9}, "time_step must leave at most 10000 steps per decision, got time_step = 1e-09"),
        ({"life": 3e7}, r"life must be at most 2\^30 ticks of 0\.02, got 3e\+07"),
        ({"speed": 1e-300}, r"curvature × speed must lie between 1e-9 and 1e9 .* \(4e-300, 4e-300\)"),
        ({"speed": 1e300}, r"mean curvature × speed must lie between 1e-9 and 1e9 .*, got \(4e\+300, "),
        ({"interval_rule": "exakt"}, "interval_rule must be one of common, exact, .*; did you mean 'exact'"),
        ({"flow": "taylor-green"}, "flow must be one of .*, got 'taylor-green'; did you mean 'taylor_green'"),
        ({"field": LinearField}, r"field must be an object, not a class.*did you mean LinearField\(\)"),
        ({"flow": LinearField()}, r"flow must have velocity\(position\), .*, speed_scale, spin_scale"),
        ({"field": np.sin}, r"swarm\.FunctionField\(function, gradient_scale=…\) with .* \|∇c\|, got <"),
        ({"flow": np.sin}, r"swarm\.FunctionFlow\(function, speed_scale=…, spin_scale=…\) with"),
        ({"field": np.ones((3, 3))}, r"swarm\.GriddedField\(data, edges=…\) of data on a grid, got ndarray"),
        ({"field": TaylorGreen()}, r"field must have concentration\(position\), gradient_scale"),
        (
            {"sense_flow": True},
            "sense_flow must go with a flow with speed_scale .* above 0.*got speed_scale 0",
        ),
        ({"sense_flow": True, "flow": Scaled(0.1, 0.0)}, "sense_flow must .*got .*0.1 and spin_scale 0"),
        ({"sense_flow": True, "flow": Scaled(0.0, 0.1)}, "sense_flow .* speed_scale 0 and spin_scale 0.1"),
        ({"flow": TaylorGreen(speed_scale=1e3, wavenumber=1e3)}, "flow must vary slowly enough"),
        ({"action": "smooth"}, "action must be one of continuous, discrete, got 'smooth'"),
        ({"curvature_range": (0, 5)}, r"curvature_range must go with action='continuous', got \(0.0, 5.0\)"),
        (STEERED | {"curvature_range": (5, 0)}, r"curvature_range must rise, got \(5, 0\)"),
        (STEERED | {"curvature_range": (0, math.inf)}, "curvature_range must be two finite"),
        (STEERED | {"curvature_range": (0, 1e10)}, "must lie below 1e9 rad per time, got"),
        (STEERED | {"varying_speed": True}, "must go with one speed, got varying_speed=True"),
        ({"reward": "arrival"}, "'arrival' must go with first_arrivals"),
        ({"reward": "eaten"}, "'eaten' must go with a medium with uptake, got medium=None"),
        ({"reward": "eaten", "medium": {}}, "'eaten' must go with a medium with uptake"),
        ({"sensor": "memory_with_traits"}, "memory_with_traits must go with a world that has a spread"),
        ({"sensor": {"type": NEIGHBOURS, "k": 0}}, "k must be a whole number of at least 1"),
        ({"sensor": {"type": NEIGHBOURS, "range": 0}}, "range must be a finite number above 0"),
        ({"sensor": NEIGHBOURS, "varying_speed": True}, "interval_rule must be 'common'"),
        ({"sensor": "memory", "sense_flow": True}, r"sense_flow must go with .*, got Memory\(\)"),
        ({"first_arrivals": 1}, "first_arrivals must go with a field that has an egg, got LinearField"),
        ({"block_delay": 1}, "block_delay must go with first_arrivals, got 1 without"),
        ({"binding_rate": 1, "concentration_noise": 0.1}, "concentration_noise must be 0 .* got 0.1"),
        ({"spread": {"speed": 0.4}}, "spread.speed must be below 1/3, so that no cell .* got 0.4"),
    ],
)
def test_an_error_names_the_parameter_the_rule_and_the_value(parameters, message):
    with pytest.raises((TypeError, ValueError), match=message):
        World(**parameters)


class Odd(RadialField):
    """A field whose further attributes are what a test says."""

    max_gradient = 1.0

    def __init__(self, **options):
        super().__init__()
        for name, value in options.items():
            object.__setattr__(self, name, value)


BOUNDS = ("speed_scale", "spin_scale", "max_speed", "max_spin", "max_shear", "max_frequency")


@pytest.mark.parametrize(
    ("part", "option", "value", "rule"),
    [
        *(
            ("flow", name, value, "a finite number of at least 0")
            for name in BOUNDS
            for value in (-1.0, "fast")
        ),
        ("flow", "period", 0.0, "a finite number above 0"),
        ("field", "gradient_scale", 0.0, "a finite number above 0"),
        ("field", "max_gradient", -1.0, "a finite number of at least 0"),
        ("field", "max_rate", math.inf, "a finite number of at least 0"),
        ("field", "egg_radius", -1.0, "a finite number above 0"),
        ("field", "egg_position", (1.0,), "two finite numbers .*"),
        ("field", "inside", 3, "a function of positions .*"),
        ("field", "box", ((0, 1), (1, 0)), ".* with low <= high"),
    ],
)
def test_a_part_with_a_wrong_attribute_is_an_error(part, option, value, rule):
    given = {"flow": Scaled, "field": Odd}[part]()
    World(**{part: given})
    object.__setattr__(given, option, value)
    with pytest.raises(
        (TypeError, ValueError), match=rf"^{part}\.{option} must be {rule}, got {re.escape(repr(value))}"
    ):
        World(**{part: given})


def test_an_egg_without_a_position_lies_at_the_origin():
    class Nest:
        gradient_scale = 1.0
        egg_radius = 0.5

        def concentration(self, position):
            return position[..., 1]

    assert World(field=Nest()).egg == ((0.0, 0.0), 0.5)


def test_a_world_holds_tuples_and_plain_numbers():
    lists = World(curvatures=[3, 5], speeds=[1.2, 0.8], start_box=[[0, 1], [2, 3]])
    tuples = World(curvatures=(3.0, 5.0), speeds=(1.2, 0.8), start_box=((0.0, 1.0), (2.0, 3.0)))
    assert lists == tuples
    assert hash(lists) == hash(tuples)
    world = World(n_records=np.int64(4), life=np.float32(2e7), speed=1)
    assert (type(world.n_records), type(world.life), type(world.speed)) == (int, float, float)
    assert world.life_ticks == 10**9  # as many as can be counted


def test_replace_checks_again_and_suggests_parameters():
    assert World().replace(life=7).life == 7.0
    with pytest.raises(ValueError, match=r"^parameter must be one of .*'lifes'; did you mean 'life'"):
        World().replace(lifes=7)
    with pytest.raises(ValueError, match="life must be a finite number above 0, got -1"):
        World().replace(life=-1)


def height(position):
    return position[..., 1]


FIELD = {"function": height, "gradient_scale": 2.0}
FLOW = {"function": height, "speed_scale": 1.0, "spin_scale": 1.0}
POSITIVE = [
    (LinearField, {}, ["gradient_scale"]),
    (RadialField, {}, ["gradient_scale", "egg_radius"]),
    (GaussianPlume, {}, ["gradient_scale", "width", "egg_radius"]),
    (DiffusingSource, {}, ["gradient_scale", "distance", "core", "egg_radius"]),
    (FunctionField, FIELD, ["gradient_scale", "max_gradient", "egg_radius"]),
    (TaylorGreen, {}, ["speed_scale", "wavenumber"]),
    (ShearFlow, {}, ["speed_scale", "height"]),
    (PoiseuilleFlow, {}, ["speed_scale"]),
    (Vortex, {}, ["speed_scale", "core"]),
    (FunctionFlow, FLOW, ["speed_scale", "spin_scale", "period"]),
]
CASES = [(kind, given, name) for kind, given, names in POSITIVE for name in names]


@pytest.mark.parametrize(("kind", "given", "name"), CASES, ids=lambda v: getattr(v, "__name__", str(v))[:20])
def test_every_scale_and_length_of_a_part_is_a_positive_number(kind, given, name):
    part = kind(**{**given, name: np.float32(0.125)})
    assert getattr(part, name) == 0.125
    assert type(getattr(part, name)) is float
    for value in (0, 0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match=f"^{name} must be a finite number above 0, got {value}"):
            kind(**{**given, name: value})
    for value in ("1", [1.0], True):
        with pytest.raises(TypeError, match=f"^{name} must be a finite number above 0, got"):
            kind(**{**given, name: value})


@pytest.mark.parametrize(
    ("kind", "given", "name", "good", "rule"),
    [
        *(
            (kind, {}, "offset", -3, "")
            for kind in (LinearField, RadialField, GaussianPlume, DiffusingSource)
        ),
        *((FunctionFlow, FLOW, name, 0, " of at least 0") for name in ("max_speed", "max_spin")),
    ],
)
def test_other_numbers_of_a_part_have_their_own_rule(kind, given, name, good, rule):
    found = getattr(kind(**given, **{name: good}), name)
    assert (type(found), found) == (float, good)
    with pytest.raises(ValueError, match=f"^{name} must be a finite number{rule}, got nan"):
        kind(**given, **{name: math.nan})


@pytest.mark.parametrize(("kind", "given"), [(FunctionField, FIELD), (FunctionFlow, FLOW)])
def test_functions_and_boxes_of_function_parts_are_checked(kind, given):
    assert kind(**given, box=[[0, 1], [2, 3]]).box == ((0.0, 1.0), (2.0, 3.0))
    assert kind(**given, inside=height).inside is height
    with pytest.raises(ValueError, match=r"^box must be \(\(x_low"):
        kind(**given, box=[[1, 0], [2, 3]])
    with pytest.raises(TypeError, match=r"^inside must be a function of positions .* got 3"):
        kind(**given, inside=3)
    with pytest.raises(TypeError, match=r"^function must be a function of positions .* got None"):
        kind(**{**given, "function": None})
    if kind is FunctionFlow:
        with pytest.raises(TypeError, match=r"^spin_function must be a function of positions .* got 3"):
            kind(**given, spin_function=3)
