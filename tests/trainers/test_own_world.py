"""Training in one's own gridded world: what a run records of its data, and where it finds them again."""

import dataclasses
import hashlib
import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
import xarray as xr
import yaml

from swarm import fields, flows, load_policy
from swarm.population.results import load_population, world_of
from tests.short_runs import Crash, go_on, kept, short_settings, start, whole
from tests.trainers.test_cli import SHORT, refused, run
from trainers.settings.composition import settings_from_stored
from trainers.training import run as running
from trainers.training.run_folder import RunFolder

FIELD = {"type": "gridded", "path": "data/my.nc", "edges": "clamped", "variable": "c", "egg_radius": 0.5}
FLOW = {"type": "gridded", "path": "data/my.nc", "edges": "clamped", "interpolation": "linear"}
RUN = Path("runs/mine")


@pytest.fixture(autouse=True)
def project(monkeypatch, tmp_path):
    """A folder with data, which is the current one."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    folder = tmp_path / "project"
    (folder / "data").mkdir(parents=True)
    monkeypatch.chdir(folder)
    write(1.0)
    return folder


def write(scale):
    """A plume in a shear flow."""
    x, y = np.linspace(-20, 20, 41), np.linspace(-15, 15, 31)
    across, along = np.meshgrid(y, x)
    plume = scale * 30 * np.exp(-(across**2 + along**2) / 200)
    data = {"c": plume, "u_x": 0.002 * across, "u_y": 0 * across}
    grid = xr.Dataset({name: (("x", "y"), values) for name, values in data.items()}, {"x": x, "y": y})
    grid.to_netcdf("data/my.nc", engine="h5netcdf")


def word(part):
    return "{" + ", ".join(f"{name}: {value}" for name, value in part.items()) + "}"


def test_one_can_train_in_ones_own_gridded_world(project, monkeypatch):
    worlds = [f"world.field={word(FIELD)}", f"world.flow={word(FLOW)}", "world.sense_flow=true"]
    code, out, err = run("train", *SHORT, *worlds, f"hydra.run.dir={RUN}")
    assert code == 0, out + err
    stored = yaml.safe_load((RUN / "settings.yaml").read_text())["world"]
    number = hashlib.sha256(Path("data/my.nc").read_bytes()).hexdigest()
    for part, given in ((stored["field"], FIELD), (stored["flow"], FLOW)):
        assert part == part | given | {"sha256": number, "shape": [41, 31]}
    field, flow = fields.make(stored["field"]), flows.make(stored["flow"])
    assert stored["field"]["gradient_scale"] == field.gradient_scale
    assert stored["flow"]["spin_scale"] == flow.spin_scale == pytest.approx(0.001)
    assert load_policy(RUN).card["settings"]["world"] == stored
    code, shown, err = run("evaluate", RUN)
    assert code == 0, shown + err
    monkeypatch.chdir(project.parent)  # from where the data are found near the run
    code, again, err = run("evaluate", project / RUN, "--out", "out")
    assert (code, again) == (0, f"{shown}results and figures are in out\n"), err
    results = load_population("out/population.nc")
    world = json.loads(results.attrs["world"])
    for part in ("field", "flow"):
        assert {**world[part], "path": "data/my.nc"} == stored[part]
    assert fields.describe(world_of(results).field) == world["field"]


def plain(value):
    return value.numpy().tobytes() if isinstance(value, torch.Tensor) else value


def settings():
    return short_settings(world={"field": FIELD, "flow": FLOW})


def test_a_run_goes_on_to_the_last_bit_when_it_and_its_data_have_moved(project, monkeypatch):
    whole("whole", settings())

    def crash(training, _):
        if training.epoch == 3:
            raise Crash

    with pytest.raises(Crash):
        go_on(start(RUN, settings()), settings(), report=crash)
    monkeypatch.chdir(project.parent)
    shutil.move("project", "moved")
    training, moved = running.resume(Path("moved") / RUN)
    assert training.settings.world["flow"]["path"] == str(project.parent / "moved" / "data" / "my.nc")
    running.complete(training, moved)
    whole_run, gone_on = (kept(each) for each in (RunFolder(Path("moved/whole")), moved))
    different = {name for name, value in whole_run.items() if plain(value) != plain(gone_on[name])}
    assert different == {"policy.safetensors"}  # whose card tells where the data lie
    one, other = (load_policy(each) for each in ("moved/whole", moved.path))
    for a, b in zip(one.weights + one.biases, other.weights + other.biases, strict=True):
        np.testing.assert_array_equal(a, b)


def test_data_are_found_where_the_run_was_begun(project, monkeypatch, tmp_path):
    far = tmp_path / "scratch" / "run"
    run_in = start(far, settings())
    monkeypatch.chdir("/")
    stored = dataclasses.asdict(settings_from_stored(RunFolder.open(far)[1], far))
    assert stored["world"]["field"]["path"] == str(project / "data" / "my.nc")
    (run_in.path / "run.json").write_text('{"begun_in": 3}')
    shutil.copy(project / "data" / "my.nc", far)
    assert settings_from_stored(RunFolder.open(far)[1], far).world["field"]["path"] == str(far / "my.nc")


def test_data_that_are_missing_or_others_are_named_in_one_line(project):
    start(RUN, settings())
    write(2.0)
    said = refused("train", f"resume={RUN}")
    assert "stored settings: world.field: data must be the file data/my.nc with SHA-256 " in said
    Path("data/my.nc").unlink()
    said = refused("train", f"resume={RUN}")
    assert "stored settings: world.field: data must be a file that exists, got none of data/my.nc, " in said
    assert str(project / RUN / "my.nc") in said
    said = refused("train", f"world.field={word(FIELD)}")
    assert said == "swarm: world.field 'gridded': data must be a file that exists, got data/my.nc"


WRONG = {
    "world.flow={type: vortex, cor: 3}": "parameter of flow 'vortex' .* got 'cor'; did you mean 'core'",
    "evaluation.field={type: linear, offset: high}": "evaluation.field 'linear': offset must be .* 'high'",
}


@pytest.mark.parametrize("setting", WRONG)
def test_wrong_parts_are_told_before_anything_runs(setting):
    assert re.search(WRONG[setting], refused("train", setting))
