"""Run folders: whole or not there, never overwritten, readable as plain data."""

import dataclasses
import json
import subprocess
import sys

import pytest
import yaml

from swarm._support import files
from tests.short_runs import short_settings, start
from trainers.training import run_folder as runs
from trainers.training.run_folder import RunError, RunFolder, default_folder

SETTINGS = short_settings(experiment="linear_n2", seed=7)
COLUMNS = ("epoch", "seed", "gain")


def test_a_new_run_holds_its_settings_and_where_it_comes_from(tmp_path):
    run = start(tmp_path / "run", SETTINGS)
    assert yaml.safe_load((run.path / "settings.yaml").read_text()) == dataclasses.asdict(SETTINGS)
    opened, stored = RunFolder.open(tmp_path / "run")
    assert (opened.path, stored) == (run.path, dataclasses.asdict(SETTINGS))
    assert runs.is_run_folder(run.path)
    assert not runs.is_run_folder(tmp_path)
    record = json.loads((run.path / "run.json").read_text())
    assert record["seeds"] == [7]
    assert {"python", "numpy", "torch", "torchrl"} <= record["versions"].keys()
    assert "commit" in record
    assert not run.finished


def test_default_names_say_what_runs_and_are_never_taken(tmp_path):
    first, second = (default_folder(SETTINGS, tmp_path) for _ in range(2))
    assert first.name.startswith("linear_n2-swarm-seed7-")
    assert second != first
    assert default_folder(dataclasses.replace(SETTINGS, experiment="../own"), tmp_path).parent == tmp_path


def test_a_run_is_finished_when_it_says_so_and_has_a_policy(tmp_path):
    run = start(tmp_path / "run", SETTINGS)
    run.mark_finished()
    assert not run.finished
    run.policy.write_bytes(b"")
    assert run.finished
    assert run.record["seeds"] == [7]
    run.policy.unlink()
    assert not run.finished


def rows(*epochs):
    return [{"epoch": epoch, "seed": 7, "gain": 0.1 * epoch} for epoch in epochs]


def test_numbers_come_back_bit_for_bit_from_a_table_that_must_be_there_before_rows_are_added(tmp_path):
    run = start(tmp_path / "run", SETTINGS)
    with pytest.raises(FileNotFoundError):
        run.append("table.csv", COLUMNS, rows(1))
    assert run.rows("table.csv") == []
    run.rewrite("table.csv", COLUMNS, rows(1))
    run.append("table.csv", COLUMNS, rows(2, 3))
    run.append("table.csv", COLUMNS, [{"epoch": 4, "seed": 7, "gain": None}])
    found = run.rows("table.csv")
    assert [float(row["gain"]) for row in found[:3]] == [0.1, 0.2, 0.1 * 3]
    assert [row["epoch"] for row in found] == ["1", "2", "3", "4"]
    assert (run.path / "table.csv").read_text().endswith("\n4,7,\n")


WHOLE = b"epoch,seed,gain\n1,7,0.1\n2,7,0.2\n"
ENDS = [b"3,7,0.", b"3", b"3,7,0.1,5\n", b"3,7\n", b"x,7,0.1\n", b"\x00\n", b'3,"7,0.1\n']
OTHERS = [b"", b"\n", b"\xff\xfe\x00", b"\x89PNG\r\n", b"no,header\n1,2\n", b'"' * 9000]


@pytest.mark.parametrize("content", [*(WHOLE + end for end in ENDS), *OTHERS])
def test_lines_that_are_not_whole_are_left_out(tmp_path, content):
    (tmp_path / "table.csv").write_bytes(content)
    found = [row["epoch"] for row in RunFolder(tmp_path).rows("table.csv")]
    assert found == (["1", "2"] if content.startswith(WHOLE) else [])


def test_a_lock_ends_with_its_process_however_it_ends(tmp_path):
    run = start(tmp_path / "run", SETTINGS)
    code = (
        "import fcntl, os, signal, sys\n"
        f"file = open({str(run.path / files.LOCK)!r}, 'a')\n"
        "fcntl.flock(file, fcntl.LOCK_EX)\n"
        "print('locked', flush=True)\n"
        "signal.pause()\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"locked\n"
        with pytest.raises(RunError, match="another process"), run.owned():
            pass
        other.kill()
    with run.owned():
        pass


def test_what_killed_writes_left_behind_is_removed_and_nothing_else(tmp_path):
    run = start(tmp_path / "run", SETTINGS)
    for name in (".metrics.csv.0123456789ab", ".policy.safetensors.abcdefabcdef"):
        (run.path / name).write_text("half")
    mine = [".lock", ".hidden", ".notes.txt", ".git.0123456789ag", "metrics.csv"]
    for name in mine:
        (run.path / name).write_text("mine")
    of_seed, elsewhere = run.path / "seed_3", tmp_path / "elsewhere"
    (run.path / "seed_4").symlink_to(elsewhere)
    for folder in (of_seed, elsewhere):
        folder.mkdir()
        (folder / ".policy.safetensors.abcdefabcdef").write_text("half")
    run.tidy()
    left = {*mine, "run.json", "settings.yaml", "seed_3", "seed_4"}
    assert {path.name for path in run.path.iterdir()} == left
    assert not list(of_seed.iterdir())
    assert len(list(elsewhere.iterdir())) == 1
