"""Checkpoints: whole or not there, checked, rotated; a crash at any instant leaves a valid one."""

import json
import os
import shutil
from pathlib import Path

import pytest
import torch

from swarm._support import files
from tests.short_runs import Crash, short_settings
from trainers.training import checkpoint as checkpoints
from trainers.training.checkpoint import MANIFEST, TENSORS, CheckpointError, read_newest, write
from trainers.training.run_folder import CHECKPOINTS, RunFolder

SETTINGS = {"experiment": "linear_n4", "seed": 0, "learning": {"epochs": 9}}


def tensors(epoch):
    return {
        "weights": torch.full((3, 4), float(epoch)),
        "step": torch.tensor(epoch),
        "flags": torch.tensor([True, False]),
    }


def save(folder, epoch):
    write(folder, epoch, tensors(epoch), {"epoch": epoch, "cursor": 7}, SETTINGS)


def newest(folder):
    """Epoch and complaints of what would be gone on from."""
    found, record, complaints = read_newest(folder, SETTINGS)
    assert torch.equal(found["weights"], tensors(record["epoch"])["weights"])
    return record["epoch"], complaints


def damage(path, place, change=lambda byte: byte ^ 1):
    data = bytearray(path.read_bytes())
    data[place] = change(data[place])
    path.write_bytes(data)


def test_what_is_read_is_what_was_written(tmp_path):
    save(tmp_path, 5)
    found, record, complaints = read_newest(tmp_path, SETTINGS)
    torch.testing.assert_close(found, tensors(5), rtol=0.0, atol=0.0)
    assert (record, complaints) == ({"epoch": 5, "cursor": 7}, [])
    assert read_newest(tmp_path / "not there", SETTINGS) is None


def test_only_the_newest_two_are_kept_counted_as_numbers(tmp_path):
    for epoch in (1, 2, 999_999, 1_000_000, 10_000_000):
        save(tmp_path, epoch)
    assert {path.name for path in tmp_path.iterdir()} == {"epoch_1000000", "epoch_10000000"}
    assert newest(tmp_path) == (10_000_000, [])


def test_a_checkpoint_of_the_same_epoch_takes_the_place_of_a_damaged_one(tmp_path):
    save(tmp_path, 4)
    damage(tmp_path / "epoch_000004" / TENSORS, -1)
    save(tmp_path, 4)
    assert newest(tmp_path) == (4, [])


@pytest.mark.parametrize("name", [MANIFEST, TENSORS])
def test_every_flipped_bit_is_noticed_and_the_previous_checkpoint_taken(tmp_path, name):
    save(tmp_path, 1)
    save(tmp_path, 2)
    file = tmp_path / "epoch_000002" / name
    whole = file.read_bytes()
    for place in range(0, len(whole), max(1, len(whole) // 60)):
        damage(file, place, lambda byte, bit=1 << place % 8: byte ^ bit)
        epoch, complaints = newest(tmp_path)
        if epoch == 2:  # a space of the manifest's layout says nothing
            assert json.loads(file.read_bytes()) == json.loads(whole)
        else:
            assert epoch == 1
            assert str(file.parent) in complaints[0]
        file.write_bytes(whole)
    assert newest(tmp_path) == (2, [])


HARM = {
    "empty": lambda file: file.write_bytes(b""),
    "cut": lambda file: file.write_bytes(file.read_bytes()[:-2]),
    "missing": Path.unlink,
    "of another kind": lambda file: file.write_text("[]"),
    "without content": lambda file: file.write_text("{}"),
    "nested": lambda file: file.write_text("[" * 100_000),
    "no text": lambda file: file.write_bytes(b"\xff"),
    "another checksum": lambda file: file.write_text('{"checksum": 5}'),
    "huge": lambda file: os.truncate(file, 2**42),
}


@pytest.mark.parametrize("name", [MANIFEST, TENSORS])
@pytest.mark.parametrize("harm", HARM)
def test_a_harmed_file_is_noticed_and_the_previous_checkpoint_taken(tmp_path, name, harm):
    save(tmp_path, 1)
    save(tmp_path, 2)
    HARM[harm](tmp_path / "epoch_000002" / name)
    epoch, complaints = newest(tmp_path)
    assert epoch == 1
    assert "damaged" in complaints[0]


def test_where_all_are_damaged_the_error_names_them_and_what_to_do(tmp_path):
    for epoch in (1, 2):
        save(tmp_path, epoch)
        damage(tmp_path / f"epoch_00000{epoch}" / TENSORS, 20)
    with pytest.raises(
        CheckpointError, match=r"epoch_000002 is damaged: .*epoch_000001 .*remove .*"
    ) as error:
        read_newest(tmp_path, SETTINGS)
    assert "\n" not in str(error.value)


def test_one_of_a_newer_version_is_refused_not_called_damaged(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoints, "FORMAT", checkpoints.FORMAT + 1)
    save(tmp_path, 1)
    monkeypatch.undo()
    with pytest.raises(
        CheckpointError, match=r"must have format 2, .* got 3: go on with the version that wrote it"
    ):
        read_newest(tmp_path, SETTINGS)


def test_one_written_before_a_setting_came_is_gone_on_with_at_its_default(tmp_path):
    settings = short_settings().identity()
    validation = {name: each for name, each in settings["validation"].items() if name != "worlds"}
    write(tmp_path, 1, tensors(1), {"epoch": 1}, settings | {"validation": validation})
    assert read_newest(tmp_path, settings)[1] == {"epoch": 1}
    other = short_settings(validation={"worlds": 2}).identity()
    with pytest.raises(CheckpointError, match="differs from its settings in validation"):
        read_newest(tmp_path, other)


OPERATIONS = [
    (Path, "mkdir"),
    (Path, "write_bytes"),
    (Path, "write_text"),
    (os, "fsync"),
    (os, "replace"),
    (shutil, "rmtree"),
    (files, "_flush"),
]


@pytest.mark.parametrize("after", [False, True], ids=["before", "after"])
def test_a_crash_at_any_operation_leaves_a_valid_checkpoint(tmp_path, monkeypatch, after):
    """Every call to the file system while a checkpoint is written is the last one once."""
    crashes = 0
    for number in range(100):
        folder = tmp_path / f"{number}" / CHECKPOINTS
        for epoch in (1, 2):
            save(folder, epoch)
        calls = iter(range(100))

        def crashing(original, calls=calls, number=number):
            def call(*arguments, **options):
                due = next(calls) == number
                if due and not after:
                    raise Crash
                result = original(*arguments, **options)
                if due:
                    raise Crash
                return result

            return call

        with monkeypatch.context() as patch:
            for owner, name in OPERATIONS:
                patch.setattr(owner, name, crashing(getattr(owner, name)))
            try:
                save(folder, 3)
            except Crash:
                crashes += 1
            else:
                break
        assert newest(folder)[0] in (2, 3)
        assert newest(folder)[1] == []
        RunFolder(folder.parent).tidy()
        save(folder, 3)
        assert newest(folder) == (3, [])
        assert {path.name for path in folder.iterdir()} == {"epoch_000002", "epoch_000003"}
    assert crashes >= 10
