"""Evaluation: what is told of a policy beside greedy and swinging, and which policies can be had."""

from types import SimpleNamespace

import numpy as np
import pytest

from swarm.optimal import physical_limit
from swarm.optimal.physical_limit import Optimal
from swarm.physics.world import World
from swarm.policies.network import save_policy
from swarm.policies.policy_file import PolicyError
from swarm.policies.strategies import Greedy, Random, Swinging
from swarm.population import evaluation
from swarm.population.evaluation import evaluate, named_policy
from swarm.population.noise import sweep_noise
from swarm.population.statistics import statistics
from tests.policies.test_network import CARD, make

NUMBERS = {"mean", "std", "min", "max", "ci95", "fraction_of_limit"}
PROMISED = {"policy": str, "experiment": str, "cells": int, "life": float, "seed": int, "gain": dict}
PROMISED |= {"greedy": dict, "difference_to_greedy": dict, "wins": int, "versions": dict}


@pytest.fixture
def with_limit(monkeypatch):
    grids = dict.fromkeys(("coarse", "fine", "finest"), 1.5)
    bounds = SimpleNamespace(means=lambda position, heading: grids)
    monkeypatch.setattr(physical_limit, "bounds_of", lambda world: bounds)


def test_the_summary_tells_what_was_promised(tmp_path, with_limit):
    save_policy(make(), tmp_path / "policy.safetensors")
    done = evaluate(str(tmp_path), World(), experiment="linear_n4", cells=6, life=12, seed=3)
    summary, results = done.summary, done.results
    assert all(isinstance(summary[name], kind) for name, kind in PROMISED.items())
    assert set(summary) == {*PROMISED, "limit", "commit"}
    assert (summary["policy"], summary["experiment"]) == (str(tmp_path), "linear_n4")
    assert (summary["cells"], summary["life"], summary["seed"], summary["limit"]) == (6, 12.0, 3, 1.5)
    assert set(summary["difference_to_greedy"]) == {"mean", "ci95"}
    assert results["policy"].values.tolist() == ["dqn", "greedy", "swinging"]
    numbers = statistics(results)
    assert summary["gain"] == {name: numbers["dqn"][name] for name in NUMBERS}
    assert summary["greedy"] == {name: numbers["greedy"][name] for name in NUMBERS}
    assert summary["gain"]["fraction_of_limit"] == pytest.approx(summary["gain"]["mean"] / 1.5)
    gain = results["gain"]
    assert summary["wins"] == int((gain.sel(policy="dqn") > gain.sel(policy="greedy")).sum())


@pytest.mark.parametrize(
    ("card", "label"), [({}, "dqn"), ({"algorithm": "ppo"}, "ppo"), ({"algorithm": "my_own"}, "my_own")]
)
def test_a_trained_policy_is_called_by_its_algorithm(tmp_path, card, label):
    save_policy(make(card=CARD | card), tmp_path / "policy.safetensors")
    done = evaluate(tmp_path, World(), experiment="own", cells=2, life=4)
    assert (done.label, done.results["policy"].values[0]) == (label, label)
    swept = sweep_noise(tmp_path, World(), (0.0, 0.1), cells=2, life=4)
    assert swept.results["policy"].values.tolist() == [label, "greedy"]


@pytest.mark.parametrize("name", ["swinging", "greedy", "two words", "x" * 41, 7, ["dqn"]])
def test_an_algorithm_by_a_wrong_name_is_refused(name):
    with pytest.raises(PolicyError, match=r"algorithm,? must"):
        evaluate(make(card=CARD | {"algorithm": name}), World(), experiment="own", cells=2, life=4)


def test_a_policy_of_ones_own_that_is_called_as_a_strategy_is_refused():
    class Swinging:
        def act(self, world, state, uniform):
            return 0 * state.clock

    with pytest.raises(PolicyError, match="must not be called as a strategy, got 'swinging'"):
        evaluate(Swinging(), World(), experiment="own", cells=2, life=4)


@pytest.mark.parametrize("name", ["greedy", "swinging", "random"])
def test_numbers_that_do_not_exist_are_none(name):
    world = World(concentration_noise=0.1)  # no limit
    done = evaluate(name, world, experiment="linear_n4", cells=1, life=3)
    assert done.summary["limit"] is done.summary["gain"]["fraction_of_limit"] is None
    assert done.summary["gain"]["ci95"] is None
    assert done.summary["policy"] == done.label == name
    assert done.table.rows[0][2] is None
    assert "of the limit" not in done.table.headings


def test_where_there_is_an_egg_arrivals_are_counted():
    world = World(field="radial", varying_speed=True)
    done = evaluate("greedy", world, experiment="radial", cells=3, life=300)
    assert done.summary["limit"] is None
    assert "limit" not in done.results.attrs
    assert done.summary["arrived"] == 3
    assert (done.results["lifetime"].sel(policy="swinging") == 300).all()
    times = done.results["lifetime"].sel(policy="greedy").values
    assert done.summary["time_to_egg"] == {"mean": times.mean(), "median": np.median(times)}
    assert done.table.headings[-3:] == ["arrived", "time to egg", "median"]
    shown = {row[0]: row[-3:] for row in done.table.rows}
    assert shown == {
        "greedy": ["3/3", f"{times.mean():.1f}", f"{np.median(times):.1f}"],
        "swinging": ["0/3", None, None],
    }


def test_in_a_race_only_those_at_the_egg_have_arrived():
    world = World(field="radial", first_arrivals=1, interval_rule="common")
    done = evaluate("greedy", world, experiment="race", cells=8, life=80)
    came = np.isfinite(done.results["arrival_time"].sel(policy="greedy").values)
    assert np.array_equal(done.results["arrived"].sel(policy="greedy"), came)
    assert done.summary["arrived"] == came.sum() < 8
    assert (
        done.summary["time_to_egg"]["mean"]
        == done.results["arrival_time"].sel(policy="greedy").values[came].mean()
    )


def test_the_table_is_ordered_by_gain(with_limit):
    done = evaluate("random", World(), experiment="linear_n4", cells=5, life=50)
    assert done.table.rows[0][0] == "greedy"
    means = [float(row[1].split(" ")[0]) for row in done.table.rows]
    assert means == sorted(means, reverse=True)
    assert float(done.table.rows[0][-1].rstrip("%")) == pytest.approx(100 * means[0] / 1.5, abs=0.5)


def test_policies_go_by_their_names(tmp_path):
    named = [named_policy(name, World()) for name in ("greedy", "swinging", "random")]
    assert named == [Greedy(), Swinging(), Random()]
    assert isinstance(named_policy("optimal", World()), Optimal)
    save_policy(make(), tmp_path / "mine.safetensors")
    assert np.array_equal(named_policy(tmp_path / "mine.safetensors", World()).weights[0], make().weights[0])


def test_a_policy_that_cannot_be_had_is_refused_before_any_life(tmp_path, monkeypatch):
    monkeypatch.setattr(evaluation, "population_test", lambda *_, **__: pytest.fail("computed"))
    save_policy(make(), tmp_path / "policy.safetensors")
    for name, words in [
        ("swingin", r"got 'swingin'; did you mean 'swinging'\?"),
        ("runs/none", "runs/none"),
        (str(tmp_path), "takes 8 numbers"),
    ]:
        with pytest.raises(PolicyError, match=words):
            evaluate(name, World(n_records=2), experiment="linear_n2")
