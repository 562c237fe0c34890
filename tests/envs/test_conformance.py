"""The interfaces keep what other libraries ask of them."""

import warnings

import pytest
from gymnasium.spaces import Discrete

from swarm.envs import conformance
from swarm.envs.conformance import Check, run_check

pytestmark = pytest.mark.conformance


@pytest.mark.parametrize("name", conformance.checks())
def test_every_check_of_an_interface_passes(name):
    check = run_check(name, conformance.checks()[name])
    if check.passed is None:
        pytest.skip(check.detail)
    assert check.passed, check.detail


def test_a_check_that_raises_or_warns_has_failed_and_says_why_but_for_warnings_exempt_by_name():
    def warning(text, kind=UserWarning):
        return lambda: warnings.warn(text, kind, stacklevel=1)

    assert run_check("zero", lambda: 1 / 0) == Check("zero", False, "ZeroDivisionError: division by zero")
    assert run_check("care", warning("mind the gap")) == Check("care", False, "UserWarning: mind the gap")
    forced = warning("The old environment creation API has been deprecated.", DeprecationWarning)
    assert run_check("old", forced).passed


def test_a_missing_library_skips_its_checks_with_a_plain_reason(monkeypatch):
    monkeypatch.setattr(conformance.importlib.util, "find_spec", lambda name: None)
    for name in ("TorchRL check_env_specs", "TorchRL PettingZooWrapper", "PettingZoo render_test"):
        check = run_check(name, conformance.checks()[name])
        assert check.passed is None
        assert "is not installed" in check.detail


def test_all_checks_are_run_in_their_order_and_say_nothing_on_the_terminal(monkeypatch, capsys):
    monkeypatch.setattr(conformance, "checks", lambda: {"one": lambda: print("Passed!"), "two": lambda: None})
    assert list(conformance.run_checks()) == [Check("one", True, ""), Check("two", True, "")]
    assert capsys.readouterr().out == ""


class _Toy:
    """What an environment without steps has."""

    agents, possible_agents = (), ("a",)

    def action_space(self, agent):
        return Discrete(2)


class _Forgetful(_Toy):
    """An environment whose seed decides nothing."""

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

    class Careless(_Toy):
        def reset(self, seed=None):
            random.random()
            return seed

    with pytest.raises(AssertionError, match="global generators must stay as they are"):
        conformance.check_seeds(Careless, steps=0)
