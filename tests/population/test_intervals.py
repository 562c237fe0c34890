"""Intervals over seeds and cells: Student's where only one of them varies, and they cover."""

import itertools

import numpy as np
import pytest
from scipy import stats

from swarm.population.statistics import margin
from tests.population.coverage import CELLS, DESIGNS, RATIOS, SEEDS, coverage


def width(interval):
    return (interval.high - interval.low) / 2


def test_cells_of_one_policy_have_the_interval_of_student():
    gain = np.random.default_rng(1).normal(20.0, 3.0, 40)
    expected = width(stats.ttest_1samp(gain, 0.0).confidence_interval())
    assert margin(gain) == pytest.approx(expected)
    assert margin(gain[None]) == pytest.approx(expected)
    assert margin(gain, weights=(-2.0,)) == pytest.approx(2 * expected)


def test_seeds_without_common_cells_have_the_interval_of_student():
    gain = np.random.default_rng(1).normal(20.0, 3.0, (5, 1))
    assert margin(gain) == pytest.approx(width(stats.ttest_1samp(gain[:, 0], 0.0).confidence_interval()))


def test_two_policies_on_the_same_cells_are_compared_cell_by_cell():
    first, second = np.random.default_rng(1).normal(20.0, 3.0, (2, 40)) * [[1.0], [2.0]]
    paired = width(stats.ttest_rel(first, second).confidence_interval())
    assert margin(first, second, weights=(1, -1)) == pytest.approx(paired)


def test_both_the_seeds_and_the_cells_are_in_the_interval():
    cells = np.random.default_rng(2).normal(size=(1, 50))
    still, moving = margin(cells + np.zeros((5, 1))), margin(cells + 3.0 * np.arange(5.0)[:, None])
    assert still == pytest.approx(margin(cells), rel=1e-6)  # five equal trainings tell no more than one
    assert moving > 2 * still
    assert margin(cells + np.zeros((5, 1)), cells, weights=(1, -1)) == pytest.approx(0.0, abs=1e-12)


def test_leading_axes_are_samples_of_their_own():
    samples = np.random.default_rng(3).normal(size=(4, 2, 3, 10))
    together = margin(samples)
    assert together.shape == (4, 2)
    assert together[2, 1] == pytest.approx(margin(samples[2, 1]))


def test_constant_numbers_have_an_interval_of_no_width_and_one_number_has_none():
    assert margin(np.full((3, 40), 29.75)) == 0.0
    assert margin(np.array([4.0])) is None


def test_samples_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"with the same cells, got the shapes \(1, 3\), \(1, 4\)"):
        margin(np.zeros(3), np.zeros(4), weights=(1, -1))
    with pytest.raises(ValueError, match="samples must be 1"):
        margin(np.zeros(3), np.zeros(3))


def bounds(n_seeds):
    return (0.92, 0.98) if n_seeds == 3 else (0.93, 0.97)


@pytest.mark.parametrize("design", DESIGNS)
@pytest.mark.parametrize(("n_seeds", "ratio"), [(3, 0.1), (3, 10.0), (5, 0.3), (5, 3.0), (20, 1.0)])
def test_intervals_hold_the_truth_as_often_as_they_say(design, n_seeds, ratio):
    low, high = bounds(n_seeds)
    assert low <= coverage(design, n_seeds, 40, ratio) <= high


@pytest.mark.slow
@pytest.mark.parametrize(("design", "n_seeds"), [*itertools.product(DESIGNS, SEEDS)])
def test_intervals_hold_the_truth_whatever_varies_more(design, n_seeds):
    low, high = bounds(n_seeds)
    for n_cells, ratio in itertools.product(CELLS, RATIOS):
        held = coverage(design, n_seeds, n_cells, ratio, trials=10_000 if n_cells == 40 else 2000)
        assert low <= held <= high, (n_cells, ratio)  # 10 000 trials tell it to ±0.4%
