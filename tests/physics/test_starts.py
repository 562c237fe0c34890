"""Starts: uniform in the box and in heading, outside the egg, cell by cell."""

import numpy as np
import pytest

from swarm.physics.fields import GaussianPlume, RadialField
from swarm.physics.flows import PoiseuilleFlow
from swarm.physics.starts import draw_noise, draw_starts
from swarm.physics.world import World


def equal(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_a_cells_start_does_not_depend_on_how_many_there_are():
    for world in (
        World(),
        World(field="radial", start_box=((-2, 2), (-2, 2))),
        World(curvatures=(3.0, 4.0, 5.0)),
    ):
        all_of_them = draw_starts(world, 10_000, 0)
        for cells in (1, 40):
            assert equal(draw_starts(world, cells, 0), [part[:cells] for part in all_of_them])


def test_starts_are_the_same_for_every_world_that_shares_the_box():
    poses = [
        draw_starts(world, 30, 2)[:2]
        for world in (
            World(),
            World(n_records=8),
            World(varying_speed=True, life=3.0),
            World(curvature_noise=1.0),
        )
    ]
    assert all(equal(pose, poses[0]) for pose in poses)


def test_populations_seeds_and_episodes_start_elsewhere():
    world = World()
    draws = [
        draw_starts(world, 4, seed, population=population, episode=episode)
        for population in ("training", "validation", "test")
        for seed in (0, 1)
        for episode in (0, 1)
    ]
    assert len({draw.position.tobytes() for draw in draws}) == len(draws)
    assert len({draw.past.tobytes() for draw in draws}) > len(draws) // 2


@pytest.mark.parametrize(
    ("world", "box"),
    [
        (World(), ((0, 10), (0, 10))),
        (World(flow="taylor_green"), ((0, 20), (0, 20))),
        (World(flow="taylor_green", start_box=((-1, 1), (2, 3))), ((-1, 1), (2, 3))),
        (World(flow="poiseuille"), ((0, 10), (0, 10))),
    ],
)
def test_starts_are_uniform_in_the_box_and_in_heading(world, box):
    position, heading, past = draw_starts(world, 20_000, 0)
    np.testing.assert_allclose(world.box, box, rtol=1e-12)
    places = np.column_stack([position, heading])
    low = np.array([box[0][0], box[1][0], -np.pi])
    high = np.array([box[0][1], box[1][1], np.pi])
    assert np.all((places >= low) & (places < high))
    counts = [
        np.histogram(column, 10, bounds)[0] for column, *bounds in zip(places.T, low, high, strict=True)
    ]
    np.testing.assert_allclose(counts, 2000, rtol=0.1)
    assert past.shape == (20_000, 4)
    np.testing.assert_allclose(past.mean(), 0.5, atol=0.01)


@pytest.mark.parametrize(
    "field", [RadialField(egg_radius=2.0), GaussianPlume(egg_position=(1.0, 1.0), egg_radius=1.5)]
)
def test_starts_within_reach_of_the_egg_are_drawn_again(field):
    world = World(field=field, start_box=((-3, 3), (-3, 3)))
    position, _, _ = draw_starts(world, 5000, 0)
    from_egg = np.linalg.norm(position - np.array(field.egg_position), axis=-1)
    assert from_egg.min() > field.egg_radius
    # those that were clear of it at once are where they were without an egg
    first, _, _ = draw_starts(World(start_box=((-3, 3), (-3, 3))), 5000, 0)
    clear = np.linalg.norm(first - np.array(field.egg_position), axis=-1) > field.egg_radius
    np.testing.assert_array_equal(position[clear], first[clear])


@pytest.mark.parametrize(
    ("options", "cells", "seed", "message"),
    [
        (
            {"field": "radial", "start_box": ((-0.1, 0.1),) * 2},
            3,
            0,
            "start_box must leave room outside the egg",
        ),
        (
            {"flow": PoiseuilleFlow(walls=(0, 1)), "start_box": ((2, 3),) * 2},
            3,
            0,
            "leave room in the domain",
        ),
        ({}, 0, 0, "cells must be a whole number of at least 1, got 0"),
        ({}, 1, -1, "seed must not be negative, got -1"),
    ],
)
def test_what_cannot_be_drawn_is_an_error(options, cells, seed, message):
    with pytest.raises(ValueError, match=message):
        draw_starts(World(**options), cells, seed)


def test_a_cells_noise_does_not_depend_on_how_many_there_are():
    noise = draw_noise(0, 1000, 50)
    np.testing.assert_array_equal(draw_noise(0, 7, 50), noise[:7])
    assert noise.shape == (1000, 50, 3)
    np.testing.assert_allclose(noise.mean(axis=(0, 1)), 0, atol=0.02)
    np.testing.assert_allclose(noise.std(axis=(0, 1)), 1, atol=0.02)
    correlations = np.corrcoef(noise.reshape(-1, 3).T) - np.eye(3)
    np.testing.assert_allclose(correlations, 0, atol=0.02)
    assert not np.array_equal(draw_noise(0, 7, 50, block=1), noise[:7])
