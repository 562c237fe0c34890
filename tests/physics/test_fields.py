"""Built-in fields: what they compute and the bounds they promise."""

import functools
import math
import warnings

import numpy as np
import pytest

from swarm.physics.fields import (
    DiffusingSource,
    Field,
    FunctionField,
    GaussianPlume,
    LinearField,
    RadialField,
)
from swarm.physics.world import World, rules
from tests.reference import array, slopes_of, to_numpy

FIELDS = [
    LinearField(),
    LinearField(gradient_scale=2.5, offset=-1.0),
    RadialField(),
    RadialField(gradient_scale=0.5, offset=3.0, egg_radius=0.2),
    GaussianPlume(),
    GaussianPlume(gradient_scale=3.0, width=2.0, offset=1.0, egg_position=(4.0, -2.0), egg_radius=None),
    DiffusingSource(),
    DiffusingSource(gradient_scale=0.1, distance=5.0, core=2.0, offset=7.0, egg_position=(1.0, 1.0)),
    FunctionField(lambda r: 3.0 * r[..., 0] + 1.0, gradient_scale=3.0, max_gradient=3.0),
]
each_field = pytest.mark.parametrize("field", FIELDS, ids=lambda field: type(field).__name__)


@each_field
def test_a_field_keeps_the_shape_and_dtype_of_positions(xp, field):
    assert isinstance(field, Field)
    for dtype in (xp.float32, xp.float64):
        for shape in ((), (3,), (2, 3), (0,)):
            concentration = field.concentration(array(xp, np.full((*shape, 2), 1.5), dtype))
            assert concentration.shape == shape
            assert concentration.dtype == dtype


@each_field
def test_no_gradient_is_steeper_than_the_stated_bound(field):
    places = np.random.default_rng(0).normal(0, 10, (4000, 2))
    steepest = np.linalg.norm(slopes_of(field.concentration, places), axis=-1).max()
    assert steepest <= field.max_gradient * (1 + 1e-6)
    assert steepest > 0.7 * field.max_gradient


@pytest.mark.parametrize(
    ("field", "places", "expected"),
    [
        (LinearField(gradient_scale=2.0, offset=3.0), [[5.0, 0.0], [-1.0, 2.0]], [3.0, 7.0]),
        (RadialField(gradient_scale=2.0, offset=30.0), [[3.0, 4.0], [0.0, 0.0]], [20.0, 30.0]),
        (FunctionField(lambda r: r[..., 0] ** 2, gradient_scale=1.0), [[3.0, 1.0]], [9.0]),
    ],
)
def test_simple_fields_are_as_they_are_written(xp, field, places, expected):
    np.testing.assert_allclose(to_numpy(field.concentration(array(xp, places))), expected, rtol=1e-15)


def test_the_gaussian_plume_is_steepest_at_its_width():
    field = GaussianPlume(gradient_scale=2.0, width=3.0, egg_position=(1.0, 2.0))
    at_width = slopes_of(
        field.concentration, np.array([[1.0 + 3.0 / math.sqrt(2), 2.0 - 3.0 / math.sqrt(2)]])
    )
    np.testing.assert_allclose(np.linalg.norm(at_width), 2.0, rtol=1e-9)
    np.testing.assert_allclose(field.concentration(np.array([1.0, 2.0])), field.amplitude)
    np.testing.assert_allclose(field.concentration(np.array([100.0, 100.0])), field.offset, atol=1e-12)


def test_the_diffusing_source_has_its_typical_gradient_at_the_stated_distance():
    field = DiffusingSource(gradient_scale=0.7, distance=6.0, core=1.5, offset=2.0, egg_position=(1.0, 0.0))
    np.testing.assert_allclose(
        slopes_of(field.concentration, np.array([[1.0, 6.0]])), [[0.0, -0.7]], atol=1e-8
    )
    # far away c − c₀ = s/r, which solves the diffusion equation in three dimensions
    far = field.concentration(np.array([[1001.0, 0.0], [2001.0, 0.0]])) - 2.0
    np.testing.assert_allclose(far[0] / far[1], 2.0, rtol=1e-5)


@pytest.mark.parametrize("value", [1.0, (1.0,), (1.0, 2.0, 3.0, 4.0), (1.0, math.inf), ("x", "y"), None])
def test_an_egg_must_lie_somewhere(value):
    rule = r"egg_position must be two finite numbers \(x, y\), or three in space, got"
    with pytest.raises((TypeError, ValueError), match=rule):
        GaussianPlume(egg_position=value)


def test_parameters_are_kept_as_plain_floats(xp):
    # a NumPy float64 would turn float32 arrays into float64 ones, and torch tensors into NumPy arrays
    field = LinearField(gradient_scale=np.float64(2.0), offset=np.int64(3))
    assert type(field.gradient_scale) is type(field.offset) is float
    assert field.concentration(array(xp, [[0.0, 1.0]], xp.float32)).dtype == xp.float32


class Moving:
    """A user's own, which cells may ask in its domain only: steep at the end of life."""

    gradient_scale = 1.0

    def at(self, time):
        return FunctionField(functools.partial(self.climb, time), self.gradient_scale)

    def inside(self, position):
        return position[..., 0] < 5.0

    def climb(self, time, position):
        assert np.all(self.inside(position))
        return 0.2 * time * position[..., 1]

    def concentration(self, position):
        return self.climb(0.0, position)


@pytest.mark.parametrize(
    ("slope", "warns"), [(1.0, False), (1.99, False), (0.51, False), (2.1, True), (0.4, True), (0.0, False)]
)
def test_a_scale_is_warned_of_once_where_gradients_are_others(slope, warns):
    field = FunctionField(lambda r: 20.0 + slope * (0.6 * r[..., 0] - 0.8 * r[..., 1]), gradient_scale=1.0)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for life in (80.0, 8.0):
            World(field=field, life=life)
    assert [f"{slope} sampled where lives start, got 1" in str(each.message) for each in told] == [
        True
    ] * warns
    assert World(field=field, life=4.0).field is field


def test_a_scale_is_compared_in_the_start_box_over_a_life():
    with pytest.warns(UserWarning, match="0.089 sampled"):
        World(field=FunctionField(lambda r: 0.01 * r[..., 0] ** 2, 1.0), start_box=((4.4, 4.5), (0.0, 9.0)))
    with pytest.warns(UserWarning, match="10.3 sampled"):
        World(field=Moving(), life=80.0)
    World(field=Moving(), life=8.0)
    World(field=FunctionField(lambda r: r[..., 0].cos(), 1.0))  # of another library's arrays
    World(field=FunctionField(lambda r: np.log(r[..., 0] - 20.0), 1.0))  # nowhere there


def test_a_world_s_own_fields_are_not_looked_at(monkeypatch):
    monkeypatch.setattr(rules, "typical_gradient", lambda world: pytest.fail("it was"))
    World(field=GaussianPlume(gradient_scale=2.0, width=1.0, egg_position=(90.0, 0.0)))
