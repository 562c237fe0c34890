"""Kinematics against closed forms and an adaptive high-order integrator."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from swarm.physics.flows import PoiseuilleFlow, ShearFlow, StillWater, TaylorGreen, UniformFlow, Vortex
from swarm.physics.motion.arc import Pose, along_arc, arc, arrival, centre_of_curvature
from swarm.physics.motion.collocation import TOLERANCE, Collocation, error_estimate, swim
from tests.reference import array, place_and_heading, pose, reference, to_numpy

CELLS = 24


@pytest.fixture
def cells():
    """Poses and curvatures of some cells."""
    rng = np.random.default_rng(1)
    return (
        rng.uniform(0, 20, (CELLS, 2)),
        rng.uniform(-np.pi, np.pi, CELLS),
        rng.choice([3.0, 4.0, 5.0], CELLS),
    )


def swum(xp, cells, duration, *, speed=1.0, flow=None, curvature=None):
    position, angle, kappa = cells
    kappa = kappa if curvature is None else np.full(CELLS, curvature)
    durations = np.broadcast_to(np.asarray(duration, float), CELLS)
    return swim(
        pose(xp, position, angle),
        array(xp, kappa),
        array(xp, np.full(CELLS, speed)),
        array(xp, durations),
        flow,
    )


@pytest.mark.parametrize("speed", [1.0, 0.9, 1.1])
@pytest.mark.parametrize("duration", [0.02, 0.38, 0.78, 3.0, -0.38])
def test_without_flow_the_pose_is_exact(xp, cells, duration, speed):
    position, angle, curvature = cells
    expected = reference(position, pose(np, position, angle).heading, curvature, speed, duration)
    after = place_and_heading(swum(xp, cells, duration, speed=speed))
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-12 * 20)
    turn = curvature * speed * duration
    by_hand = position + (
        np.stack([np.sin(angle + turn) - np.sin(angle), np.cos(angle) - np.cos(angle + turn)], axis=-1)
        / curvature[:, None]
    )
    np.testing.assert_allclose(after[:, :2], by_hand, rtol=0, atol=1e-13)


def test_a_straight_path_has_no_curvature(xp, cells):
    position, angle, _ = cells
    straight = place_and_heading(swum(xp, cells, 0.38, curvature=0.0))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    np.testing.assert_allclose(straight[:, :2], position + 0.38 * direction, rtol=0, atol=1e-14)
    nearly = place_and_heading(swum(xp, cells, 0.38, curvature=1e-9))
    np.testing.assert_allclose(nearly, straight, rtol=0, atol=1e-9)


FLOWS = [
    TaylorGreen(),
    TaylorGreen(speed_scale=1.0),
    TaylorGreen(speed_scale=0.1, wavenumber=3.0),
    TaylorGreen(speed_scale=0.01, wavenumber=10.0),
    TaylorGreen(speed_scale=3.0, wavenumber=0.3),
    UniformFlow((0.3, -0.4)),
    ShearFlow(speed_scale=0.3),
    PoiseuilleFlow(speed_scale=0.5, walls=(-5.0, 25.0)),
    Vortex(speed_scale=0.3, core=1.0, centre=(10.0, 10.0)),
    Vortex(speed_scale=0.3, core=4.0, clockwise=True),
]


@pytest.mark.parametrize("flow", FLOWS, ids=lambda flow: type(flow).__name__)
def test_in_a_flow_the_pose_is_within_tolerance_of_the_reference(xp, cells, flow):
    position, angle, curvature = cells
    heading = pose(np, position, angle).heading
    several = np.linspace(0.05, 0.78, CELLS)
    pairs = ((0.78, 1.0), (0.38, 1.0), (0.18, 1.0), (-0.38, 1.0), (0.38, 2.5), (2.5, 0.5), (several, 1.0))
    for duration, speed in pairs:
        after = place_and_heading(swum(xp, cells, duration, flow=flow, speed=speed))
        expected = reference(position, heading, curvature, speed, duration, flow)
        np.testing.assert_allclose(after, expected, rtol=0, atol=TOLERANCE, err_msg=f"{duration=}")


def test_in_a_uniform_flow_the_arc_is_carried_along(xp, cells):
    flow = UniformFlow((0.3, -0.4))
    with_flow, without = (place_and_heading(swum(xp, cells, 0.38, flow=f)) for f in (flow, None))
    without[:, :2] += 0.38 * np.array(flow.current)
    np.testing.assert_allclose(with_flow, without, rtol=0, atol=1e-14 * 20)


def error_of(scheme, flow, duration, *, speed=1.0, curvature=4.0):
    rng = np.random.default_rng(2)
    position, angle = rng.uniform(0, 20, (CELLS, 2)), rng.uniform(-np.pi, np.pi, CELLS)
    start, speeds = pose(np, position, angle), np.full(CELLS, speed)
    durations = np.full(CELLS, duration)
    motions = scheme.motions(np.full(CELLS, curvature), speeds, durations)
    after, _ = scheme.swim(start, motions, speeds, durations, scheme.weights, flow)
    expected = reference(position, start.heading, curvature, speed, duration, flow)
    return np.abs(place_and_heading(after) - expected).max()


@pytest.mark.parametrize(
    ("nodes", "sweeps", "substeps", "order", "slack"),
    [(1, 8, (16, 32, 64), 2, 0.4), (2, 8, (4, 8, 16), 4, 0.4), (3, 8, (2, 4, 8), 6, 0.4)]
    + [(6, sweeps, (4, 8, 16), sweeps, 0.15) for sweeps in (1, 2, 3)],
)
def test_the_order_of_convergence_is_twice_the_nodes_or_the_sweeps(nodes, sweeps, substeps, order, slack):
    flow = TaylorGreen(speed_scale=0.5, wavenumber=1.0)
    errors = [error_of(Collocation(nodes, sweeps, n), flow, 0.78) for n in substeps]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, order, rtol=0, atol=slack, err_msg=f"{errors}")


class Turning(StillWater):
    """Water that turns cells without moving them."""

    speed_scale = max_speed = 0.0
    spin_scale = max_spin = 1.5

    def spin(self, position):
        return np.full_like(position[..., 0], self.spin_scale)


UNIT = itertools.product((0.3, 1.0, 3.0, 10.0), (1e-3, 0.1, 1.0), (0.18, 0.78))


@pytest.mark.parametrize(
    ("flow", "duration", "speed", "curvature"),
    [
        *((TaylorGreen(speed_scale=u, wavenumber=k), duration, 1.0, 4.0) for k, u, duration in UNIT),
        (Turning(), 0.38, 1.0, 4.0),
        (TaylorGreen(speed_scale=1e-3, wavenumber=10.0), 3.0, 0.01, 0.1),  # its heading is what limits it
        (TaylorGreen(speed_scale=1.0, wavenumber=0.1), 0.18, 1.0, 4.0),  # its position is
        (TaylorGreen(speed_scale=1.0, wavenumber=10.0), 0.18, 10.0, 0.1),  # small scales, crossed quickly
        (TaylorGreen(speed_scale=3.0, wavenumber=10.0), 0.38, 10.0, 0.1),  # neighbours part e⁵-fold
    ],
)
def test_the_scheme_that_is_chosen_keeps_the_tolerance(flow, duration, speed, curvature):
    length = speed * duration
    scheme = Collocation.for_interval(flow, curvature * length, length, duration)
    assert error_of(scheme, flow, duration, speed=speed, curvature=curvature) < TOLERANCE


def estimated(flow, *, unit_of_time=1.0):
    """The error estimate for three quarters of a turn in `duration` 0.4."""
    return error_estimate(flow, 4.7, 1.2, 0.4 * unit_of_time, 4, 3, 2)


def test_the_error_estimate_knows_a_flow_by_its_bounds_or_else_by_its_scales():
    scales = SimpleNamespace(speed_scale=0.3, spin_scale=0.6)
    expected = estimated(scales)
    bounded = SimpleNamespace(speed_scale=9.0, spin_scale=9.0, max_speed=0.3, max_spin=0.6)
    assert estimated(bounded) == expected
    assert estimated(SimpleNamespace(**vars(bounded) | {"max_speed": None})) > expected
    assert estimated(SimpleNamespace(**vars(bounded) | {"max_spin": None})) > expected
    strained = SimpleNamespace(**vars(bounded) | {"max_spin": 0.0, "max_shear": 0.6})
    assert estimated(strained) == expected
    assert estimated(SimpleNamespace(**vars(bounded) | {"max_shear": 0.1})) == expected


def test_a_flow_that_gives_velocity_and_spin_at_one_go_is_asked_once(xp, cells):
    class AtOneGo(TaylorGreen):
        def velocity(self, position):
            raise AssertionError

        spin = velocity

    np.testing.assert_array_equal(
        place_and_heading(swum(xp, cells, 0.38, flow=AtOneGo())),
        place_and_heading(swum(xp, cells, 0.38, flow=TaylorGreen())),
    )


@pytest.mark.parametrize(
    ("flow", "interval", "message"),
    [
        (
            TaylorGreen(speed_scale=3.0, wavenumber=10.0),
            (0.78, 7.8, 0.78),
            "interval of 0.78, got speed_scale = 3",
        ),
        (
            TaylorGreen(speed_scale=3.0, wavenumber=10.0),
            (0.78, 7.8, 1e3),
            "interval of 1000, got speed_scale = 3",
        ),
        (
            TaylorGreen(speed_scale=1e3, wavenumber=1e3),
            (2.0, 0.38, 0.38),
            "in 888 substeps .*speed_scale = 1000",
        ),
    ],
)
def test_a_flow_too_fast_to_follow_is_an_error(flow, interval, message):
    with pytest.raises(ValueError, match=rf"flow must vary slowly.* {message}"):
        Collocation.for_interval(flow, *interval)


def test_the_path_in_a_flow_passes_through_its_outputs(xp, cells):
    position, angle, curvature = cells
    flow = TaylorGreen()
    scheme = dataclasses.replace(Collocation.for_interval(flow, 1.9, 0.38, 0.38), substeps=2, outputs=5)
    ones, durations = array(xp, np.ones(CELLS)), array(xp, np.full(CELLS, 0.38))
    motions = scheme.motions(array(xp, curvature), ones, durations)
    weights = array(xp, scheme.weights)
    _, path = scheme.swim(pose(xp, position, angle), motions, ones, durations, weights, flow)
    heading = pose(np, position, angle).heading
    assert path.shape == (10, CELLS, 2)
    for place, time in zip(to_numpy(path), np.arange(10) * 0.038, strict=True):
        expected = reference(position, heading, curvature, 1.0, time, flow)[:, :2]
        np.testing.assert_allclose(place, expected, rtol=0, atol=5e-6)


@pytest.mark.parametrize("flow", [None, TaylorGreen()])
def test_headings_stay_of_unit_length_in_float32(xp, flow):
    position = np.full((CELLS, 2), 3.0)
    now = pose(xp, position, np.linspace(-3, 3, CELLS), xp.float32)
    ones = array(xp, np.ones(CELLS), xp.float32)
    for _ in range(50):
        now = swim(now, 4 * ones, ones, 0.38 * ones, flow)
    assert now.position.dtype == now.heading.dtype == xp.float32
    np.testing.assert_allclose(np.linalg.norm(to_numpy(now.heading), axis=-1), 1, rtol=0, atol=3e-7)


def test_the_centre_of_curvature_stays_while_the_curvature_does(xp, cells):
    position, angle, curvature = cells
    before = centre_of_curvature(pose(xp, position, angle), array(xp, curvature))
    after = centre_of_curvature(swum(xp, cells, 0.38), array(xp, curvature))
    np.testing.assert_allclose(to_numpy(after), to_numpy(before), rtol=0, atol=1e-14 * 20)


@pytest.mark.parametrize("length", [0.0, 0.38, 3.0])
@pytest.mark.parametrize("curvature", [5.0, -4.0, 0.05, 0.01, 1e-3, -1e-4, 1e-6, 1e-9, 0.0])
def test_an_arc_arrives_where_a_densely_sampled_one_first_comes_near(xp, curvature, length):
    rng = np.random.default_rng(3)
    cells, point, radius = 60, np.array([0.2, -0.1]), 0.3
    position, angle = rng.normal(0, 0.7, (cells, 2)), rng.uniform(-np.pi, np.pi, cells)
    start, kappa, ones = pose(np, position, angle), np.full(cells, curvature), np.ones(cells)
    path = along_arc(start, arc(kappa, ones, np.linspace(0, length, 2001)[:, None] * ones)).position
    near = np.linalg.norm(path - point, axis=-1)
    clear = np.abs(near.min(axis=0) - radius) > length / 2000 + 1e-6
    for dtype, tolerance in ((xp.float64, 1e-9), (xp.float32, 2e-4)):
        given = (array(xp, each, dtype) for each in (kappa, length * ones))
        part = to_numpy(arrival(pose(xp, position, angle, dtype), *given, point.tolist(), radius))
        reached = np.isfinite(part)
        np.testing.assert_array_equal(reached[clear], (near.min(axis=0) <= radius)[clear])
        first = np.argmax(near <= radius, axis=0) / 2000
        np.testing.assert_allclose(part[reached & clear], first[reached & clear], rtol=0, atol=1e-3)
        on = reached & (part > 0)
        end = along_arc(Pose(position[on], start.heading[on]), arc(kappa[on], ones[on], part[on] * length))
        np.testing.assert_allclose(np.linalg.norm(end.position - point, axis=-1), radius, atol=tolerance)
