"""Sweeps: every combination is run once, whatever happens to the others."""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer

from trainers.cli import errors_as_lines
from trainers.jobs.sweep import expanded, sweep
from trainers.settings.composition import SettingsError
from trainers.training import run as running
from trainers.training import run_folder as runs
from trainers.training.loop import TrainingError

WORDS = [
    *("learning.epochs=2", "learning.n_swimmers=2", "learning.hidden=[4]", "learning.batch_size=4"),
    *("learning.buffer_size=50", "world.life=2", "validation.life=2", "validation.cells=2"),
    *("tensorboard=false", "hydra.sweep.dir=sweep"),
]
SERIAL = "hydra/launcher=basic"


@pytest.fixture(autouse=True)
def elsewhere(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    monkeypatch.setattr(running, "draw", lambda made, run: None)


def content():
    """Policies of the sweep by folder."""
    return {path.parent.name: path.read_bytes() for path in Path("sweep").glob("*/policy.safetensors")}


def fails(capsys, words):
    """The one line that a failing sweep says."""
    with pytest.raises(typer.Exit) as ended, errors_as_lines():
        sweep(words)
    assert ended.value.exit_code != 0
    (said,) = (line for line in capsys.readouterr().err.splitlines() if line.startswith("swarm: "))
    return said


def test_every_combination_becomes_a_run_named_by_what_is_swept(capsys):
    sweep(["seed=0,1", "learning.discount=0.9,0.98", SERIAL, *WORDS])
    assert set(content()) == {
        f"learning.discount={discount},seed={seed}" for seed in (0, 1) for discount in (0.9, 0.98)
    }
    for folder in Path("sweep").glob("learning*"):
        assert runs.RunFolder(folder).finished
        files = {runs.SETTINGS, runs.PROVENANCE, runs.METRICS, runs.TIMINGS, runs.CHECKPOINTS, runs.POLICY}
        assert {path.name for path in folder.iterdir()} <= files | {".lock"}
    assert "all 4 runs are in sweep" in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [
        ["seed=0,0"],
        ["world.life=80,80.0"],
        ["world.field=linear,{type: linear}"],
        ["learning.learning_rate=0.01,1e-2", "seed=0,1"],
        ["seed=0,2", "n_seeds=1,3"],
    ],
)
def test_the_same_training_twice_is_refused(capsys, words):
    assert "combinations must differ, got " in fails(capsys, [*words, "hydra.sweep.dir=sweep"])
    assert not Path("sweep").exists()


@pytest.mark.parametrize("name", ["sw A", '"q"', "~/s w", "a=b,c"])
def test_the_folder_of_a_sweep_is_one_literal_path(monkeypatch, tmp_path, capsys, name):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    sweep(["seed=0,1", SERIAL, *WORDS[:-1], f"hydra.sweep.dir={name}", "learning.epochs=1"])
    folder = Path(name).expanduser()
    assert {path.name for path in folder.iterdir()} == {"seed=0", "seed=1"}
    assert f"swarm compare {shlex.quote(str(folder))}/*" in capsys.readouterr().out


@pytest.mark.slow
def test_a_sweep_tests_its_runs_where_that_is_wanted():
    words = [*WORDS, "evaluate=true", "evaluation.life=2", "evaluation.cells=2", "learning.epochs=1", SERIAL]
    sweep(["seed=0,1", *words])
    first = Path("sweep/seed=0/evaluation/summary.json")
    before = first.read_bytes()
    shutil.rmtree(first.parent)
    sweep(["seed=0,1", *words])
    assert first.read_bytes() == before
    assert Path("sweep/seed=1/evaluation/population.nc").is_file()


def test_a_run_that_fails_does_not_stop_the_others_and_it_alone_is_run_again(monkeypatch, capsys):
    original, trained = running.train, []

    def train(made, run, report):
        trained.append(made.seeds)
        if len(trained) == 2:
            raise TrainingError("loss must be finite")
        original(made, run)

    monkeypatch.setattr(running, "train", train)
    said = fails(capsys, ["seed=0,1,2", SERIAL, *WORDS])
    assert "1 of 3 runs did not finish" in said
    assert "the same command with hydra.sweep.dir=sweep goes on with them" in said
    before = content()
    assert set(before) == {"seed=0", "seed=2"}
    sweep(["seed=0,1,2,3", SERIAL, *WORDS])
    assert trained == [[0], [1], [2], [1], [3]]
    assert before.items() <= content().items()
    assert set(content()) == {"seed=0", "seed=1", "seed=2", "seed=3"}


def test_ctrl_c_stops_the_whole_sweep_which_goes_on_to_the_same_end(monkeypatch, capsys):
    sweep(["seed=0,1", SERIAL, *WORDS])
    expected = content()
    Path("sweep").rename("expected")
    original = running._epoch

    def epoch(made, run, log):
        signal.raise_signal(signal.SIGINT)
        return original(made, run, log)

    with monkeypatch.context() as patch:
        patch.setattr(running, "_epoch", epoch)
        said = fails(capsys, ["seed=0,1", SERIAL, *WORDS])
    assert said.startswith("swarm: stopped; what was done is kept")
    assert said.endswith("the same command with hydra.sweep.dir=sweep goes on with them")
    assert [path.name for path in Path("sweep").glob("seed=*")] == ["seed=0"]
    sweep(["seed=0,1", SERIAL, *WORDS])
    assert content() == expected


def test_a_folder_with_runs_of_other_settings_is_refused(capsys):
    sweep(["seed=0,1", SERIAL, *WORDS])
    before = content()
    said = fails(capsys, ["seed=0,1", SERIAL, *WORDS, "checkpoint_every=7"])
    assert "sweep/seed=0 holds a run with another checkpoint_every" in said
    assert "choose another hydra.sweep.dir=DIR" in said
    assert content() == before


def test_all_combinations_are_checked_before_there_is_a_folder(capsys):
    assert "learning.epochs must be" in fails(capsys, ["seed=0,1", "learning.epochs=3,0", SERIAL])
    assert "device must be one that torch finds" in fails(capsys, ["seed=0,1", "device=cpu,cuda:55", SERIAL])
    assert list(Path().iterdir()) == []


def test_a_folder_that_cannot_be_is_said_before_anything_runs(capsys):
    Path("file").write_text("mine")
    for folder, said in (("file", "File exists: file"), ("file/deep", "Not a directory: file/deep")):
        words = [word.replace("hydra.sweep.dir=sweep", f"hydra.sweep.dir={folder}") for word in WORDS]
        assert said in fails(capsys, ["seed=0,1", SERIAL, *words])
    assert Path("file").read_text() == "mine"
    more = ["checkpoint_every=1000", "validation.every=1000", "learning.epsilon_end=0.01"]
    assert "named by what is swept in at most 240 bytes" in fails(capsys, ["seed=3", SERIAL, *WORDS, *more])
    assert not Path("sweep").exists()


def test_a_sweep_goes_on_by_its_own_words(capsys):
    assert "a sweep goes on with the same command" in fails(capsys, ["resume=sweep"])


def test_what_cannot_be_expanded_is_said():
    with pytest.raises(SettingsError, match=r"the value cannot be read.* got 'seed=\[1'"):
        expanded(["seed=[1"])
    with pytest.raises(SettingsError, match="a setting must be written key=value, got '--show'"):
        expanded(["seed=1,2", "--show"])
    assert expanded(["seed=1,2", "world.life=3"]) == [["seed=1", "world.life=3"], ["seed=2", "world.life=3"]]


def workers(process):
    """Processes that train, of a sweep's."""
    tasks = Path(f"/proc/{process}/task").glob("*/children")
    children = [child for task in tasks for child in task.read_text().split()]
    return [int(child) for child in children if "spawn_main" in Path(f"/proc/{child}/cmdline").read_text()]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="processes are found by /proc")
def test_a_worker_that_is_killed_is_said_and_its_run_goes_on(capsys):
    words = ["seed=0,1", *WORDS, "learning.epochs=400", "compile=never"]
    environment = os.environ | {"PYTHONPATH": str(Path(runs.__file__).parents[2]), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "trainers.command", "train", "-m", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as process:
        until = time.monotonic() + 300
        while len(list(Path("sweep").glob("*/checkpoints"))) < 2 and time.monotonic() < until:
            time.sleep(0.05)
        os.kill(workers(process.pid)[0], signal.SIGKILL)
        lines = process.communicate(timeout=300)[1].splitlines()
    assert process.returncode != 0
    (said,) = (line for line in lines if line.startswith("swarm: "))
    assert "1 of 2 runs did not finish" in said
    assert "the same command with hydra.sweep.dir=sweep goes on with them" in said
    sweep([*words, SERIAL])
    assert set(content()) == {"seed=0", "seed=1"}
