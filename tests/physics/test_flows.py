"""Built-in flows: spin is half the vorticity, no water is made, and bounds hold."""

import math

import numpy as np
import pytest

from swarm.physics.flows import (
    DoubleGyre,
    Flow,
    FunctionFlow,
    OscillatingTaylorGreen,
    PoiseuilleFlow,
    ShearFlow,
    StillWater,
    TaylorGreen,
    UniformFlow,
    Vortex,
)
from swarm.physics.motion.collocation import velocity_and_spin
from tests.reference import array, slopes_of, to_numpy

WRITTEN_OUT = Vortex(speed_scale=0.2, core=3.0)
FLOWS = [
    StillWater(),
    TaylorGreen(),
    TaylorGreen(speed_scale=0.7, wavenumber=1.3),
    UniformFlow((0.3, -0.4)),
    ShearFlow(speed_scale=0.2, height=4.0),
    PoiseuilleFlow(speed_scale=0.3, walls=(-40.0, 40.0)),
    Vortex(),
    Vortex(speed_scale=0.4, core=1.0, centre=(-2.0, 3.0), clockwise=True),
    FunctionFlow(
        WRITTEN_OUT.velocity,
        WRITTEN_OUT.speed_scale,
        WRITTEN_OUT.spin_scale,
        max_speed=WRITTEN_OUT.max_speed,
        max_spin=WRITTEN_OUT.max_spin,
    ),
    *(OscillatingTaylorGreen(0.4, 1.3, phase=2.0, frequency=0.7).at(time) for time in (0.0, 1.7, 11.0)),
    *(DoubleGyre().at(time) for time in (0.0, 1.7)),
    DoubleGyre(0.3, 0.4, frequency=2.0, size=5.0).at(11.0),
]
each_flow = pytest.mark.parametrize("flow", FLOWS, ids=lambda flow: type(flow).__name__)
PLACES = np.random.default_rng(0).normal(3, 8, (1000, 2))


def places_in(flow):
    """Places within the flow, or all over."""
    if (box := getattr(flow, "box", None)) is None:
        return np.concatenate([PLACES, 0.01 * PLACES, [[5.0, 5.0], [-2.0, 3.0], [0.0, 0.0]]])
    low, high = np.array(box).T
    return low + (high - low) * np.random.default_rng(0).uniform(0.01, 0.99, (1000, 2))


@each_flow
def test_a_flow_makes_no_water_spins_with_half_its_vorticity_and_keeps_its_bounds(xp, flow):
    assert isinstance(flow, Flow)
    places = places_in(flow)
    slope = slopes_of(flow.velocity, places)
    np.testing.assert_allclose(np.trace(slope, axis1=1, axis2=2), 0, rtol=0, atol=1e-9)
    spin = to_numpy(flow.spin(array(xp, places)))
    np.testing.assert_allclose(spin, 0.5 * (slope[:, 1, 0] - slope[:, 0, 1]), rtol=0, atol=1e-9)
    if getattr(flow, "max_speed", None) is not None:
        assert np.linalg.norm(flow.velocity(places), axis=-1).max() <= flow.max_speed * (1 + 1e-12)
    assert np.abs(spin).max() <= flow.max_spin * (1 + 1e-9)
    assert np.abs(slope).max() <= getattr(flow, "max_shear", math.inf) * (1 + 1e-6)


@each_flow
def test_a_flow_keeps_the_shape_and_dtype_of_positions(xp, flow):
    for dtype in (xp.float32, xp.float64):
        for shape in ((), (3,), (2, 3), (0,)):
            position = array(xp, np.full((*shape, 2), 0.5), dtype)
            velocity, spin = flow.velocity(position), flow.spin(position)
            assert velocity.shape == position.shape
            assert spin.shape == shape
            assert velocity.dtype == spin.dtype == dtype


@each_flow
def test_velocity_and_spin_at_one_go_are_the_same(xp, flow):
    position = array(xp, places_in(flow))
    x, y, spin = velocity_and_spin(flow, position[..., 0], position[..., 1])
    np.testing.assert_allclose(
        np.stack([x, y], axis=-1), to_numpy(flow.velocity(position)), rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(to_numpy(spin), to_numpy(flow.spin(position)), rtol=0, atol=1e-14)


def test_known_flows_are_as_they_are_written(xp):
    x, y = (math.pi / 10 * PLACES).T
    for flow, velocity, spin in (
        (
            TaylorGreen(),
            (np.cos(x) * np.sin(y), -np.sin(x) * np.cos(y)),
            -math.pi / 10 * np.cos(x) * np.cos(y),
        ),
        (ShearFlow(0.2, 4.0), (0.5 * PLACES[:, 1], 0 * x), 0 * x - 0.25),
    ):
        found = flow.velocity(array(xp, PLACES)), flow.spin(array(xp, PLACES))
        np.testing.assert_allclose(
            to_numpy(found[0]), 0.1 * np.stack(velocity, axis=-1), rtol=1e-14, atol=1e-15
        )
        np.testing.assert_allclose(to_numpy(found[1]), 0.1 * spin, rtol=0, atol=1e-16)
    flow = TaylorGreen()
    shifted = PLACES + flow.period * np.array([2, -3])
    np.testing.assert_allclose(flow.velocity(shifted), flow.velocity(PLACES), rtol=0, atol=1e-14)


def test_poiseuille_stands_still_at_the_walls_and_is_known_between_them(xp):
    flow = PoiseuilleFlow(speed_scale=0.3, walls=(2.0, 6.0))
    position = array(xp, [[0.0, 2.0], [1.0, 4.0], [0.0, 6.0], [0.0, 6.1], [0.0, 1.0]])
    expected = [[0.0, 0.0], [0.3, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]
    np.testing.assert_allclose(to_numpy(flow.velocity(position)), expected, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(to_numpy(flow.inside(position)), [True, True, True, False, False])
    np.testing.assert_allclose(to_numpy(flow.spin(position))[:3], [-0.15, 0.0, 0.15], rtol=1e-15)


def test_a_vortex_turns_like_a_solid_body_inside_and_falls_as_one_over_r_outside():
    flow = Vortex(speed_scale=0.2, core=2.0, centre=(1.0, 2.0))
    near, far = np.array([[1.01, 2.0]]), np.array([[1.0, 102.0], [1.0, 202.0]])
    np.testing.assert_allclose(flow.velocity(near), [[0.0, 0.01 * flow.spin_scale]], rtol=1e-4, atol=1e-15)
    speeds = np.linalg.norm(flow.velocity(far), axis=-1)
    np.testing.assert_allclose(speeds[0], 2 * speeds[1], rtol=1e-12)
    radii = np.linspace(0.01, 10, 100_001)
    speeds = np.linalg.norm(flow.velocity(np.stack([1 + radii, np.full_like(radii, 2.0)], axis=-1)), axis=-1)
    np.testing.assert_allclose(speeds.max(), 0.2, rtol=1e-8)
    np.testing.assert_allclose(radii[speeds.argmax()], 1.120906 * 2.0, rtol=1e-3)
    nearest = flow.velocity(np.array([[1.0 + 1e-7, 2.0], [1.0, 2.0]]))
    np.testing.assert_allclose(nearest, [[0.0, 1e-7 * flow.spin_scale], [0.0, 0.0]], rtol=1e-6, atol=1e-20)


@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-10), ("float32", 1e-4)])
@pytest.mark.parametrize("wavenumber", [0.1, 0.8, 20.0])
def test_the_spin_of_a_plain_function_is_found_or_given(xp, dtype, tolerance, wavenumber):
    places = PLACES / max(wavenumber, 1.0)  # or float32 cannot tell where they are in a short wave
    known = TaylorGreen(speed_scale=0.4, wavenumber=wavenumber)
    flow = FunctionFlow(known.velocity, known.speed_scale, known.spin_scale)
    position = array(xp, places, getattr(xp, dtype))
    expected = to_numpy(known.spin(array(xp, places)))
    assert np.abs(to_numpy(flow.spin(position)) - expected).max() < tolerance * known.spin_scale * 5
    given = FunctionFlow(known.velocity, 1.0, 1.0, spin_function=known.spin)
    np.testing.assert_array_equal(to_numpy(given.spin(position)), to_numpy(known.spin(position)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PoiseuilleFlow(walls=(3.0, 1.0)), r"walls must rise, got \(3\.0, 1\.0\)"),
        (lambda: PoiseuilleFlow(walls=(2.0, 2.0)), r"walls must rise, got \(2\.0, 2\.0\)"),
        (lambda: UniformFlow((0.0, 0.0)), r"current must not be zero, got \(0\.0, 0\.0\)"),
        (
            lambda: UniformFlow(0.1),
            r"current must be two finite numbers \(x, y\), or three in space, got 0\.1",
        ),
        (lambda: Vortex(clockwise="no"), "clockwise must be True or False, got 'no'"),
        (lambda: FunctionFlow(TaylorGreen, 0.1, 0.1), "function must be a function of positions"),
    ],
)
def test_errors_name_the_parameter_the_rule_and_the_value(make, message):
    with pytest.raises((TypeError, ValueError), match=f"^{message}"):
        make()
