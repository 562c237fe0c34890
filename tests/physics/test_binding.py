"""Molecules that bind: Poisson by inversion, normal where they are many."""

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import poisson

from swarm.physics.crowd.binding import bindings, normal_quantile
from tests.reference import array, to_numpy

EVENLY = (np.arange(20_000) + 0.5) / 20_000  # their mean is the distribution's own, without chance


@pytest.mark.parametrize("mean", [1e-3, 0.5, 7.0, 60.0, 100.0, 100.1, 3e3, 1e6])
def test_bindings_have_the_mean_and_the_variance_of_poissons_distribution(xp, mean):
    found = to_numpy(bindings(array(xp, EVENLY), array(xp, np.full(EVENLY.shape, mean))))
    np.testing.assert_array_equal(found, np.round(found))
    assert found.mean() == pytest.approx(mean, rel=1e-3, abs=1e-4)
    assert found.var() == pytest.approx(mean, rel=3e-3, abs=1e-3 + 1 / 12 * (mean > 100))


def test_up_to_a_hundred_bindings_are_the_inverse_distribution(xp):
    mean = np.linspace(0.01, 100, 20_000)
    found = to_numpy(bindings(array(xp, EVENLY), array(xp, mean)))
    np.testing.assert_array_equal(found, poisson.ppf(EVENLY, mean))


def test_nothing_binds_where_nothing_is_and_extremes_are_finite(xp):
    uniform = np.array([0.0, 0.5, 1 - 2**-53])
    for mean in (-1.0, 0.0):
        assert not to_numpy(bindings(array(xp, uniform), array(xp, np.full(3, mean)))).any()
    for mean in (3.0, 1e4):
        found = to_numpy(bindings(array(xp, uniform), array(xp, np.full(3, mean))))
        assert np.isfinite(found).all()
        assert (np.diff(found) > 0).all()
    single = bindings(array(xp, uniform, xp.float32), array(xp, np.full(3, 5.0), xp.float32))
    assert single.dtype == xp.float32
    assert np.isfinite(to_numpy(single)).all()


def test_the_normal_quantile_is_that_of_scipy(xp):
    uniform = np.concatenate([EVENLY, np.logspace(-10.5, -4), 1 - np.logspace(-10.5, -4)])
    found = to_numpy(normal_quantile(array(xp, uniform)))
    np.testing.assert_allclose(found, ndtri(uniform), rtol=0, atol=2e-6)
