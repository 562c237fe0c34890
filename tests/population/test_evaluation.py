"""Evaluation: what its folder holds, and that it is there whole or not at all."""

from __future__ import annotations

import json

import numpy as np
import pytest

from swarm import figures
from swarm.physics.world import World
from swarm.policies.network import save_policy
from swarm.policies.policy_file import PolicyError
from swarm.policies.strategies import Greedy, Random, Swinging
from swarm.population import contest as population
from swarm.population.evaluation import evaluate, named_policy
from swarm.population.results import load_population, world_of
from swarm.population.statistics import statistics
from tests.policies.test_network import make

NUMBERS = {"mean", "std", "min", "max", "ci95", "fraction_of_limit"}
PROMISED = {
    "policy": str,
    "experiment": str,
    "cells": int,
    "life": float,
    "seed": int,
    "gain": dict,
    "greedy": dict,
    "difference_to_greedy": dict,
    "wins": int,
    "versions": dict,
}


@pytest.fixture
def without_limit(monkeypatch):
    monkeypatch.setattr(population, "_limit", lambda world, starts: None)


@pytest.fixture
def with_limit(monkeypatch):
    monkeypatch.setattr(population, "_limit", lambda world, starts: 1.5)


def no_number(text):
    raise AssertionError(f"{text} is no JSON")


def test_the_folder_holds_what_was_promised(tmp_path, with_limit):
    save_policy(make(), tmp_path / "policy.safetensors")
    out = tmp_path / "evaluation"
    done = evaluate(str(tmp_path), World(), experiment="linear_n4", cells=6, life=12, seed=3, out=out)
    files = {"population.nc", "summary.json", "gains.png", "centerlines.png", "comparison.png"}
    assert {file.name for file in out.iterdir()} == files
    summary = json.loads((out / "summary.json").read_text(), parse_constant=no_number)
    assert summary == done.summary
    assert all(isinstance(summary[name], kind) for name, kind in PROMISED.items())
    assert set(summary) == {*PROMISED, "limit", "commit"}
    assert (summary["policy"], summary["experiment"]) == (str(tmp_path), "linear_n4")
    assert (summary["cells"], summary["life"], summary["seed"], summary["limit"]) == (6, 12.0, 3, 1.5)
    assert set(summary["gain"]) == set(summary["greedy"]) == NUMBERS
    assert set(summary["difference_to_greedy"]) == {"mean", "ci95"}
    results = load_population(out / "population.nc")
    assert results.identical(done.results)
    assert world_of(results) == World(life=12.0)
    assert results["policy"].values.tolist() == ["dqn", "greedy", "swinging"]
    numbers = statistics(results)
    assert summary["gain"] == {name: numbers["dqn"][name] for name in NUMBERS}
    assert summary["greedy"] == {name: numbers["greedy"][name] for name in NUMBERS}
    assert summary["gain"]["fraction_of_limit"] == pytest.approx(summary["gain"]["mean"] / 1.5)
    gain = results["gain"]
    assert summary["wins"] == int((gain.sel(policy="dqn") > gain.sel(policy="greedy")).sum())


def test_evaluating_again_gives_the_same_bytes(tmp_path, without_limit):
    for name in ("one", "two"):
        evaluate("random", World(), experiment="linear_n4", cells=3, life=5, out=tmp_path / name)
    for file in (tmp_path / "one").iterdir():
        assert file.read_bytes() == (tmp_path / "two" / file.name).read_bytes(), file.name


@pytest.mark.parametrize("name", ["greedy", "swinging", "random"])
def test_numbers_that_do_not_exist_are_null(tmp_path, without_limit, name):
    done = evaluate(name, World(), experiment="linear_n4", cells=1, life=3, out=tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(), parse_constant=no_number)
    assert summary["limit"] is None
    assert summary["gain"]["fraction_of_limit"] is None
    assert summary["gain"]["ci95"] is None
    assert summary["policy"] == name
    assert done.table[0][0] == "policy"


def test_where_there_is_an_egg_arrivals_are_counted(tmp_path):
    world = World(field="radial", varying_speed=True)
    done = evaluate("greedy", world, experiment="radial", cells=3, life=300, out=tmp_path / "out")
    assert done.summary["limit"] is None
    assert done.summary["arrived"] == 3
    assert done.table[0][-1] == "arrived"
    assert (tmp_path / "out" / "radial.png").exists()


def test_the_table_is_ordered_by_gain(without_limit):
    done = evaluate("random", World(), experiment="linear_n4", cells=5, life=50)
    assert done.table[1][0] == "greedy"
    assert len({len(row) for row in done.table}) == 1
    means = [float(row[1].split(" ")[0]) for row in done.table[1:]]
    assert means == sorted(means, reverse=True)


def test_a_folder_that_is_there_is_refused_before_anything_is_computed(tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "precious").write_text("1")
    monkeypatch.setattr(population, "lives", lambda *_, **__: pytest.fail("computed"))
    with pytest.raises(FileExistsError, match=str(tmp_path / "out")):
        evaluate("greedy", World(), experiment="linear_n4", out=tmp_path / "out")


def test_a_failure_on_the_way_leaves_nothing(tmp_path, monkeypatch, without_limit):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(figures, "save", full)
    with pytest.raises(OSError, match="No space left"):
        evaluate("greedy", World(), experiment="linear_n4", cells=2, life=3, out=tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_policies_go_by_their_names(tmp_path):
    assert named_policy("greedy", World()) == Greedy()
    assert named_policy("swinging", World()) == Swinging()
    assert named_policy("random", World()) == Random()
    save_policy(make(), tmp_path / "mine.safetensors")
    assert np.array_equal(named_policy(tmp_path / "mine.safetensors", World()).weights[0], make().weights[0])


def test_an_unknown_policy_suggests_the_nearest():
    with pytest.raises(PolicyError, match=r"got 'swingin'; did you mean 'swinging'\?"):
        named_policy("swingin", World())
    with pytest.raises(PolicyError, match="runs/none"):
        named_policy("runs/none", World())


def test_a_policy_of_another_world_is_refused_before_any_life(tmp_path):
    save_policy(make(), tmp_path / "policy.safetensors")
    with pytest.raises(PolicyError, match="takes 8 numbers"):
        evaluate(str(tmp_path), World(n_records=2), experiment="linear_n2", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
