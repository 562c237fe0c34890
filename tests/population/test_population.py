"""Population tests: the same starts for every policy, lives that depend on nothing else, known gains."""

import numpy as np
import pytest

from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.strategies import Greedy, Random, Swinging
from swarm.population.contest import population_test
from swarm.population.evaluation import compete, evaluate
from tests.policies.test_network import make

RACE = World(field="radial", start_box=((20, 30), (0, 1)))
NOISY = {"concentration_noise": 0.1, "curvature_noise": 0.2, "rotational_diffusion": 0.02}


def trial(world, policies=None, **options):
    """A population test without the limit, which is computed elsewhere."""
    return population_test(world, policies or {}, **{"limit": False, "record": False, **options})


@pytest.mark.parametrize(
    ("options", "life", "mean", "spread"),
    [
        ({"n_records": 2}, 200, 21.3, 1.4),
        ({"n_records": 4}, 200, 20.6, 0.3),
        ({"n_records": 8}, 200, 3.5, 0.4),
        ({"varying_speed": True}, 200, 17.4, 0.25),
        ({"flow": "taylor_green"}, 400, 37.0, 3.1),
    ],
    ids=str,
)
def test_greedy_gains_what_it_is_known_to_gain(options, life, mean, spread):
    gain = trial(World(**options), cells=100, life=life)["gain"].sel(policy="greedy")
    assert abs(float(gain.mean()) - mean) < max(0.3, 3 * spread / 10)
    assert abs(float(gain.std()) - spread) < 0.35


def test_intervals_that_are_not_rounded_spoil_greedy():
    gain = trial(World(interval_rule="exact"), cells=100)["gain"].sel(policy="greedy")
    assert 16 < float(gain.mean()) < 22
    assert 9 < float(gain.std()) < 13


def test_every_policy_has_the_same_starts_and_they_are_the_test_populations():
    world = World()
    results = trial(world, {"random": Random(), "swinging": Swinging()}, cells=7, life=5, seed=3, record=True)
    starts = draw_starts(world, 7, 3, population="test")
    assert (results["start_position"].values == starts.position).all()
    assert (results["start_heading"].values == starts.heading).all()
    assert (results["past"].values == starts.past).all()
    first = results.isel(decision=0)
    for name in ("random", "swinging", "greedy"):
        one = first.sel(policy=name)
        assert (one["position"].values == starts.position.astype(np.float32)).all()
        assert (one["curvature"].values == np.array([3.0, 5.0], np.float32)[starts.past[:, 0]]).all()
        assert (one["time"].values == 0).all()


def test_populations_for_validation_and_training_have_starts_of_their_own():
    kinds = ("training", "validation", "test")
    first, second, third = (
        trial(World(), cells=5, life=1, population=kind)["start_position"].values for kind in kinds
    )
    assert not np.any((first == second) | (second == third) | (first == third))


@pytest.mark.parametrize(
    "options",
    [{}, NOISY, {"flow": "taylor_green", **NOISY}, {"field": "radial", "varying_speed": True}],
    ids=str,
)
def test_a_cells_life_does_not_depend_on_how_many_others_there_are(options):
    policies = {"dqn": make(), "random": Random()}
    few, many = (trial(World(**options), policies, cells=cells, life=40) for cells in (3, 150))
    for name in ("gain", "maximal_gain", "lifetime", "decisions", "arrived"):
        assert (few[name].values == many[name].values[:, :3]).all()


def test_a_policys_lives_do_not_depend_on_the_other_policies():
    world = World(**NOISY)
    alone = trial(world, {"random": Random()}, cells=4, life=10)
    crowd = trial(world, {"dqn": make(), "greedy": Greedy(), "random": Random()}, cells=4, life=10)
    assert crowd["policy"].values.tolist() == ["dqn", "greedy", "random"]
    for name in ("random", "greedy"):
        assert (alone["gain"].sel(policy=name).values == crowd["gain"].sel(policy=name).values).all()


@pytest.mark.parametrize("options", [{}, {"varying_speed": True}, {"flow": "taylor_green"}], ids=str)
def test_series_tell_each_life_from_its_start_to_its_end(options):
    world = World(**options)
    results = trial(world, {"random": Random()}, cells=6, life=9.99, record=True)
    time = results["time"].values
    alive = np.isfinite(time)
    ends = alive.sum(axis=-1) - 1
    assert (results["decisions"].values == ends).all()
    assert (np.nanmax(time, axis=-1) == 9.99).all()
    assert (results["lifetime"].values == 9.99).all()
    for name in ("position", "heading", "curvature", "centre", "concentration"):
        values = results[name].values.reshape(*time.shape, -1)
        assert (np.isfinite(values).all(axis=-1) == alive).all()
    concentration = results["concentration"].values
    last = np.take_along_axis(concentration, ends[..., None], axis=-1)[..., 0]
    assert np.allclose(last - concentration[..., 0], results["gain"].values, atol=1e-5)
    highest = np.nanmax(concentration, axis=-1) - concentration[..., 0]
    assert np.allclose(highest, results["maximal_gain"].values, atol=1e-5)
    away = np.linalg.norm(results["centre"].values - results["position"].values, axis=-1)
    assert np.allclose(away[alive], 1 / results["curvature"].values[alive], atol=1e-5)


def test_units_and_provenance_are_in_the_attributes():
    results = trial(World(), cells=2, life=2, record=True, seed=4)
    assert all("long_name" in values.attrs for values in results.data_vars.values())
    assert results["position"].attrs["units"] == "length"
    assert results["gain"].attrs["units"] == "concentration"
    assert results.attrs["seed"] == 4
    assert results.attrs["life"] == 2.0
    assert '"numpy"' in results.attrs["versions"]


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"cells": 0}, ValueError, "cells must be a whole number of at least 1, got 0"),
        ({"worlds": 1.5}, TypeError, "worlds must be a whole number of at least 1, got 1.5"),
        ({"life": -1.0}, ValueError, "life must be a finite number above 0"),
        ({"seed": -1}, ValueError, "seed must not be negative"),
        ({"policies": {"": Greedy()}}, TypeError, "policies must be named by text, got ''"),
        ({"policies": {"mine": 3}}, TypeError, "policy 'mine' must have act"),
        ({"policies": {"greedy": Random()}}, ValueError, "policy 'greedy' must be the greedy strategy"),
        ({"record": 1}, TypeError, "record must be one of all, ends, statistics, thinned, got 1"),
        ({"record": "end"}, ValueError, "record must be one of all, .*, got 'end'; did you mean"),
    ],
)
def test_bad_input_is_named(options, error, words):
    with pytest.raises(error, match=words):
        population_test(World(), options.pop("policies", {}), **options)


@pytest.mark.parametrize(
    "work",
    [
        lambda tell: trial(World(), {"swinging": Swinging()}, cells=2, life=4, progress=tell),
        lambda tell: evaluate("random", World(), experiment="own", cells=2, life=4, progress=tell),
        lambda tell: compete("random", "greedy", RACE, cells=2, worlds=2, life=4, progress=tell),
    ],
)
def test_progress_rises_to_the_whole(work):
    told = []
    work(told.append)
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0.0, 1.0)
    assert len(set(told)) > 10
