"""Statistics of a population test, against numbers computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from swarm.population.statistics import mean_intervals, statistics


def results(gains, limit=None):
    """Results with these gains {policy: (cells,)} and nothing else."""
    attributes = {"seed": 0} if limit is None else {"seed": 0, "limit": limit}
    values = (("policy", "cell"), np.array(list(gains.values()), float))
    return xr.Dataset({"gain": values}, {"policy": list(gains)}, attributes)


def test_numbers_are_those_computed_by_hand():
    found = statistics(results({"dqn": [4.0, 2.0, 3.0, 7.0], "greedy": [1.0, 2.0, 5.0, 0.0]}, limit=8.0))
    dqn, greedy = found["dqn"], found["greedy"]
    assert dqn["mean"] == 4.0
    assert dqn["std"] == pytest.approx(np.sqrt(3.5))
    assert (dqn["min"], dqn["max"]) == (2.0, 7.0)
    assert dqn["fraction_of_limit"] == 0.5
    assert dqn["difference_to_greedy"]["mean"] == 2.0  # 3, 0, −2, 7
    assert dqn["wins"] == 2  # an equal gain is no win
    assert greedy["difference_to_greedy"] == {"mean": 0.0, "ci95": [0.0, 0.0]}
    assert greedy["wins"] == 0


def test_without_a_limit_there_is_no_fraction_of_it():
    assert statistics(results({"greedy": [1.0, 2.0]}))["greedy"]["fraction_of_limit"] is None


def test_a_constant_sample_has_an_interval_of_no_width():
    assert mean_intervals(np.full(40, 29.75)) == [29.75, 29.75]
    found = statistics(results({"dqn": [3.5] * 5, "greedy": [1.0] * 5}))
    assert found["dqn"]["ci95"] == [3.5, 3.5]
    assert found["dqn"]["difference_to_greedy"]["ci95"] == [2.5, 2.5]


def test_a_single_cell_has_no_interval():
    found = statistics(results({"dqn": [3.5], "greedy": [1.0]}))
    assert found["dqn"]["ci95"] is None
    assert found["dqn"]["difference_to_greedy"] == {"mean": 2.5, "ci95": None}


def test_an_interval_is_as_wide_as_the_theory_of_large_samples_says():
    sample = np.random.default_rng(0).normal(10.0, 2.0, 400)
    low, high = mean_intervals(sample)
    half = 1.96 * sample.std() / np.sqrt(400)
    assert low == pytest.approx(sample.mean() - half, abs=0.02)
    assert high == pytest.approx(sample.mean() + half, abs=0.02)


def test_intervals_are_repeatable_and_rows_do_not_disturb_each_other():
    samples = np.random.default_rng(0).normal(size=(3, 2, 40))
    together = mean_intervals(samples, seed=1)
    assert together == mean_intervals(samples, seed=1)
    assert together[1][0] == pytest.approx(mean_intervals(samples[1, 0], seed=1), rel=1e-12)
    assert together != mean_intervals(samples, seed=2)


def test_the_difference_is_taken_cell_by_cell():
    greedy = np.random.default_rng(0).normal(20.0, 5.0, 40)
    found = statistics(results({"dqn": greedy + 1.0, "greedy": greedy}))["dqn"]
    low, high = found["difference_to_greedy"]["ci95"]
    assert high - low < 1e-9  # although the gains themselves are spread
    assert found["ci95"][1] - found["ci95"][0] > 2
