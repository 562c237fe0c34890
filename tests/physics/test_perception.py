"""Memory and its normalisation, by hand-computed numbers."""

import numpy as np

from swarm.physics import perception
from swarm.physics.world import World
from tests.reference import array, to_numpy


def test_a_new_record_comes_first_and_the_oldest_is_dropped(xp):
    memory = array(xp, [[[1.0, -1.0], [2.0, 1.0], [3.0, -1.0]]])
    renewed, seen = perception.renew(memory, (array(xp, [5.0]), array(xp, [1.0])))
    np.testing.assert_array_equal(to_numpy(renewed), [[[5.0, 1.0], [1.0, -1.0], [2.0, 1.0]]])
    np.testing.assert_array_equal(to_numpy(memory), [[[1.0, -1.0], [2.0, 1.0], [3.0, -1.0]]])
    np.testing.assert_array_equal(to_numpy(seen), to_numpy(perception.observe(renewed)))


def test_an_observation_is_ordered_record_by_record_with_concentrations_from_their_mean(xp):
    records = [[6.0, -1.0, 0.1, 0.2, 0.3], [2.0, 1.0, 0.4, 0.5, 0.6], [1.0, 1.0, 0.7, 0.8, 0.9]]
    seen = perception.observe(array(xp, [records]))
    expected = [3.0, -1.0, 0.1, 0.2, 0.3, -1.0, 1.0, 0.4, 0.5, 0.6, -2.0, 1.0, 0.7, 0.8, 0.9]
    assert seen.dtype == xp.float32
    np.testing.assert_array_equal(to_numpy(seen), np.float32([expected]))


def test_observations_of_a_start_are_those_of_the_paper_by_hand(xp):
    # One cell at the origin heading along +x; two records; κ̄ = 4, c_k = 2, so a record holds c·4/2.
    world = World(n_records=2, field="linear").replace(field=World().field.__class__(2.0, 5.0))
    state = world.start(array(xp, [[0.0, 0.0]]), array(xp, [0.0]), array(xp, [[0, 1]], xp.int64))
    # ΔT = 0.78; it swam there with κ₁ = 3 on a circle around (0, 1/3), so it came from y = (1 − cos 2.34)/3.
    came_from = (1 - np.cos(3 * 0.78)) / 3
    c_now, c_before = 5.0, 2 * came_from + 5
    mean = (c_now + c_before) / 2
    expected = [(c_now - mean) * 4 / 2, -1.0, (c_before - mean) * 4 / 2, 1.0]
    np.testing.assert_allclose(to_numpy(world.observation(state)), [expected], rtol=0, atol=1e-6)


def test_the_sensed_flow_is_normalised_by_its_scales(xp):
    world = World(flow="taylor_green", sense_flow=True)
    position = np.array([[1.0, 2.0], [7.0, 13.0]])
    state = world.start(array(xp, position), array(xp, [0.3, -2.0]), array(xp, np.ones((2, 4), int)))
    k = np.pi / 10
    x, y = k * position[:, 0], k * position[:, 1]
    expected = [np.cos(x) * np.sin(y), -np.sin(x) * np.cos(y), -np.cos(x) * np.cos(y)]
    seen = to_numpy(world.observation(state))
    assert seen.shape == (2, 20)
    np.testing.assert_allclose(seen[:, 2:5], np.stack(expected, axis=-1), rtol=0, atol=1e-6)


def test_with_more_curvatures_they_are_normalised_to_evenly_spaced_numbers(xp):
    world = World(curvatures=(2.0, 3.0, 4.0, 5.0))
    position = array(xp, np.zeros((1, 2)))
    state = world.start(position, array(xp, [0.0]), array(xp, [[0, 1, 2, 3]], xp.int64))
    np.testing.assert_allclose(
        to_numpy(world.observation(state))[0, 1::2], [-1, -1 / 3, 1 / 3, 1], rtol=0, atol=1e-6
    )
    np.testing.assert_allclose(to_numpy(world.curvature(state)), [2.0], rtol=1e-12)
