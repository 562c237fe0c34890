"""Folders of results: what they hold, and that they are there whole or not at all."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from swarm.figures.evaluation import save_evaluation, save_noise_sweep
from swarm.physics.world import World
from swarm.policies.network import save_policy
from swarm.population.evaluation import evaluate
from swarm.population.noise import COLUMNS, sweep_noise
from swarm.population.results import load_population, world_of
from tests.policies.test_network import make


def no_number(text):
    raise AssertionError(f"{text} is no JSON")


def swept(policy="random", **options):
    return sweep_noise(policy, World(), (0.0, 0.1), cells=3, life=6, seed=2, **options)


def evaluated(world=None):
    return evaluate("random", world or World(), experiment="own", cells=3, life=5)


@pytest.mark.parametrize(("egg", "further"), [(False, set()), (True, {"radial.png"})])
def test_the_folder_of_an_evaluation_holds_what_was_found(tmp_path, egg, further):
    world, out = World(field="radial" if egg else "linear"), tmp_path / "deep" / "out"
    done = evaluated(world)
    save_evaluation(done, out)
    files = {"population.nc", "summary.json", "gains.png", "centerlines.png", "comparison.png"}
    assert {file.name for file in out.iterdir()} == files | further
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in out.glob("*.png"))
    assert json.loads((out / "summary.json").read_text(), parse_constant=no_number) == done.summary
    results = load_population(out / "population.nc")
    assert results.identical(done.results)
    assert world_of(results) == world.replace(life=5.0)


def test_the_folder_of_a_sweep_holds_table_results_and_figure_with_their_origin(tmp_path):
    save_policy(make(), tmp_path / "policy.safetensors")
    done, out = swept(str(tmp_path), kind="curvature"), tmp_path / "out"
    save_noise_sweep(done, out)
    assert {file.name for file in out.iterdir()} == {"noise.nc", "noise.csv", "noise.png"}
    with xr.open_dataset(out / "noise.nc", engine="h5netcdf") as stored:
        assert stored.load().identical(done.results)
    rows = pd.read_csv(out / "noise.csv")
    assert list(rows) == ["kind", "noise", "policy", *COLUMNS, "cells", "worlds", "life", "seed", "commit"]
    assert rows["noise"].tolist() == [0.0, 0.0, 0.1, 0.1]
    assert rows["policy"].tolist() == ["dqn", "greedy"] * 2
    for column in COLUMNS:
        np.testing.assert_allclose(rows[column], done.results[column].values.ravel(), rtol=1e-14)
    assert rows[["cells", "life", "seed"]].drop_duplicates().values.tolist() == [[3, 6, 2]]


@pytest.mark.parametrize(("find", "save"), [(evaluated, save_evaluation), (swept, save_noise_sweep)])
def test_doing_it_again_gives_the_same_bytes_and_overwrites_nothing(tmp_path, find, save):
    def held(name):
        return {file.name: file.read_bytes() for file in (tmp_path / name).iterdir()}

    found, again = find(), find()
    save(found, tmp_path / "one")
    save(again, tmp_path / "two")
    before = held("one")
    assert before == held("two")
    with pytest.raises(FileExistsError, match=str(tmp_path / "one")):
        save(again, tmp_path / "one")
    assert before == held("one")
