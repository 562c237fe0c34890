"""The limit where curvatures are chosen from a range: against a value iteration of its own, and policies."""

import numpy as np
import pytest

from swarm.optimal.physical_limit import Optimal, limit, limit_details
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.strategies import Greedy, Random, Swinging
from swarm.population.contest import population_test


def value_iteration(world, headings=1440, curvatures=160):
    """The mean limit over all headings: linear readings of a grid, the best of many curvatures."""
    grid = np.arange(headings) * 2 * np.pi / headings
    kappa = np.linspace(*world.action_range, curvatures)[:, None] + 1e-9
    value, left = np.zeros(headings), world.life - (world.max_decisions - 1) * world.intervals[0]
    for _ in range(world.max_decisions):  # the last interval is the first that is looked at
        turn = kappa * world.speed * left
        rise = (np.cos(grid) - np.cos(grid + turn)) / kappa
        value = np.max(rise + np.interp(grid + turn, grid, value, period=2 * np.pi), axis=0)
        left = world.intervals[0]
    return world.field.gradient_scale * value.mean()


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"n_records": 2},
        {"n_records": 8, "curvature_range": (2.0, 7.0)},
        {"curvature_range": (-1.0, 1.5)},
        {"life": 31.013, "speed": 1.3},
    ],
    ids=str,
)
def test_the_limit_agrees_with_a_value_iteration(options):
    world = World(**{"action": "continuous", "life": 40.0} | options)
    heading = (np.arange(720) + 0.5) * 2 * np.pi / 720
    starts = draw_starts(world, 720, 0)._replace(heading=heading)
    details = limit_details(world, starts)
    assert details.value == pytest.approx(value_iteration(world), rel=1e-3)
    assert details.error < 1e-3 * details.value
    assert limit(world.replace(action="discrete", curvature_range=None), starts) < details.value or (
        "curvature_range" in options
    )


@pytest.mark.parametrize("range_", [None, (-1.0, 4.5)])
def test_the_optimal_policy_attains_it_and_none_exceeds_it(range_):
    world = World(action="continuous", curvature_range=range_)
    policies = {"optimal": Optimal(world), "swinging": Swinging(), "random": Random()}
    found = population_test(world, policies, cells=10, life=30)
    mean = found["gain"].mean("cell").to_series()
    assert mean["optimal"] == pytest.approx(found.attrs["limit"], rel=1e-3)
    assert mean.max() <= found.attrs["limit"] * (1 + 1e-4)
    low, high = world.action_range
    curvature = found["curvature"].values[..., 1:]
    assert np.nanmin(curvature) >= low - 1e-9
    assert np.nanmax(curvature) <= high + 1e-9
    assert len(np.unique(found["curvature"].sel(policy="random").values.round(6))) > 100


def test_greedy_takes_the_curvatures_that_it_takes_in_a_discrete_world():
    tables = [
        population_test(world, {"greedy": Greedy(), "swinging": Swinging()}, cells=5, life=20)
        for world in (World(), World(action="continuous"))
    ]
    np.testing.assert_allclose(*(found["curvature"].values for found in tables), atol=1e-6)
