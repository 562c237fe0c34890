"""Statistics of a population test, against numbers computed by hand."""

import numpy as np
import pytest
import xarray as xr

from swarm.population.statistics import mean_interval, statistics


def results(gains, limit=None):
    """Results with these gains {policy: (cells,)} and nothing else."""
    attributes = {"seed": 0} if limit is None else {"seed": 0, "limit": limit}
    values = (("policy", "cell"), np.array(list(gains.values()), float))
    return xr.Dataset({"gain": values}, {"policy": list(gains)}, attributes)


def test_numbers_are_those_computed_by_hand():
    found = statistics(results({"dqn": [4.0, 2.0, 3.0, 7.0], "greedy": [1.0, 2.0, 5.0, 0.0]}, limit=8.0))
    dqn, greedy = found["dqn"], found["greedy"]
    assert [dqn[name] for name in ("mean", "min", "max", "fraction_of_limit")] == [4.0, 2.0, 7.0, 0.5]
    assert dqn["std"] == pytest.approx(np.sqrt(3.5))
    assert dqn["difference_to_greedy"] == {"mean": 2.0, "ci95": mean_interval(np.array([3.0, 0, -2, 7]))}
    assert dqn["ci95"] == mean_interval(np.array([4.0, 2, 3, 7]))
    assert dqn["wins"] == 2  # an equal gain is no win
    assert greedy["difference_to_greedy"] == {"mean": 0.0, "ci95": [0.0, 0.0]}
    assert greedy["wins"] == 0


@pytest.mark.parametrize("limit", [None, 0.0, -0.3])  # lives shorter than a turn may lose at best
def test_without_a_limit_above_0_there_is_no_fraction_of_it(limit):
    found = statistics(results({"greedy": [1.0, 2.0]}, limit))
    assert found["greedy"]["fraction_of_limit"] is None
