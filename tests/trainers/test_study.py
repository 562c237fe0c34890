"""Studies: one file, one dataset with named axes; what is there is neither trained nor tested again."""

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import yaml

from swarm._support import files
from swarm.policies.network import load_policy, save_policy
from swarm.policies.policy_file import PolicyError
from swarm.population.contest import population_test
from swarm.population.statistics import mean_interval
from tests.policies.test_network import make
from tests.trainers.test_comparing import EATING
from trainers.jobs import study as studies
from trainers.jobs import sweep
from trainers.jobs.study import draw, study
from trainers.jobs.study_figure import axes_of, panels, request_of
from trainers.jobs.study_plan import plan_of, stacks
from trainers.settings.composition import SettingsError, settings_from, settings_from_stored
from trainers.training.run_folder import RunError, RunFolder

NOISE = "world.concentration_noise"
STUDY = {
    "settings": {"experiment": "linear_n4", "tensorboard": False, "evaluation": {"cells": 3, "life": 4.0}},
    "grid": {
        NOISE: [0.0, 0.2],
        "net": {"small": {"learning.hidden": [4]}, "wide": {"learning": {"hidden": [6]}}},
    },
    "seeds": 2,
    "tests": {"own": None, "noisy": {"cells": 5, "seed": 7, "world": {"concentration_noise": 0.2}}},
    "policies": ["swinging"],
    "figures": ["gain:world.concentration_noise"],
}
HERE = {"where": ("here", None, None)}


@pytest.fixture(autouse=True)
def trained(monkeypatch, tmp_path):
    """Names of the runs that were trained, in no time: their policies are drawn."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    names = []

    def train_in(path, settings):
        names.append(path.name)
        run = RunFolder.create(path, settings)
        for seed, file in run.policies(settings):
            file.parent.mkdir(exist_ok=True)
            layers = settings.layers[0], settings.layers[1], settings.layers[-1]
            save_policy(make(*layers, seed=seed + settings.learning.hidden[0]), file)
        save_policy(make(*layers), run.policy)
        run.mark_finished()

    monkeypatch.setattr(sweep, "train_in", train_in)
    return names


def written(**changes):
    """A study's file."""
    Path("mine.yaml").write_text(yaml.safe_dump(STUDY | changes, sort_keys=False))
    return Path("mine.yaml")


@pytest.mark.slow
def test_a_dataset_has_the_axes_of_the_file_and_every_number_is_that_of_a_test():
    found = study(written(), Path("out"), **HERE)
    with xr.open_dataset("out/study.nc", engine="h5netcdf") as stored:
        results = stored.load()
    assert results.equals(found.results)
    sizes = {NOISE: 2, "net": 2, "test": 2, "seed": 2, "cell": 5, "policy": 2, "statistic": 10}
    assert dict(results.sizes) == sizes
    assert results[NOISE].attrs["units"] == results["gain"].attrs["units"] == "concentration"
    assert results["net"].values.tolist() == ["small", "wide"]
    for noise, net, seed in ((0.0, "wide", 1), (0.2, "small", 0)):
        here = results.sel({NOISE: noise, "net": net, "seed": seed})
        run, settings = RunFolder.open(Path("out/runs") / here["run"].values[()][0])
        settings = settings_from_stored(settings)
        world, hidden = settings.training_world(), settings.learning.hidden
        assert (world.concentration_noise, hidden) == (noise, [6 if net == "wide" else 4])
        policy = load_policy(dict(run.policies(settings))[seed])
        noisy = world.replace(concentration_noise=0.2)
        for test, tested, cells, draw_of in (("own", world, 3, 0), ("noisy", noisy, 5, 7)):
            own = population_test(tested, {"it": policy}, cells=cells, life=4.0, seed=draw_of, record=False)
            one = here.sel(test=test)
            for values, name in ((one["gain"], "it"), (one["reference_gain"].sel(policy="greedy"), "greedy")):
                assert values.values[:cells].tolist() == own["gain"].sel(policy=name).values.tolist()
                assert np.isnan(values.values[cells:]).all()
            assert one["limit"].equals(xr.full_like(one["limit"], own.attrs.get("limit", np.nan)))
            assert json.loads(one["tested_world"].item()) == json.loads(own.attrs["world"])
            mean = own["gain"].sel(policy="it").mean().item()
            assert one["statistics"].sel(statistic="gain").item() == pytest.approx(mean)
    assert {"study", "versions", "commit"} <= results.attrs.keys()
    assert Path("out/figures/gain-world.concentration_noise.png").read_bytes().startswith(b"\x89PNG")


def test_means_and_the_ends_of_their_intervals_are_numbers_in_the_table_and_the_dataset():
    grid = {"net": STUDY["grid"]["net"]}
    found = study(written(grid=grid, tests={"own": None}, policies=[], figures=[]), Path("out"), **HERE)
    with open("out/study.csv") as file:
        for row in csv.DictReader(file):
            here = found.results.sel(net=row["net"], test="own")
            gains = here["gain"].values
            expected = [gains.mean(), *mean_interval(gains)]
            assert [float(row[name]) for name in ("mean", "low", "high")] == pytest.approx(expected)
            ends = [here[name].sel(statistic="gain").item() for name in ("low", "high")]
            assert ends == pytest.approx(expected[1:])
            assert float(row["greedy"]) == pytest.approx(here["reference_gain"].mean().item())
    assert found.table.headings[:5] == ["net", "test", "seeds", "gain", "95% interval"]


@pytest.mark.slow
def test_what_is_added_is_trained_and_tested_alone_and_what_is_left_out_stays(trained, monkeypatch):
    less = {"tests": {"own": None}, "policies": [], "figures": []}
    first = study(written(**less), Path("out"), **HERE).results
    tests = {path.name for path in Path("out/tests").iterdir()}
    grid = {NOISE: [0.4, 0.2], "net": STUDY["grid"]["net"]}
    more = study(written(grid=grid, seeds=[0, 1, 2, 5], **less), Path("out"), **HERE).results
    assert sorted(trained[4:]) == sorted(
        f"{NOISE}={noise},net={net},{seeds}"
        for net in ("small", "wide")
        for noise, seeds in (("0.4", "seeds=0-2"), ("0.4", "seed=5"), ("0.2", "seed=2"), ("0.2", "seed=5"))
    )
    assert more[NOISE].values.tolist() == [0.4, 0.2]
    old = {NOISE: 0.2, "seed": [0, 1]}
    assert more["gain"].sel(old).equals(first["gain"].sel(old))
    assert len(list(Path("out/runs").iterdir())) == len(trained) == 12
    assert tests < {path.name for path in Path("out/tests").iterdir()}
    monkeypatch.setattr(studies, "population_test", lambda *_, **__: pytest.fail("tested again"))
    other = {"depth": {"one": {}}, **STUDY["grid"]}  # an axis more, and runs that are there
    again = study(written(grid=other, **less), Path("out"), **HERE).results
    assert again.isel(depth=0, drop=True).equals(first)
    assert len(trained) == 12


@pytest.mark.slow
def test_a_study_that_is_stopped_goes_on(trained, monkeypatch):
    train, tested = sweep.train_in, []

    def train_or_stop(path, settings):
        if len(trained) == 3:
            raise KeyboardInterrupt
        train(path, settings)

    def test_or_fail(*arguments, **options):
        tested.append(arguments)
        if len(tested) == 3:
            raise ValueError("a field of nobody's")
        return population_test(*arguments, **options)

    file = written(figures=[])
    monkeypatch.setattr(sweep, "train_in", train_or_stop)
    with pytest.raises(KeyboardInterrupt):
        study(file, Path("out"), **HERE)
    monkeypatch.setattr(sweep, "train_in", train)
    monkeypatch.setattr(studies, "population_test", test_or_fail)
    with pytest.raises(RunError, match=r"1 of 6 tests did not finish \(a field .* swarm study out goes on"):
        study(Path("out"), **HERE)
    assert len(trained) == 4
    study(Path("out"), **HERE)
    assert len(tested) == 7  # equal policies of the grid are tested once


@pytest.mark.slow
def test_figures_show_means_and_intervals_over_seeds_and_cells_and_every_reference_once():
    results = study(written(), Path("out"), **HERE).results
    own, noisy = panels(results, request_of("gain:world.concentration_noise", axes_of(results)))
    assert own.levels == noisy.levels == [0.0, 0.2]
    assert set(noisy.found) == {"net=small", "net=wide", "greedy", "swinging"}
    assert set(own.found) == {*noisy.found, "limit"}  # that of a world without noise
    gains = results["gain"].sel({NOISE: 0.2, "net": "wide", "test": "noisy"}).values
    assert noisy.found["net=wide"][1] == pytest.approx([gains.mean(), *mean_interval(gains)])
    (panel,) = panels(results, request_of("wins:net:test=own,seed=1", axes_of(results)))
    assert (list(panel.levels), panel.marks) == ([0, 1], {0: "small", 1: "wide"})
    noises = {"concentration_noise=0.0", "concentration_noise=0.2"}
    assert {name.split(",")[0] for name in panel.found} == {*noises, "swinging"}
    (path,) = draw(Path("out"), ["std:seed:test=own,net=wide"])
    assert path == Path("out/figures/std-seed-test=own-net=wide.png")


@pytest.mark.slow
def test_worlds_whose_cells_are_coupled_are_the_units_of_intervals():
    keys = dict(each.split("=", 1) for each in EATING) | {"algorithm": "ppo"}
    settings = {key: yaml.safe_load(value.replace(":", ": ")) for key, value in keys.items()}
    grid = {"crowd": {"eats": {}, "no": {"world.medium": None}}}
    tests = {"own": {"worlds": 2, "cells": 3, "life": 1.0}, "more": {"worlds": 3, "cells": 2, "life": 1.0}}
    file = written(settings=settings, grid=grid, tests=tests, figures=[])
    results = study(file, Path("out"), **HERE).results
    assert (results.sizes["world"], results["coupled"].values.tolist()) == (3, [[1, 1], [0, 0]])
    request = request_of("gain:test", axes_of(results))
    (panel,) = panels(results, request)
    gains = results["gain"].sel(crowd="eats", test="own").values[:, :2]
    assert panel.found["crowd=eats"][0] == pytest.approx([gains.mean(), *mean_interval(gains.mean(axis=-1))])
    free = results["gain"].sel(crowd="no", test="more").values[..., :2]
    assert panel.found["crowd=no"][1] == pytest.approx([free.mean(), *mean_interval(free.reshape(2, -1))])


def test_the_egg_is_reached_where_there_is_one():
    near = {"world.start_box": [[-2, 2], [-2, 2]], "learning.hidden": [4]}
    settings = STUDY["settings"] | {"evaluation.life": 20.0}
    settings.pop("experiment")
    grid = {"experiment": {"linear": {}, "radial": {"experiment": "radial", **near}}}
    file = written(settings=settings, grid=grid, tests={"own": {"cells": 9}}, figures=[])
    found = study(file, Path("out"), **HERE)
    times = found.results["time_to_egg"].isel(test=0)
    assert np.isnan(times.sel(experiment="linear")).all()
    came = np.isfinite(times.sel(experiment="radial"))
    assert came.any()
    shares = found.results["statistics"].isel(test=0).sel(experiment="radial", statistic="arrived")
    assert shares.values.tolist() == pytest.approx(came.mean("cell").values.tolist())
    place = found.table.headings.index("arrived")
    assert [row[place] is None for row in found.table.rows] == [True, False]


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"sedes": 3}, "mine.yaml: studies have no key 'sedes'; did you mean 'seeds'?"),
        ({"seeds": 0}, "mine.yaml: seeds must be how many, or a list of different ones, got 0"),
        ({"seeds": [1, 1]}, "mine.yaml: seeds must be how many, or a list of different ones, got [1, 1]"),
        ({"stack": 0}, "mine.yaml: stack must be at least 1, got 0"),
        ({"grid": {NOISE: 0.1}}, "grid.world.concentration_noise must be a list of values, or of each"),
        ({"grid": {NOISE: [0.1, 0.1]}}, "concentration_noise must hold every value once, got 0.1, 0.1"),
        ({"grid": {"world.noise": [1]}}, "settings have no key 'world.noise'; did you mean 'world."),
        ({"grid": {NOISE: [0.1, -1.0]}}, "noise must be a finite number of at least 0, got -1.0"),
        ({"grid": {"seed": [1]}}, "grid must have axes of other names than seed, "),
        ({"grid": {"limit": {"a": {}}}}, "grid must have axes of other names than seed, "),
        ({"grid": {"a b": [1]}}, "grid must have axes named by letters, digits, dots and _, got 'a b'"),
        ({"settings": {"n_seeds": 2}}, "settings must leave seeds to the key seeds, got n_seeds"),
        ({"tests": {"own": {"cell": 3}}}, "mine.yaml: tests have no key 'cell'; did you mean 'cells'?"),
        ({"tests": {"own": {"cells": 0}}}, "mine.yaml: tests.own.cells must be at least 1, got 0"),
        ({"tests": {"own": {"world": {"lif": 3}}}}, "tests.own: settings have no key 'world.lif'; did you"),
        ({"tests": {"own": {"world": {"n_records": 2}}}}, "own.world must leave policies their 8 inputs"),
        ({"tests": {"a/b": {}}}, "tests must be named by letters, digits and . + - _, got 'a/b'"),
        ({"figures": ["gain:world"]}, "axis of the figure gain:world must be one of net, seed, test, world"),
        ({"figures": ["gian:net"]}, "did you mean 'gain'?"),
        ({"figures": ["gain"]}, "figure must be STATISTIC:AXIS[:AXIS=VALUE,...], got 'gain'"),
        ({"policies": ["gredy"]}, "gredy"),
    ],
)  # fmt: skip
def test_a_wrong_key_is_a_line_and_nothing_is_written(changes, line):
    with pytest.raises((ValueError, PolicyError)) as raised:
        study(written(**changes), Path("out"), **HERE)
    assert line in str(raised.value)
    assert "\n" not in str(raised.value)
    assert not Path("out").exists()


def test_a_section_in_the_grid_leaves_what_else_it_holds_as_it_was():
    own = {"learning": {"n_swimmers": 7, "epochs": 3}, "world": {"field": {"type": "radial"}, "life": 8.0}}
    grid = {
        "long": {"a": {"learning": {"epochs": 4}}, "b": {"world": {"field": "linear"}}},
        "net": {"c": {"learning": {"hidden": [5]}}},
    }
    points = plan_of(written(settings=own, grid=grid, tests={"own": None}, policies=[], figures=[])).points
    learnt = [(p.settings.learning.n_swimmers, p.settings.learning.epochs) for p in points]
    assert learnt == [(7, 4), (7, 3)]
    assert all(p.settings.learning.hidden == [5] and p.settings.world["life"] == 8.0 for p in points)
    assert points[1].settings.world["field"] == "linear"


def test_a_key_that_is_given_twice_is_a_line():
    Path("mine.yaml").write_text("seeds: 1\ngrid: {}\nseeds: 2\n")
    with pytest.raises(SettingsError, match=r"keys must be given once, got seeds again in line 3"):
        study(Path("mine.yaml"), Path("out"), **HERE)


def test_a_folder_of_something_else_and_of_another_driver_is_refused(trained):
    Path("out").mkdir()
    Path("out/mine.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="out must be a new or an empty folder"):
        study(written(), Path("out"), **HERE)
    with pytest.raises(RunError, match=r"out must hold study\.nc, as swarm study out writes it"):
        draw(Path("out"), ["gain:seed"])
    Path("other").mkdir()
    with files.owned(Path("other")):
        Path("other/study.yaml").write_text("its own")
        with pytest.raises(FileExistsError, match="other is being worked on by another process"):
            study(written(), Path("other"), **HERE)
    assert Path("other/study.yaml").read_text() == "its own"
    assert trained == []


def test_seeds_in_a_row_are_trained_together():
    assert stacks([7, 0, 1, 2, 3], 3) == [(0, 3), (3, 1), (7, 1)]


@pytest.mark.parametrize(
    "file", sorted((Path(__file__).parents[2] / "configs/study").glob("*.yaml")), ids=str
)
def test_the_studies_that_come_along_are_right(file):
    plan = plan_of(file)
    assert len(plan.points) == np.prod([len(values) for values in plan.axes.values()])
    assert plan.figures


def test_numbers_are_written_as_in_words(trained):
    text = "settings: {learning.learning_rate: 1e-3, learning.hidden: [4], tensorboard: false}"
    Path("mine.yaml").write_text(text)
    study(Path("mine.yaml"), **HERE)
    assert trained == ["seed=0"]
    _, stored = RunFolder.open(Path("runs/mine/runs/seed=0"))
    wanted = settings_from(["learning.learning_rate=1e-3", "learning.hidden=[4]", "tensorboard=false"])
    assert settings_from_stored(stored) == wanted
