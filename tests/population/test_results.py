"""Results files: what is written comes back, and a stranger's file is checked before it is read."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import xarray as xr

from swarm.physics.fields import FIELDS, FunctionField
from swarm.physics.flows import FLOWS
from swarm.physics.world import World
from swarm.policies.strategies import Random
from swarm.population.contest import population_test
from swarm.population.results import ResultsError, load_population, save_population, settings, world_of


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


def test_results_without_series_come_back_too(tmp_path):
    short = population_test(World(), {}, cells=1, life=2, limit=False, record=False)
    save_population(short, tmp_path / "short.nc")
    assert load_population(tmp_path / "short.nc").identical(short)


def test_a_failed_write_keeps_the_old_file(results, saved, monkeypatch):
    before = saved.read_bytes()

    def half(self, path, **_):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(xr.Dataset, "to_netcdf", half)
    with pytest.raises(OSError, match="No space left"):
        save_population(results, saved)
    assert saved.read_bytes() == before
    assert list(saved.parent.iterdir()) == [saved]


@pytest.mark.parametrize("field", sorted(set(FIELDS) - {"gridded"}))
@pytest.mark.parametrize("flow", sorted(set(FLOWS) - {"gridded"}))
def test_the_world_can_be_made_again_from_its_settings(field, flow):
    import json

    world = World(
        field=field, flow=flow, n_records=8, varying_speed=True, curvatures=(2.0, 3.0, 4.0), life=7.0
    )
    stored = xr.Dataset(attrs={"world": json.dumps(settings(world))})
    assert world_of(stored) == world


def test_a_users_own_field_cannot_be_made_again(tmp_path):
    own = FunctionField(lambda position: position[..., 0], 1.0)
    results = population_test(World(field=own), {}, cells=2, life=2, limit=False)
    save_population(results, tmp_path / "own.nc")
    with pytest.raises(ResultsError, match=r"field must be one of .* got 'FunctionField'"):
        world_of(load_population(tmp_path / "own.nc"))


@pytest.mark.parametrize(
    "stored",
    ["", "[]", "{", '{"field": {"type": "os.system"}}', '{"field": 3, "flow": 4}', '{"n_records": 1e9}'],
)
def test_settings_that_make_no_world_are_refused(stored):
    with pytest.raises(ResultsError):
        world_of(xr.Dataset(attrs={"world": stored}))


def change(path, edit):
    with h5py.File(path, "r+") as file:
        edit(file)


def huge(file):
    del file["gain"]
    file.create_dataset("gain", shape=(2**20, 2**20), dtype="f8", chunks=(64, 64))  # takes no space


def squeezed(file):
    del file["maximal_gain"]
    file.create_dataset("maximal_gain", data=np.zeros((2, 3)), compression="gzip")


def linked(file):
    del file["gain"]
    file["gain"] = h5py.ExternalLink("/etc/hostname", "/gain")


def stored_elsewhere(file):
    del file["gain"]
    file.create_dataset("gain", (2, 3), "f8", external=[("/etc/passwd", 0, 48)])


def not_finite(file):
    file["gain"][0, 0] = np.nan


EDITS = {
    "more numbers than bytes": (huge, "all of its numbers"),
    "compressed": (squeezed, "uncompressed"),
    "a link to another file": (linked, "stored in the file itself"),
    "data in another file": (stored_elsewhere, "stored in the file itself"),
    "a folder": (lambda file: file.create_group("more"), "it must hold"),
    "another name": (lambda file: file.create_dataset("extra", data=[1.0]), "it must hold"),
    "no gains": (lambda file: file.__delitem__("gain"), "it must hold gain"),
    "gains that are no numbers": (not_finite, "finite"),
    "no seed": (lambda file: file.attrs.__delitem__("seed"), "attribute 'seed'"),
}


@pytest.mark.parametrize("name", EDITS)
def test_a_file_that_breaks_a_rule_is_refused_by_name(saved, name):
    edit, words = EDITS[name]
    change(saved, edit)
    with pytest.raises(ResultsError, match=words) as error:
        load_population(saved)
    assert str(saved) in str(error.value)


@pytest.mark.parametrize("content", [b"", b"\x89HDF\r\n\x1a\n", b"\x80\x04.", b"x" * 4096])
def test_a_file_of_another_kind_is_refused_by_name(tmp_path, content):
    path = tmp_path / "population.nc"
    path.write_bytes(content)
    with pytest.raises(ResultsError, match=str(path)):
        load_population(path)


def test_a_file_cut_short_is_refused(saved):
    whole = saved.read_bytes()
    for length in (len(whole) // 2, len(whole) - 100):
        saved.write_bytes(whole[:length])
        with pytest.raises(ResultsError, match=str(saved)):
            load_population(saved)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ResultsError, match="it is not there"):
        load_population(tmp_path / "population.nc")
    with pytest.raises(ResultsError, match="ordinary file"):
        load_population(tmp_path)
