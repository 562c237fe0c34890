"""Several worlds: each is a population of its own, and intervals know what is independent."""

import numpy as np
import pytest
import xarray as xr

from swarm._support import streams
from swarm.figures.evaluation import save_evaluation
from swarm.physics.crowd.medium import Medium
from swarm.physics.world import World
from swarm.policies.strategies import Random
from swarm.population.contest import population_test
from swarm.population.evaluation import evaluate
from swarm.population.results import load_population, pooled, save_population
from swarm.population.statistics import mean_interval, statistics
from tests.policies.test_network import make

NOISY = {"concentration_noise": 0.1, "curvature_noise": 0.2, "spread": {"speed": 0.1}}


@pytest.mark.parametrize(
    "options",
    [NOISY, {"field": "radial", "first_arrivals": 1}, {"flow": "taylor_green", "binding_rate": 9.0}],
    ids=str,
)
@pytest.mark.parametrize("block", [streams.BLOCK, 13])
def test_every_world_is_the_population_of_its_own_episode(monkeypatch, block, options):
    monkeypatch.setattr(streams, "BLOCK", block)
    world, players = World(**options), {"random": Random(), "dqn": make()}
    several = population_test(world, players, cells=5, worlds=3, life=9, seed=2, limit=False)
    assert several["gain"].dims == ("policy", "world", "cell")
    for episode in range(3):
        alone = population_test(world, players, cells=5, life=9, seed=2, limit=False, episode=episode)
        together = several.sel(world=episode, drop=True)
        for name in alone.data_vars:
            found = together[name].values
            if name in ("time", "position", "heading", "curvature", "centre", "concentration"):
                found = found[:, :, : alone.sizes["decision"]]
            np.testing.assert_array_equal(found, alone[name].values)


def test_intervals_are_over_worlds_where_cells_are_coupled():
    gain = np.random.default_rng(0).normal(size=(2, 6, 4))
    results = xr.Dataset(
        {"gain": (("policy", "world", "cell"), gain)}, {"policy": ["dqn", "greedy"]}, {"seed": 0}
    )
    free = statistics(results)["dqn"]
    assert free["ci95"] == mean_interval(gain[0].reshape(-1))
    coupled = statistics(results.assign_attrs(coupled=1))["dqn"]
    assert coupled["ci95"] == mean_interval(gain[0].mean(axis=1))
    assert coupled["difference_to_greedy"]["ci95"] == mean_interval((gain[0] - gain[1]).mean(axis=1))
    assert (coupled["mean"], coupled["wins"]) == (free["mean"], free["wins"])
    one = statistics(results.isel(world=0).assign_attrs(coupled=1))["dqn"]
    assert one["ci95"] is None


def test_only_worlds_whose_cells_share_something_are_coupled():
    medium = Medium(box=((0, 10), (0, 10)), shape=(64, 64), uptake=0.01)
    for options, coupled in (({}, False), ({"medium": medium}, True)):
        world = World(start_box=((4, 6), (4, 6)), **options)
        results = population_test(world, {}, cells=2, worlds=2, life=1, record=False)
        assert ("coupled" in results.attrs) == coupled


def test_an_evaluation_of_several_worlds_is_stored_and_pooled(tmp_path):
    found = evaluate("random", World(), experiment="own", cells=3, worlds=2, life=6)
    assert (found.summary["worlds"], found.summary["cells"]) == (2, 3)
    assert {row[6] for row in found.table.rows if row[0] == "swinging"} <= {f"{n}/6" for n in range(7)}
    save_evaluation(found, tmp_path / "out")
    back = load_population(tmp_path / "out" / "population.nc")
    xr.testing.assert_equal(back, found.results)
    flat = pooled(back)
    np.testing.assert_array_equal(flat["gain"].values, back["gain"].values.reshape(3, 6))
    np.testing.assert_array_equal(flat["position"].values[:, 4], back["position"].values[:, 1, 1])
    save_population(flat, tmp_path / "flat.nc")
    assert load_population(tmp_path / "flat.nc").sizes["cell"] == 6
