"""Random numbers by counter: named draws that never meet."""

from __future__ import annotations

import itertools
from typing import get_args

import numpy as np
import pytest

from swarm._support.streams import Population, Purpose, check_seed, generator, integer_seed


def test_a_draw_is_the_same_every_time():
    first, again = (generator("test", "start", 3, 7).random(5) for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_populations_purposes_seeds_and_indices_never_share_numbers():
    keys = itertools.product(
        get_args(Population), get_args(Purpose), (0, 1, 2**40), ((), (0,), (1,), (0, 0), (0, 1))
    )
    draws = {generator(who, what, seed, *index).random(3).tobytes() for who, what, seed, index in keys}
    assert len(draws) == len(get_args(Population)) * len(get_args(Purpose)) * 3 * 5


@pytest.mark.parametrize("method", ["random", "standard_normal"])
def test_row_i_belongs_to_cell_i_however_many_there_are(method):
    rows = {cells: getattr(generator("test", "start", 0), method)((cells, 4)) for cells in (1, 40, 10_000)}
    np.testing.assert_array_equal(rows[1], rows[10_000][:1])
    np.testing.assert_array_equal(rows[40], rows[10_000][:40])


@pytest.mark.parametrize("actions", [2, 3, 5, 7])
def test_whole_numbers_of_a_cell_do_not_depend_on_the_others(actions):
    rows = {
        cells: generator("test", "past", 0).integers(actions, size=(cells, 8)) for cells in (1, 40, 10_000)
    }
    np.testing.assert_array_equal(rows[1], rows[10_000][:1])
    np.testing.assert_array_equal(rows[40], rows[10_000][:40])


def test_global_generators_are_left_alone():
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    generator("training", "noise", 0).standard_normal(10)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def test_integer_seeds_fit_63_bits_and_differ():
    seeds = [integer_seed("training", "network", seed) for seed in range(50)]
    assert len(set(seeds)) == 50
    assert all(0 <= seed < 2**63 for seed in seeds)


def test_neighbouring_cells_are_not_correlated():
    draws = generator("test", "start", 0).random((20_000, 3)) - 0.5
    assert abs(np.mean(draws[1:] * draws[:-1]) * 12) < 0.02
    assert abs(np.mean(draws[:, 0] * draws[:, 1]) * 12) < 0.03


@pytest.mark.parametrize("seed", [0, 5, np.int64(3), 2**100])
def test_seeds_are_whole_numbers(seed):
    assert type(check_seed(seed)) is int
    generator("test", "start", seed)


@pytest.mark.parametrize("seed", [1.0, "1", None, True, [1]])
def test_a_seed_of_another_type_is_an_error(seed):
    with pytest.raises(TypeError, match="seed must be a whole number, got"):
        check_seed(seed)


def test_a_negative_seed_is_an_error():
    with pytest.raises(ValueError, match="seed must not be negative, got -1"):
        check_seed(-1)


def test_numbers_stay_what_they_were():
    # results in papers depend on these: a change of NumPy's generators would move every start
    np.testing.assert_array_equal(
        generator("test", "start", 0, 0).random(2), [0.8985834851506376, 0.26695690346014533]
    )
