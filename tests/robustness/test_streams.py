"""Random numbers by counter: named draws that never meet."""

import itertools
from typing import get_args

import numpy as np
import pytest

from swarm._support.streams import Population, Purpose, check_seed, generator, integer_seed


def test_populations_purposes_seeds_and_indices_never_share_numbers():
    keys = itertools.product(
        get_args(Population), get_args(Purpose), (0, 1, 2**40), ((), (0,), (1,), (0, 0), (0, 1))
    )
    draws = {generator(who, what, seed, *index).random(3).tobytes() for who, what, seed, index in keys}
    assert len(draws) == len(get_args(Population)) * len(get_args(Purpose)) * 3 * 5


def test_integer_seeds_fit_63_bits_and_differ():
    seeds = [integer_seed("training", "network", seed) for seed in range(50)]
    assert len(set(seeds)) == 50
    assert all(0 <= seed < 2**63 for seed in seeds)


def test_neighbouring_cells_are_not_correlated():
    draws = generator("test", "start", 0).random((20_000, 3)) - 0.5
    assert abs(np.mean(draws[1:] * draws[:-1]) * 12) < 0.02
    assert abs(np.mean(draws[:, 0] * draws[:, 1]) * 12) < 0.03


def test_seeds_are_whole_numbers_that_are_not_negative():
    for seed in (0, np.int64(3), np.uint8(200), np.uint64(2**64 - 1)):
        assert type(check_seed(seed)) is int
        generator("test", "start", seed)
    for seed in (1.0, "1", None, True, [1]):
        with pytest.raises(TypeError, match="seed must be a whole number, got"):
            check_seed(seed)
    with pytest.raises(ValueError, match="seed must not be negative, got -1"):
        check_seed(-1)
    for seed in (2**64, 2**64 + 1, 10**30):
        with pytest.raises(ValueError, match=r"seed must be below 2\*\*64, got"):
            check_seed(seed)
