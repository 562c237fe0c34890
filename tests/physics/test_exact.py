"""Exact solutions are met within the bounds that the documentation states."""

import pytest

from benchmarks.exact_solutions import laws


@pytest.mark.parametrize("law", laws(), ids=lambda law: law.name)
def test_an_exact_solution_is_met(law):
    assert 0 <= law.error() <= law.bound
