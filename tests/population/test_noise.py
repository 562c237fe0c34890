"""Gain against noise: every level is a population test of the same cells."""

import numpy as np
import pytest

from swarm import population_test
from swarm.physics.world import World
from swarm.policies.policy_file import PolicyError
from swarm.policies.strategies import Greedy, Random
from swarm.population import noise
from swarm.population.noise import KINDS, sweep_noise
from swarm.population.statistics import statistics


@pytest.mark.parametrize("kind", KINDS)
def test_every_level_is_the_population_test_of_its_world(kind):
    world, parameter = World(curvature_noise=0.1), KINDS[kind].parameter
    done = sweep_noise(Random(), world, (0.0, 0.3), kind=kind, cells=4, life=12, seed=3)
    for level, found in zip((0.0, 0.3), done.tests, strict=True):
        noisy = world.replace(**{parameter: level})
        contest = {"random": Random()}
        alone = population_test(noisy, contest, cells=4, life=12, seed=3, record=False, limit=False)
        assert found.drop_attrs().identical(alone.drop_attrs())
        numbers = statistics(alone)["random"]
        row = done.results.sel(noise=level, policy="random")
        assert row["cell_gain"].values.tolist() == alone["gain"].sel(policy="random").values.tolist()
        assert row["gain"].item() == numbers["mean"]
        assert [row["gain_low"].item(), row["gain_high"].item()] == numbers["ci95"]
        assert row["ahead"].item() == numbers["difference_to_greedy"]["mean"]
        assert row["wins"].item() == numbers["wins"]
    assert not np.array_equal(*done.results["cell_gain"].sel(policy="greedy").values)


def test_all_levels_and_policies_have_the_same_starts():
    done = sweep_noise("random", World(), (0.0, 0.1, 1.0), cells=3, life=5)
    for name in ("start_position", "start_heading", "past"):
        for test in done.tests:
            assert test[name].identical(done.results[name])


def test_a_single_cell_has_no_intervals_and_origin_is_told():
    done = sweep_noise("random", World(), (0.0, 0.1), kind="curvature", cells=1, life=5, seed=2)
    assert done.table.rows[0][:2] == ["0", "random"]
    assert done.table.rows[0][3] is None
    assert np.isnan(done.results["gain_low"]).all()
    assert (done.results.attrs["kind"], done.results.attrs["tested"]) == ("curvature_noise", "random")
    assert done.results.attrs["seed"] == 2
    assert {"versions", "commit", "world", "life"} <= set(done.results.attrs)


def test_wins_are_of_the_cells_of_all_worlds_and_intervals_over_what_is_independent():
    eating = {"box": ((-5, 5), (-5, 5)), "shape": (64, 64), "edges": "periodic", "leaving": "wrap"}
    world = World(start_box=((-1, 1), (-1, 1)))
    shared = world.replace(medium={**eating, "diffusivity": 0.1, "uptake": 0.01})
    for each, worlds in ((world, 3), (shared, 3), (shared, 1)):
        done = sweep_noise(Random(), each, (0.0, 0.1), cells=2, worlds=worlds, life=3)
        found, dims = done.results, ("world", "cell") if worlds > 1 else ("cell",)
        assert found["cell_gain"].dims == ("noise", "policy", *dims)
        numbers = [statistics(test)["random"] for test in done.tests]
        expected = [row["ci95"] or [np.nan] * 2 for row in numbers]
        intervals = np.stack([found["gain_low"], found["gain_high"]], axis=-1)[:, 0]
        np.testing.assert_array_equal(intervals, expected)
        assert np.isnan(intervals).all() == (worlds == 1)
        assert done.table.rows[0][-1] == f"{numbers[0]['wins']}/{2 * worlds}"
        assert {(row["cells"], row["worlds"]) for row in noise.records(found)} == {(2, worlds)}


@pytest.mark.parametrize(
    ("levels", "options", "message"),
    [
        ((), {}, "levels of noise must be at least one"),
        ((0.1, 0.1), {}, r"levels of noise must be at least one, and rise, got \(0.1, 0.1\)"),
        ((0.0, float("inf")), {"kind": "curvature"}, "curvature_noise must be a finite number"),
        ((0.0,), {"kind": "rotational"}, "kind must be one of .*did you mean 'rotation'"),
        ((0.0, 0.1), {"policy": "optimal"}, "Optimal needs no perturbations"),
        ((0.0, 0.1), {"policy": "greeedy"}, "did you mean 'greedy'"),
    ],
)
def test_bad_input_is_refused_before_anything_is_computed(levels, options, message, monkeypatch):
    monkeypatch.setattr(noise, "population_test", lambda *_, **__: pytest.fail("computed"))
    with pytest.raises((ValueError, PolicyError), match=message):
        sweep_noise(options.pop("policy", Greedy()), World(), levels, **options)


def test_where_there_is_an_egg_arrivals_stand_beside_the_gains():
    done = sweep_noise("greedy", World(field="radial"), (0.0, 0.5), cells=3, life=90)
    shown = [dict(zip(done.table.headings, row, strict=True)) for row in done.table.rows]
    for row, test in zip(shown, (each for each in done.tests for _ in "g"), strict=True):
        times = test["lifetime"].values[test["arrived"].values]
        assert row["arrived"] == f"{len(times)}/3"
        assert row["time to egg"] == (f"{times.mean():.1f}" if len(times) else None)
    assert [row["arrived"] for row in noise.records(done.results)] == done.results[
        "arrived"
    ].values.ravel().tolist()
