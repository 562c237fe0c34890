"""Faults: each ends in one clear line and a non-zero exit code, and what was saved before is kept."""

import contextlib
import errno
import fcntl
import importlib.util
import io
import json
import os
import shutil
import signal
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
import typer

from swarm.envs.torchrl import SwarmEnv
from tests.short_runs import assert_equal_runs, short_settings, whole
from trainers import cli, training
from trainers.algorithms import dqn
from trainers.training import checkpoint as checkpoints
from trainers.training import run as running
from trainers.training import run_folder as runs

SETTINGS = short_settings(world={"concentration_noise": 0.05}, learning={"epochs": 8})
RUN = runs.RunFolder(Path("run"))


@pytest.fixture(autouse=True)
def quick_and_alone(monkeypatch, tmp_path):
    """No waiting for the disk, no figures."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    monkeypatch.setattr(running, "draw", lambda made, run: None)
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """The run to which nothing happened."""
    return whole(tmp_path_factory.mktemp("expected") / "run", SETTINGS)


def begin(folder="run", settings=SETTINGS):
    cli.training.begin(settings, Path(folder))


def resume(folder="run"):
    cli.training.resume(Path(folder))


def goes_on_as(expected):
    """The run is resumed, and becomes the one to which nothing happened."""
    resume()
    assert_equal_runs(RUN, expected)


def message(capsys, command, *arguments):
    """The one line that a failing command says."""
    capsys.readouterr()
    with pytest.raises(typer.Exit) as ended, cli.errors_as_lines():
        command(*arguments)
    assert ended.value.exit_code != 0
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("swarm: ")]
    assert len(said) == 1, said
    return said[0]


def says(said, *words):
    assert not [word for word in words if word not in said], said


def after(monkeypatch, epoch, fault):
    """Lets `fault(run)` happen once, when that epoch is over and what is due is saved."""
    happened = []
    original = running._epoch

    def wrapped(made, run, log):
        if made.epoch == epoch and not happened:
            happened.append(True)
            fault(run)
        return original(made, run, log)

    monkeypatch.setattr(running, "_epoch", wrapped)


def said_after(monkeypatch, capsys, epoch, fault):
    """The one line that a run says to which a fault happens after an epoch."""
    with monkeypatch.context() as patch:
        after(patch, epoch, fault)
        return message(capsys, begin)


def broken_after(monkeypatch, epoch):
    """A run that was stopped in the middle."""

    def stop(run):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, contextlib.suppress(KeyboardInterrupt):
        after(patch, epoch, stop)
        begin()
    return RUN


def listed():
    return sorted(path.name for path in (RUN.path / runs.CHECKPOINTS).iterdir())


def test_a_full_disk_ends_the_run_and_names_the_file(monkeypatch, capsys, expected):
    def fill(run):
        (run.path / runs.METRICS).unlink()
        (run.path / runs.METRICS).symlink_to("/dev/full")

    said = said_after(monkeypatch, capsys, 5, fill)
    says(said, "No space left on device", "metrics.csv", "swarm train resume=run")
    goes_on_as(expected)


def test_a_full_disk_leaves_no_half_of_a_checkpoint(monkeypatch, capsys, expected):
    full = [True]
    original = Path.write_bytes

    def write(path, data):
        if full and "epoch_000004" in str(path):
            original(path, data[: len(data) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return original(path, data)

    monkeypatch.setattr(Path, "write_bytes", write)
    said = message(capsys, begin)
    says(said, "No space left on device", "epoch_000004")
    assert listed() == ["epoch_000002"]
    full.clear()
    goes_on_as(expected)


def read_only(monkeypatch, folder):
    """Nothing can be made or opened for writing in the folder. Root may always write, so it is simulated."""

    def refused(path):
        inside = Path(os.path.abspath(path)).is_relative_to(Path(folder).absolute())
        if inside:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    def guarded(owner, name, writes):
        original = getattr(owner, name)

        def call(path, *arguments, **options):
            if writes(*arguments, **options):
                refused(path)
            return original(path, *arguments, **options)

        monkeypatch.setattr(owner, name, call)

    guarded(os, "mkdir", lambda *_, **__: True)
    guarded(os, "open", lambda flags=0, *_, **__: bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)))
    guarded(io, "open", lambda mode="r", *_, **__: not set(mode).isdisjoint("wax+"))


def test_a_folder_that_cannot_be_written_is_said_before_anything_is_trained(monkeypatch, capsys):
    read_only(monkeypatch, ".")
    said = message(capsys, begin, "some/run")
    says(said, "Read-only file system", "some")


def test_a_run_folder_that_became_read_only_is_left_as_it_is(monkeypatch, capsys, expected):
    run = broken_after(monkeypatch, 5)
    before = {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()}
    with monkeypatch.context() as patch:
        read_only(patch, "run")
        said = message(capsys, resume)
        assert "Read-only file system: run" in said
        assert "resume=run" in said
    assert {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()} == before
    goes_on_as(expected)


def test_a_finished_run_in_a_read_only_folder_still_says_so(monkeypatch, capsys):
    begin()
    read_only(monkeypatch, "run")
    resume()
    assert "run is finished after 8 epochs" in capsys.readouterr().out


def test_a_run_folder_deleted_while_running_ends_the_run(monkeypatch, capsys):
    said = said_after(monkeypatch, capsys, 3, lambda run: shutil.rmtree(run.path))
    assert "No such file or directory: run/metrics.csv" in said
    assert not Path("run").exists()


def test_what_is_there_is_never_overwritten(capsys):
    Path("run").mkdir()
    Path("run/notes.txt").write_text("mine")
    assert "run must be a new or an empty folder" in message(capsys, begin)
    assert [path.name for path in Path("run").iterdir()] == ["notes.txt"]
    Path("file").write_text("mine")
    assert "file must be a new or an empty folder" in message(capsys, begin, "file")
    assert Path("file").read_text() == "mine"
    Path("empty").mkdir()
    os.chdir("empty")
    assert "not the current one" in message(capsys, begin, ".")


def newest_file(run, name=checkpoints.TENSORS):
    return run.path / runs.CHECKPOINTS / listed()[-1] / name


def test_a_damaged_checkpoint_is_said_and_the_one_before_is_gone_on_from(monkeypatch, capsys, expected):
    run = broken_after(monkeypatch, 5)
    assert listed() == ["epoch_000002", "epoch_000004"]
    newest_file(run).write_bytes(newest_file(run).read_bytes()[:1000])
    capsys.readouterr()
    resume()
    said = capsys.readouterr().err.splitlines()[0]
    says(said, "epoch_000004 is damaged", "going on from epoch 2")
    assert_equal_runs(run, expected)


def test_a_checkpoint_of_another_experiment_is_refused(monkeypatch, capsys):
    run = broken_after(monkeypatch, 5)
    other = whole(Path("other"), short_settings(experiment="linear_n8", world={"n_records": 8}))
    shutil.rmtree(run.path / runs.CHECKPOINTS)
    shutil.copytree(other.path / runs.CHECKPOINTS, run.path / runs.CHECKPOINTS)
    said = message(capsys, resume)
    says(said, "must come from this run", "experiment", "world")


def forged(run, change):
    """Puts a checkpoint with another content, and its right checksum, in the place of the newest."""
    manifest = json.loads(newest_file(run, checkpoints.MANIFEST).read_text())
    found = checkpoints.read_newest(run.path / runs.CHECKPOINTS, manifest["settings"])
    tensors, record, _ = found
    change(tensors, record)
    shutil.rmtree(run.path / runs.CHECKPOINTS)
    checkpoints.write(run.path / runs.CHECKPOINTS, 4, tensors, record, manifest["settings"])


WEIGHTS = "loss.value_network_params.0.weight"
FORGERIES = {
    "a tensor is missing": lambda tensors, record: tensors.pop(WEIGHTS),
    "another shape": lambda tensors, record: tensors.update({WEIGHTS: torch.zeros(1, 5)}),
    "another type": lambda tensors, record: tensors.update(best_epoch=torch.zeros(1)),
    "no rows": lambda tensors, record: tensors.update(buffer=tensors["buffer"][:0]),
    "unknown actions": lambda tensors, record: tensors["buffer"][..., -2].fill_(7),
    "a counter is missing": lambda tensors, record: record.pop("cursor"),
    "a counter is negative": lambda tensors, record: record.update(updates=-1),
    "a place beyond the buffer": lambda tensors, record: record.update(cursor=10**9),
    "an epoch beyond the end": lambda tensors, record: record.update(epoch=10**6),
}


@pytest.mark.parametrize("forgery", FORGERIES)
def test_a_checkpoint_that_does_not_fit_is_refused(monkeypatch, capsys, forgery):
    run = broken_after(monkeypatch, 5)
    forged(run, FORGERIES[forgery])
    said = message(capsys, resume)
    assert "run/checkpoints: checkpoint" in said


def test_a_checkpoint_larger_than_the_run_can_make_it_is_not_read(monkeypatch, capsys):
    run = broken_after(monkeypatch, 5)
    os.truncate(newest_file(run), 2**35)
    capsys.readouterr()
    resume()
    assert "must have at most" in capsys.readouterr().err


def test_a_half_written_last_line_is_left_out_and_mended(monkeypatch, expected):
    run = broken_after(monkeypatch, 5)
    for name in (runs.METRICS, runs.TIMINGS):
        whole_rows = run.rows(name)
        with (run.path / name).open("ab") as file:
            file.write(b"6,3,0.123\xff")
        assert run.rows(name) == whole_rows
    goes_on_as(expected)
    assert [row["epoch"] for row in run.rows(runs.TIMINGS)] == list("12345678")


@pytest.mark.parametrize("text", ["", "[]"])
def test_a_damaged_record_of_versions_does_not_stop_a_run(monkeypatch, expected, text):
    run = broken_after(monkeypatch, 3)
    (run.path / runs.PROVENANCE).write_text(text)
    resume()
    assert run.finished
    assert_equal_runs(run, expected)


def test_other_versions_are_said(monkeypatch, capsys):
    run = broken_after(monkeypatch, 3)
    record = run.record
    record["versions"]["numpy"] = "1.0"
    (run.path / runs.PROVENANCE).write_text(json.dumps(record))
    capsys.readouterr()
    resume()
    assert "numpy changed since the run began: it goes on, but not bit for bit" in capsys.readouterr().err


def test_a_run_killed_before_its_first_checkpoint_starts_again(monkeypatch, expected):
    run = broken_after(monkeypatch, 1)
    assert not (run.path / runs.CHECKPOINTS).exists()
    goes_on_as(expected)


@pytest.mark.parametrize("folder", ["nowhere", "", "file", "empty"])
def test_only_runs_can_be_resumed(capsys, folder):
    Path("empty").mkdir()
    Path("file").write_text("no run")
    assert "resume must name the folder of a run" in message(capsys, resume, folder)


def test_a_reward_that_is_no_number_ends_the_run_and_names_the_cell(monkeypatch, capsys, expected):
    original, calls = SwarmEnv.advance, iter(range(10**6))

    def advance(env, action):
        result = original(env, action)
        if env.population == "training" and next(calls) == 60:
            result.reward[0, 3] = float("nan")
        return result

    with monkeypatch.context() as patch:
        patch.setattr(SwarmEnv, "advance", advance)
        said = message(capsys, begin)
    assert "reward must be finite, got nan for cell 3 of seed 3 in epoch" in said
    goes_on_as(expected)


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_loss_that_is_no_number_ends_the_run_and_names_the_epoch(monkeypatch, capsys, number, expected):
    original, calls = dqn.SeedDQNLoss.measured, iter(range(10**6))

    def measured(*arguments):
        loss, value = original(*arguments)
        return (loss * number if next(calls) == 29 else loss), value

    with monkeypatch.context() as patch:
        patch.setattr(dqn.SeedDQNLoss, "measured", measured)
        said = message(capsys, begin)
    assert f"loss must be finite, got {number} in epoch 5 of seed 3" in said
    assert listed() == ["epoch_000002", "epoch_000004"]
    goes_on_as(expected)


def test_a_learning_rate_that_is_too_high_ends_the_run_with_advice(capsys):
    settings = short_settings(learning={"learning_rate": 1e38, "loss": "squared"})
    said = message(capsys, begin, "run", settings)
    says(said, "must be finite", "a lower learning.learning_rate may help")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_saves_and_says_how_to_go_on(monkeypatch, capsys, number, expected):
    before = signal.getsignal(number)
    said = said_after(monkeypatch, capsys, 4, lambda run: signal.raise_signal(number))
    assert "stopped after epoch 5; to go on: swarm train resume=run" in said
    assert listed() == ["epoch_000004", "epoch_000005"]
    assert signal.getsignal(number) is before
    goes_on_as(expected)


def test_a_second_ctrl_c_stops_at_once(monkeypatch, capsys, expected):
    def twice(run):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    said = said_after(monkeypatch, capsys, 3, twice)
    assert "stopped at once; what was saved before is kept; to go on: swarm train resume=run" in said
    assert listed() == ["epoch_000002"]
    goes_on_as(expected)


def test_a_second_process_on_the_same_run_is_refused(monkeypatch, capsys):
    broken_after(monkeypatch, 3)
    with open("run/.lock", "a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert "run is being worked on by another process" in message(capsys, resume)
    resume()
    assert RUN.finished


def test_a_run_has_one_owner_until_it_is_whole(monkeypatch, capsys):
    tried = []

    def testing(*_, **__):
        tried.append(message(capsys, cli.training.resume, Path("run")))
        raise KeyboardInterrupt

    settings = short_settings(evaluate=True, evaluation={"cells": 2, "life": 2.0})
    with monkeypatch.context() as patch:
        patch.setattr(running, "evaluate", testing)
        patch.setattr(running, "draw", testing)
        message(capsys, begin, "run", settings)  # stopped while it draws
        patch.setattr(running, "draw", lambda made, run: None)
        message(capsys, resume)  # stopped while it tests
    assert ["being worked on by another process" in said for said in tried] == [True, True]
    run = RUN
    assert run.finished
    for name in (".evaluation.0123456789ab", ".seeds.abcdefabcdef"):  # of owners that were killed
        (run.path / name / "figures").mkdir(parents=True)
    resume()
    assert (run.path / "evaluation/summary.json").is_file()
    assert not [path for path in run.path.iterdir() if path.is_dir() and path.name.startswith(".")]


@pytest.mark.parametrize("error", [ValueError("tex\nfailed"), RuntimeError(), OSError(28, "No space left")])
def test_a_figure_that_fails_costs_no_policy(monkeypatch, capsys, error):
    def fail(made, run):
        raise error

    monkeypatch.setattr(running, "draw", fail)
    begin()
    said = [line for line in capsys.readouterr().err.splitlines() if "could not be drawn" in line]
    assert len(said) == 1
    assert said[0].startswith("run/training.png could not be drawn: ")
    assert RUN.finished


@pytest.mark.parametrize("now", [0.0, 1e9])
def test_a_clock_that_stands_stops_nothing(monkeypatch, now):
    monkeypatch.setattr(running.time, "perf_counter", lambda: now)
    begin()
    assert {row["decisions_per_second"] for row in RUN.rows(runs.TIMINGS)} == {""}


def test_a_file_system_without_locks_is_no_hindrance(monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOTSUP, "not supported")

    monkeypatch.setattr(fcntl, "flock", refuse)
    begin()
    assert RUN.finished


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"learning": {"buffer_size": 10**12}}, "GiB of memory are needed, this machine has"),
        ({"n_seeds": 10**15}, "GiB of memory"),
        ({"evaluate": True, "evaluation": {"cells": 10**9}}, "evaluation.cells must be fewer"),
        ({"evaluate": True, "evaluation": {"life": 2e7}}, "evaluation.life shorter, got 40 and 2e+07"),
        ({"device": "cuda:99"}, "device must be one that torch finds here, got 'cuda:99'"),
    ],
)
def test_what_the_machine_cannot_do_is_said_before_there_is_a_folder(capsys, settings, said):
    assert said in message(capsys, begin, "run", short_settings(**settings))
    assert not Path("run").exists()


@pytest.mark.parametrize("name", ["tensorboard", "wandb"])
def test_a_missing_package_is_said_before_there_is_a_folder(monkeypatch, capsys, name):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda wanted, *rest: None if wanted == name else find(wanted, *rest)
    )
    said = message(capsys, begin, "run", short_settings(**{name: True}))
    assert f"needs {name}, which is not installed" in said
    assert not Path("run").exists()


def test_without_the_packages_for_training_there_is_no_folder(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "torch", None)
    for name in ("trainers.training.run", "trainers.algorithms"):
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr(training, "run")
    assert "training needs torch: pip install 'chemoswarm[train]'" in message(capsys, begin)
    assert not Path("run").exists()


def test_settings_are_checked_before_there_is_a_folder(capsys):
    words = SimpleNamespace(args=["learning.epochs=0", "hydra.run.dir=run"])
    assert message(capsys, cli.training.train, words) == "swarm: learning.epochs must be at least 1, got 0"
    assert not Path("run").exists()
    assert not Path("runs").exists()


def test_memory_that_runs_out_is_said(monkeypatch, capsys):
    def fail(run):
        raise MemoryError

    said = said_after(monkeypatch, capsys, 3, fail)
    assert "there was not enough memory; what was saved before is kept" in said
