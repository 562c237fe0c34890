"""Results files: what is written comes back, and a stranger's file is checked before it is read."""

import json
import os

import h5py
import numpy as np
import pytest
import xarray as xr

from swarm.physics.fields import FunctionField
from swarm.physics.world import World
from swarm.policies.strategies import Random
from swarm.population.contest import population_test
from swarm.population.results import ResultsError, load_population, save_population, world_of


@pytest.fixture(scope="module")
def results():
    return population_test(World(), {"random": Random()}, cells=3, life=4, limit=False)


@pytest.fixture
def saved(results, tmp_path):
    save_population(results, tmp_path / "population.nc")
    return tmp_path / "population.nc"


def test_results_come_back_as_they_were(results, saved):
    assert load_population(saved).identical(results)
    assert list(saved.parent.iterdir()) == [saved]
    without_series = population_test(World(), {}, cells=1, life=2, limit=False, record=False)
    save_population(without_series, saved)
    assert load_population(saved).identical(without_series)


@pytest.mark.parametrize("flow", ["still", "vortex"])
def test_the_world_can_be_made_again_from_its_settings(flow):
    options = {"n_records": 8, "varying_speed": True, "curvatures": (2.0, 3.0, 4.0), "life": 7.0}
    world = World(field="gaussian_plume", flow=flow, **options)
    stored = xr.Dataset(attrs={"world": json.dumps(world.described())})
    assert world_of(stored) == world


def test_a_users_own_field_cannot_be_made_again(tmp_path):
    own = FunctionField(lambda position: position[..., 0], 1.0)
    results = population_test(World(field=own), {}, cells=2, life=2, limit=False)
    save_population(results, tmp_path / "own.nc")
    with pytest.raises(ResultsError, match=r"field must be one of .* got 'FunctionField'"):
        world_of(load_population(tmp_path / "own.nc"))


@pytest.mark.parametrize(
    "stored",
    [
        *("", "[]", "{", '{"field": {"type": "os.system"}}', '{"field": 3, "flow": 4}', '{"n_records": 1e9}'),
        *("[" * 100_000, '{"a":' * 100_000, np.arange(3), b"\xff", '{"life": 1e999}', '{"n_records": 9e99}'),
        '{"flow": {"type": "taylor_green", "wavenumber": 1e300}}',
        '{"flow": {"type": "vortex", "core": 1e-300}}',
        '{"field": {"type": "diffusing_source", "core": 1e300}}',
        '{"curvatures": [1e-300, 1e300]}',
    ],
    ids=lambda stored: str(stored)[:30],
)
def test_settings_that_make_no_world_are_refused_in_one_line(stored):
    with pytest.raises(ResultsError) as error:
        world_of(xr.Dataset(attrs={"world": stored}))
    assert len(str(error.value).splitlines()) == 1
    assert len(str(error.value)) < 400


@pytest.mark.parametrize(
    "options",
    [
        {"flow": {"type": "taylor_green", "wavenumber": 1e300}},
        {"flow": {"type": "shear", "height": 1e-300}},
        {"flow": {"type": "vortex", "speed_scale": 1e200}},
        {"field": {"type": "diffusing_source", "core": 1e300}},
    ],
    ids=str,
)
def test_numbers_that_overflow_are_refused_by_name(options):
    with pytest.raises(ValueError, match=f"{next(iter(options))} must "):
        World(**options)


def edited(edit):
    """What edits the numbers of a file."""

    def change(path):
        with h5py.File(path, "r+") as file:
            edit(file)

    return change


def replaced(name, **options):
    def edit(file):
        del file[name]
        file.create_dataset(name, **options)

    return edited(edit)


def spoilt(file):
    file["gain"][0, 0] = np.nan


@edited
def linked(file):
    del file["gain"]
    file["gain"] = h5py.ExternalLink("/etc/hostname", "/gain")


HUGE = {"shape": (2**20, 2**20), "dtype": "f8", "chunks": (64, 64)}  # takes no space
ELSEWHERE = {"shape": (2, 3), "dtype": "f8", "external": [("/etc/passwd", 0, 48)]}
HOSTILE = {
    "more numbers than bytes": (replaced("gain", **HUGE), "all of its numbers"),
    "compressed": (replaced("arrived", data=np.zeros((2, 3)), compression="gzip"), "uncompressed"),
    "a link to another file": (linked, "stored in the file itself"),
    "data in another file": (replaced("gain", **ELSEWHERE), "stored in the file itself"),
    "a folder": (edited(lambda file: file.create_group("more")), "it must hold"),
    "another name": (edited(lambda file: file.create_dataset("extra", data=[1.0])), "it must hold"),
    "another shape": (replaced("gain", data=np.zeros(3)), "'gain' must have the dimensions"),
    "no gains": (edited(lambda file: file.__delitem__("gain")), "it must hold gain"),
    "gains that are not finite": (edited(spoilt), "its gains must be finite"),
    "no seed": (edited(lambda file: file.attrs.__delitem__("seed")), "attribute 'seed'"),
    "empty": (lambda path: path.write_bytes(b""), "NetCDF"),
    "a pickle": (lambda path: path.write_bytes(b"\x80\x04."), "NetCDF"),
    "cut in half": (lambda path: os.truncate(path, path.stat().st_size // 2), "NetCDF"),
    "not there": (lambda path: path.unlink(), "it is not there"),
    "a directory": (lambda path: (path.unlink(), path.mkdir()), "ordinary file"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_file_that_breaks_a_rule_is_refused_by_name(saved, name):
    change, words = HOSTILE[name]
    change(saved)
    with pytest.raises(ResultsError, match=words) as error:
        load_population(saved)
    assert str(saved) in str(error.value)
