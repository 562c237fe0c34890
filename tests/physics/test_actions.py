"""Continuous actions: a cell's curvature is the action itself, of any sign, in still water and in flows."""

import numpy as np
import pytest

from swarm.physics.flows import TaylorGreen
from swarm.physics.motion.arc import arc, centre_of_curvature
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from tests.reference import array, pose, reference, to_numpy

RANGE = (-6.0, 5.0)
KAPPA = np.array([-6.0, -1e-3, -1e-9, 0.0, 1e-12, 1e-7, 1e-5, 0.3, 5.0])


def steered(**parameters):
    return World(action="continuous", **parameters)


@pytest.mark.parametrize("turn", [1e-12, 3e-9, 1e-8, 2e-5, 1e-3, -1e-5])
def test_arcs_that_hardly_turn_are_those_of_the_series(turn):
    (ahead, cosine), (aside, sine) = arc(np.float64(turn / 2), np.float64(1.0), np.float64(2.0))
    series = [1 - turn**2 / 6 + turn**4 / 120, turn / 2 - turn**3 / 24 + turn**5 / 720]
    np.testing.assert_allclose([ahead / 2, aside / 2], series, rtol=3e-16, atol=0)
    np.testing.assert_allclose([cosine, sine], [np.cos(turn), np.sin(turn)], rtol=3e-16)


@pytest.mark.parametrize("flow", ["still", "taylor_green"])
def test_a_decision_swims_the_chosen_curvature(xp, flow):
    world = steered(curvature_range=RANGE, flow=flow)
    starts = draw_starts(world, len(KAPPA), 0)
    state = world.start(array(xp, starts.position), array(xp, starts.heading), xp.asarray(starts.past))
    after, outcome = world.step(state, array(xp, KAPPA))
    heading = pose(np, starts.position, starts.heading).heading
    vortices = None if flow == "still" else TaylorGreen()
    expected = reference(starts.position, heading, KAPPA, 1.0, world.intervals[0], vortices)
    found = np.column_stack([to_numpy(after.position), to_numpy(after.heading)])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 if vortices is None else 1e-6)
    np.testing.assert_allclose(to_numpy(world.curvature(after)), KAPPA, atol=1e-14)
    seen = to_numpy(outcome.observation).reshape(len(KAPPA), 4, 2)[:, 0, 1]
    np.testing.assert_allclose(seen, KAPPA - 4, rtol=1e-6)
    assert np.all(np.abs(to_numpy(outcome.observation)) <= world.observation_bounds)


@pytest.mark.parametrize("noise", [{}, {"curvature_noise": 0.3}, {"spread": {"curvature": 0.2}}])
def test_the_curvatures_of_a_discrete_world_live_its_lives(noise):
    discrete, ours = World(**noise, life=20.0), steered(**noise, life=20.0)
    starts, draw = draw_starts(discrete, 5, 1), np.random.default_rng(0)
    a, b = discrete.start(*starts), ours.start(*starts)
    while not a.finished.all():
        action, kicks = draw.integers(2, size=5), draw.normal(size=(5, 3)) if discrete.has_noise else None
        a, _ = discrete.step(a, action, kicks)
        b, _ = ours.step(b, np.array(discrete.curvatures)[action], kicks)
    np.testing.assert_allclose(a.position, b.position, atol=1e-12)
    np.testing.assert_array_equal(a.clock, b.clock)


def test_the_clock_and_the_scales_stay_and_actions_beyond_the_range_count_as_its_ends():
    discrete, ours = World(), steered(curvature_range=(-2.0, 9.0))
    for name in ("intervals", "mean_curvature", "record_scale", "reward_scale", "max_decisions"):
        assert getattr(discrete, name) == getattr(ours, name)
    assert ours.observation_bounds[1] == pytest.approx(1.001 * 6)  # κ* of −2
    state = ours.start(*draw_starts(ours, 2, 0))
    after, _ = ours.step(state, np.array([-7.0, 100.0]))
    np.testing.assert_allclose(ours.curvature(after), [-2, 9])


def test_who_swims_straight_on_has_no_centre():
    poses = pose(np, np.zeros((2, 2)), np.zeros(2))
    np.testing.assert_array_equal(
        centre_of_curvature(poses, np.array([0.0, -2.0])), [[np.nan] * 2, [0, -0.5]]
    )
