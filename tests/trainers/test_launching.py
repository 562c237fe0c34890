"""Launchers: where `evaluate` and sweeps run, and the line where they cannot; without a cluster."""

import importlib.util
import json

import pytest

from swarm._support import files
from tests.short_runs import short_settings
from trainers.cli.trial import trial
from trainers.jobs import cluster, remote, sweep
from trainers.jobs.cluster import ClusterError, launched
from trainers.jobs.executors import InProcess
from trainers.jobs.sweep import _launcher
from trainers.training.run import train_in

FILES = ["gains.png", "population.nc", "summary.json"]
SIZES = {"cells": 3, "worlds": None, "life": 2.0, "seed": 0}


@pytest.mark.parametrize(
    ("where", "line"),
    [
        (("rays",), "launcher must be one of here, processes, ray, got 'rays'; did you mean 'ray'?"),
        (("here", 3), "jobs must come with launcher=processes or ray, got 3"),
        (("processes", 2, "auto"), "address must come with launcher=ray, got 'auto' with processes"),
    ],
)
def test_options_that_do_not_go_together_are_a_line(where, line):
    with pytest.raises(ValueError, match="must") as raised:
        launched(*where)
    assert str(raised.value) == line


@pytest.mark.parametrize(
    ("address", "line"),
    [
        ("127.0.0.1:9", r"address must be a Ray cluster that answers, got 127\.0\.0\.1:9: "),
        ("ray://127.0.0.1:9", r"address must be a Ray cluster that answers, got ray://127\.0\.0\.1:9: "),
        ("nowhere", "address must be HOST:PORT, ray://HOST:PORT or auto, got 'nowhere'"),
    ],
)
def test_an_address_that_nobody_answers_is_a_line(address, line):
    with pytest.raises(ClusterError, match=line):
        cluster._check_answers(address)


@pytest.mark.skipif(importlib.util.find_spec("ray") is not None, reason="Ray is there")
def test_without_ray_the_extra_is_named():
    with pytest.raises(ClusterError, match=r"launcher=ray needs Ray: pip install 'chemoswarm\[cluster\]'"):
        launched("ray")


def test_a_sweep_takes_hydras_words_and_its_own():
    assert _launcher({}) == ("processes", None, None)
    assert _launcher({"hydra/launcher": "basic"}) == ("here", None, None)
    assert _launcher({"hydra.launcher.n_jobs": "3"}) == ("processes", 3, None)
    own = {"launcher": "ray", "launcher.jobs": "4", "launcher.address": "auto"}
    assert _launcher(own) == ("ray", 4, "auto")


def test_a_second_driver_of_a_cluster_in_the_same_folder_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(sweep, "launched", None)
    with files.owned(tmp_path), pytest.raises(FileExistsError, match="is being worked on by another process"):
        sweep.sweep(["seed=0,1", "tensorboard=false", f"hydra.sweep.dir={tmp_path}", "launcher=ray"])
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]


def test_a_recorded_population_goes_to_its_folder(tmp_path):
    found = trial("swinging", "linear_n4", **SIZES, record="ends", out=tmp_path / "out")
    found.save(tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == FILES
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["cells"], summary["policy"]) == (3, "swinging")
    with pytest.raises(FileExistsError, match="must be a new or an empty folder"):
        trial("swinging", "linear_n4", **SIZES, record="ends", out=tmp_path / "out")
    assert trial("swinging", "linear_n4", **SIZES, record="ends").table == found.table


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"record": "end"}, "--record must be one of all, ends, thinned, got 'end'"),
        ({"record": "ends", "against": "greedy"}, "--record must come without --against"),
        ({"where": ("ray", None, None)}, "--launcher, --jobs and --address must come with --record"),
    ],
)
def test_what_cannot_be_recorded_is_a_line(options, line):
    with pytest.raises(ValueError, match=line):
        trial("swinging", "linear_n4", **SIZES, **options)


def test_a_population_that_the_disk_has_no_room_for_is_a_line_and_nothing_is_written(tmp_path):
    rule = r"the disk of .*population.nc must have room for [\d,]+ MiB, got [\d,]+ MiB"
    with pytest.raises(OSError, match=rule):
        trial("swinging", "linear_n4", **SIZES | {"cells": 10**15}, record="ends", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("recipe", ["swarm", "ppo"])
def test_a_run_whose_epochs_are_computed_elsewhere_is_the_same(tmp_path, recipe, monkeypatch):
    settings, counted = short_settings(recipe), []

    class Elsewhere(InProcess):
        def submit(self, do, settings, before, epochs):
            counted.append(epochs)
            if len(counted) == 2:  # the driver is lost
                raise KeyboardInterrupt
            return super().submit(do, settings, before, epochs)

    train_in(tmp_path / "here", settings)
    with pytest.raises(KeyboardInterrupt):
        remote.train_through(Elsewhere(), tmp_path / "there", settings)
    remote.train_through(Elsewhere(), tmp_path / "there", settings)
    assert counted == [2, 2, 2, 2]
    for name in ("policy.safetensors", "metrics.csv", "settings.yaml", "run.json"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()
    lines = (tmp_path / "there" / "timings.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == ["epoch", *map(str, range(1, 7))]
