"""The interfaces keep what other libraries ask of them."""

from __future__ import annotations

import warnings

import pytest

from swarm.envs import conformance
from swarm.envs.conformance import Check, run_check

pytestmark = pytest.mark.conformance


@pytest.mark.parametrize("name", conformance.checks())
def test_every_check_of_an_interface_passes(name):
    check = run_check(name, conformance.checks()[name])
    if check.passed is None:
        pytest.skip(check.detail)
    assert check.passed, check.detail


def test_a_check_that_raises_has_failed_and_says_why():
    def broken():
        raise ValueError("the world is flat")

    assert run_check("shape", broken) == Check("shape", False, "ValueError: the world is flat")


def test_a_check_that_warns_has_failed():
    check = run_check("care", lambda: warnings.warn("mind the gap", stacklevel=1))
    assert check == Check("care", False, "UserWarning: mind the gap")


def test_warnings_that_a_dependency_forces_are_exempt_by_name():
    def old():
        warnings.warn(
            "The old environment creation API has been deprecated.", DeprecationWarning, stacklevel=1
        )

    assert run_check("old", old).passed


def test_a_missing_library_skips_its_checks_with_a_plain_reason(monkeypatch):
    monkeypatch.setattr(conformance.importlib.util, "find_spec", lambda name: None)
    for name in ("TorchRL check_env_specs", "TorchRL PettingZooWrapper", "PettingZoo render_test"):
        check = run_check(name, conformance.checks()[name])
        assert check.passed is None
        assert "is not installed" in check.detail


def test_checks_say_nothing_on_the_terminal(capsys):
    run_check("loud", lambda: print("Passed!"))
    assert capsys.readouterr().out == ""


def test_all_checks_are_run_in_their_order(monkeypatch):
    monkeypatch.setattr(conformance, "checks", lambda: {"one": lambda: None, "two": lambda: None})
    assert conformance.run_checks() == [Check("one", True, ""), Check("two", True, "")]


class _Forgetful:
    """An environment whose seed decides nothing."""

    agents = ()

    def __init__(self, numbers):
        self.numbers = numbers

    def reset(self, seed=None):
        return next(self.numbers)


def test_the_seed_test_notices_what_differs_and_what_does_not():
    numbers = iter(range(100))
    with pytest.raises(AssertionError, match="two environments with seed 0 must do the same"):
        conformance.check_seeds(lambda: _Forgetful(numbers), steps=0)
    with pytest.raises(AssertionError, match="seeds 0 and 1 must not do the same"):
        conformance.check_seeds(lambda: _Forgetful(iter(range(100))), steps=0)


def test_the_seed_test_notices_the_use_of_global_generators():
    import random

    class Careless:
        agents = ()

        def reset(self, seed=None):
            random.random()
            return seed

    with pytest.raises(AssertionError, match="global generators must stay as they are"):
        conformance.check_seeds(Careless, steps=0)
