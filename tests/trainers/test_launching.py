"""Launchers: where `evaluate` and sweeps run, and the line where they cannot; without a cluster."""

import importlib.util
import json
from pathlib import Path

import pytest

from swarm._support import files
from tests.short_runs import short_settings
from tests.trainers.test_cli import elsewhere, refused, run  # noqa: F401
from trainers.cli import recorded
from trainers.jobs import cluster, remote, sweep
from trainers.jobs.cluster import ClusterError, launched
from trainers.jobs.executors import InProcess
from trainers.training.run import train_in

FILES = ["gains.png", "population.nc", "summary.json"]
RECORDED = ("evaluate", "swinging", "--cells", "3", "--life", "2", "--record", "ends")


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
    assert sweep._launcher({}) == ("processes", None, None)
    assert sweep._launcher({"hydra/launcher": "basic", "hydra.launcher.n_jobs": "3"}) == ("here", None, None)
    assert sweep._launcher({"hydra.launcher.n_jobs": "3"}) == ("processes", 3, None)
    own = {"launcher": "ray", "launcher.jobs": "4", "launcher.address": "auto"}
    assert sweep._launcher(own) == ("ray", 4, "auto")


def test_a_second_driver_of_a_cluster_in_the_same_folder_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(sweep, "launched", None)
    with files.owned(tmp_path), pytest.raises(FileExistsError, match="is being worked on by another process"):
        sweep.sweep(["seed=0,1", "tensorboard=false", f"hydra.sweep.dir={tmp_path}", "launcher=ray"])
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]


def test_a_recorded_population_goes_on_and_is_only_read_once_it_is_complete(monkeypatch):
    with monkeypatch.context() as within:
        within.setattr(recorded, "save_summary", lambda *_: int("stopped"))
        assert run(*RECORDED, "--out", "out")[0] == 2
    code, first, _ = run(*RECORDED, "--out", "out")
    assert (code, sorted(path.name for path in Path("out").iterdir())) == (0, FILES)
    summary = json.loads(Path("out/summary.json").read_text())
    assert (summary["cells"], summary["policy"]) == (3, "swinging")
    before = {path: path.stat().st_mtime_ns for path in Path("out").iterdir()}
    code, again, told = run(*RECORDED, "--out", "out")
    assert (code, again, told) == (0, first, "out is complete: nothing was computed again\n")
    assert {path: path.stat().st_mtime_ns for path in Path("out").iterdir()} == before
    assert run(*RECORDED)[1].splitlines() == first.splitlines()[:-1]
    assert "must be new or hold the same population" in refused(*RECORDED, "--seed", "1", "--out", "out")
    Path("out/population.nc").unlink()
    assert "out must be a new or an empty folder" in refused(*RECORDED, "--out", "out")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--record", "end"], "--record must be one of all, ends, thinned, got 'end'"),
        (["--against", "greedy"], "--record must come without --against"),
        (["--noise", "0,1"], "--record must come without --against and several levels of --noise, got ends"),
        (["--cells", 10**15, "--out", "out"], "population.nc must have room for "),
    ],
)
def test_what_cannot_be_recorded_is_a_line_and_nothing_is_written(words, line):
    assert line in refused(*RECORDED, *words)


def test_only_what_is_recorded_goes_elsewhere():
    assert "--launcher, --jobs and --address must come with" in refused("evaluate", "greedy", "--jobs", "2")


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
