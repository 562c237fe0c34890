"""Populations in blocks: the same cells, statistics and files, however divided, stopped or shared out."""

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xarray as xr

from swarm._support import files, streams
from swarm.physics.starts import draw_chance, draw_noise, draw_record_noise, draw_starts
from swarm.physics.world import World
from swarm.policies.strategies import Greedy, Random
from swarm.population.blocks import block as blocks
from swarm.population.blocks.block import PopulationTest, blocks_of, lives
from swarm.population.contest import population_test
from swarm.population.results import load_population
from swarm.population.statistics import statistics

NOISY = World(life=3.0, concentration_noise=0.1, curvature_noise=0.2, spread={"speed": 0.1, "curvature": 0.1})
POLICIES = {"random": Random(), "greedy": Greedy()}


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(streams, "BLOCK", 64)


def outcome(world=NOISY, cells=150, **options):
    defaults = {"life": world.life, "seed": 5, "record": "ends"}
    return population_test(world, POLICIES, cells=cells, **(defaults | options))


def test_a_part_of_a_population_is_drawn_without_the_rest():
    world = NOISY.replace(start_box=((-3, 3), (-3, 3)), field="radial")  # some are drawn again
    for draw in (
        lambda cells, first: draw_starts(world, cells, 7, first=first).position,
        lambda cells, first: draw_starts(world, cells, 7, first=first).past,
        lambda cells, first: draw_starts(world, cells, 7, first=first).factors,
        lambda cells, first: draw_record_noise(world, cells, 7, first=first),
        lambda cells, first: draw_noise(7, cells, 5, block=1, first=first),
        lambda cells, first: draw_chance(7, cells, 5, block=1, first=first),
    ):
        whole = draw(200, 0)
        assert len(np.unique(whole.reshape(200, -1), axis=0)) > 8
        for first, cells in ((0, 64), (64, 64), (30, 100), (128, 72)):
            np.testing.assert_array_equal(draw(cells, first), whole[first : first + cells])


@pytest.mark.parametrize("record", ["ends", "thinned", "all"])
def test_a_divided_population_lives_the_lives_of_an_undivided_one(record):
    results = outcome(record=record)
    starts, test = draw_starts(NOISY, 150, 5), PopulationTest(NOISY, POLICIES, 150, 1, 5, record=record)
    assert len(blocks_of(test)) == 3
    for name, policy in POLICIES.items():
        recorded = {"record": record != "ends", "every": test.every}
        whole = lives(NOISY, policy, starts, 5, name=name, population="test", **recorded)
        for key, values in whole.items():
            found = results[key].sel(policy=name).values
            found = found[:, : values.shape[1]] if values.ndim > 1 else found
            np.testing.assert_array_equal(found, values.astype(found.dtype))
    np.testing.assert_array_equal(results["cell"], np.arange(150))


def test_a_thinned_record_holds_every_few_moments_of_the_whole():
    world = World(life=40.0)
    whole, thinned = (outcome(world, 3, record=record) for record in ("all", "thinned"))
    assert 24 < thinned.sizes["decision"] <= blocks.THINNED < whole.sizes["decision"]
    np.testing.assert_array_equal(thinned["position"], whole["position"].sel(decision=thinned["decision"]))


def test_cells_that_matter_to_each_other_are_never_parted():
    eating = World(medium={"box": ((-9, 9), (-9, 9)), "shape": (128, 128)}, start_box=((0, 1), (0, 1)))
    assert [each.worlds for each in blocks_of(PopulationTest(eating, {}, 2, 3, 0))] == [
        1,
        1,
        1,
    ]  # for its grid
    alone = [each.worlds for each in blocks_of(PopulationTest(World(), {}, 30, 5, 0))]
    assert alone == [2, 2, 1]
    crowd = World(life=2.0, first_arrivals=1, field="radial")
    assert [each.cells for each in blocks_of(PopulationTest(crowd, {}, 200, 2, 0))] == [200, 200]


@pytest.mark.parametrize("world", [World(life=3.0), World(life=3.0, first_arrivals=1, field="radial")])
def test_tallies_merge_to_the_statistics_of_all_cells(world):
    results = outcome(world, 50, worlds=7)
    whole = results.copy()
    del whole.attrs["statistics"]
    found, asked = statistics(results), statistics(whole)
    for name in POLICIES:
        for row in (found[name], asked[name]):
            assert len(row.pop("quantiles")) == 7
            row["ahead"], row["ahead_ci95"] = row.pop("difference_to_greedy").values()
        assert found[name].keys() == asked[name].keys()
        for key, number in asked[name].items():
            expected = np.nan if number is None else number
            np.testing.assert_allclose(np.float64(found[name][key]), expected, rtol=1e-9, atol=1e-14)


def test_statistics_of_some_cells_are_not_those_of_all():
    results = outcome()
    some = results.isel(cell=slice(100))
    assert statistics(some)["random"]["mean"] == float(some["gain"].sel(policy="random").mean())


def test_quantiles_are_off_by_the_rank_that_is_stated(monkeypatch):
    monkeypatch.setattr(streams, "BLOCK", 5000)
    results = outcome(World(life=0.4), 23_000)
    gains = np.sort(results["gain"].sel(policy="random").values)
    for part, value in statistics(results)["random"]["quantiles"].items():
        low, high = np.searchsorted(gains, value, "left"), np.searchsorted(gains, value, "right")
        allowed = len(gains) / 2048 + 5
        assert low - allowed <= float(part) * len(gains) <= high + allowed


def test_the_limit_is_that_of_all_cells():
    world = World(life=3.0)
    divided, undivided = outcome(world), population_test(world, {}, cells=64, life=3.0, seed=5, record="ends")
    from swarm.optimal.physical_limit import limit

    assert divided.attrs["limit"] == pytest.approx(limit(world, draw_starts(world, 150, 5)), rel=1e-12)
    assert undivided.attrs["limit"] == limit(world, draw_starts(world, 64, 5))


def test_a_file_is_written_part_by_part_and_read_when_asked(tmp_path):
    results = outcome(record="thinned")
    there = outcome(record="thinned", out=tmp_path / "population.nc")
    assert not any(there[name]._in_memory for name in ("gain", "position"))
    assert there["gain"].encoding["chunksizes"] == (1, 64)
    xr.testing.assert_equal(there.load(), results)
    assert statistics(there) == statistics(results) == statistics(outcome(record="statistics"))
    assert load_population(tmp_path / "population.nc")["arrived"].dtype == bool
    assert [path.name for path in tmp_path.iterdir()] == ["population.nc"]
    there.close()


def test_a_killed_test_goes_on_at_its_blocks_and_writes_the_same_bytes(tmp_path, monkeypatch):
    class Killed(BaseException):
        pass

    def killing(done):
        if done > 0.9:
            raise Killed

    outcome(out=tmp_path / "whole.nc").close()
    with pytest.raises(Killed):
        outcome(out=tmp_path / "new" / "killed.nc", progress=killing)
    counted = []
    monkeypatch.setattr(
        blocks,
        "lived",
        lambda test, block, *_, lived=blocks.lived: (counted.append(block.number), lived(test, block))[1],
    )
    with pytest.raises(FileExistsError, match=r"must hold parts of this population, got another seed"):
        outcome(out=tmp_path / "new" / "killed.nc", seed=6)
    owned = files.owned(tmp_path / "new" / "killed.nc.parts")
    with owned, pytest.raises(FileExistsError, match="is being worked on by another process"):
        outcome(out=tmp_path / "new" / "killed.nc")
    outcome(out=tmp_path / "new" / "killed.nc").close()
    outcome(out=tmp_path / "new" / "killed.nc").close()  # there is nothing left to do
    assert counted == [2]
    whole, killed = (tmp_path / name for name in ("whole.nc", "new/killed.nc"))
    assert whole.read_bytes() == killed.read_bytes()
    with pytest.raises(FileExistsError, match="must be new or hold the same population"):
        outcome(out=whole, seed=6)


def test_blocks_are_merged_in_their_order_whoever_was_first(tmp_path):
    alone, seen = outcome(), []
    with ThreadPoolExecutor(3) as executor:
        shared = outcome(executor=executor, progress=seen.append)
    xr.testing.assert_identical(shared, alone)
    assert seen[-1] == 1.0
    assert json.loads(alone.attrs["statistics"])["cells"] == 150


class Failing:
    """Greedy, until it is to steer the last block."""

    def act(self, world, state, uniform):
        if len(state.finished) < 64:
            raise ArithmeticError("it cannot steer 22 cells")
        return Greedy().act(world, state)


@pytest.mark.parametrize("workers", [None, 2])
def test_the_error_of_a_block_is_that_of_the_test(workers):
    with ThreadPoolExecutor(2) as executor, pytest.raises(ArithmeticError, match="it cannot steer 22 cells"):
        population_test(
            NOISY, {"failing": Failing()}, cells=150, life=1.0, record="ends", executor=workers and executor
        )
