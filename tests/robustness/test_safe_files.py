"""Files of strangers: whatever lies in a run folder, a checkpoint or a policy, nothing of it runs."""

import ast
import json
import os
import pickle
import resource
import struct
import sys
import tracemalloc
from pathlib import Path

import pytest
import torch
import typer

from swarm import load_policy
from swarm._support import files
from swarm.policies.policy_file import PolicyError
from tests.short_runs import short_settings, start, whole
from trainers import cli
from trainers.training import checkpoint as checkpoints
from trainers.training import run_folder as runs
from trainers.training.checkpoint import CheckpointError
from trainers.training.run_folder import RunError, RunFolder

ROOT = Path(files.__file__).parents[2]
SETTINGS = short_settings(learning={"epochs": 2})


@pytest.fixture(autouse=True)
def elsewhere(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


class Canary:
    """Makes a file when it is unpickled."""

    def __reduce__(self):
        return Path.touch, (Path("canary"),)


def sings(data):
    """Checks that the canary sings, and takes it away again."""
    pickle.loads(data)
    assert Path("canary").exists()
    Path("canary").unlink()


def test_a_pickle_named_as_a_policy_or_a_checkpoint_does_not_run(capsys):
    data = pickle.dumps(Canary())
    sings(data)
    Path("policy.safetensors").write_bytes(data)
    with pytest.raises(PolicyError, match="looks like a pickle"):
        load_policy("policy.safetensors")
    run = whole("run", SETTINGS)
    for file in (run.path / runs.CHECKPOINTS).rglob("*.*"):
        file.write_bytes(data)
    with pytest.raises(typer.Exit), cli.errors_as_lines():
        cli.resume(run.path)
    assert "damaged" in capsys.readouterr().err
    assert not Path("canary").exists()


TAGS = [
    "!!python/object/apply:pathlib.Path.touch [canary]",
    "!!python/object/apply:os.system ['touch canary']",
    "!!python/name:os.system",
    "!!python/module:os",
    "experiment: !!python/object/apply:os.system ['touch canary']",
]


@pytest.mark.parametrize("text", TAGS)
def test_settings_with_pythons_tags_do_not_run(text):
    Path("run").mkdir()
    Path("run/settings.yaml").write_text(text)
    with pytest.raises(RunError, match=r"run/settings.yaml must be a run's settings, but cannot be read"):
        RunFolder.open("run")
    assert not Path("canary").exists()


@pytest.mark.parametrize(
    "text",
    [
        "_target_: os.system\ncommand: touch canary",
        "world: {_target_: os.system, command: touch canary}",
        "defaults: [/hydra/launcher: joblib]",
        "hydra: {run: {dir: /tmp}}",
        "device: ${oc.env:HOME}",
        "device: ${oc.decode:'!!python/object/apply:os.system [touch canary]'}",
        "seed: ${oc.create:1}",
    ],
)
def test_stored_settings_are_values_and_nothing_is_made_from_them(text, capsys):
    Path("run").mkdir()
    Path("run/settings.yaml").write_text(text)
    with pytest.raises(typer.Exit), cli.errors_as_lines():
        cli.resume(Path("run"))
    assert capsys.readouterr().err.startswith("swarm: stored settings: ")
    assert not Path("canary").exists()


def laughs():
    """A small file that stands for ten thousand million numbers."""
    lines = ["a0: &a0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    "text", [laughs(), "[" * 100_000, "{a: " * 50_000, "a: &a [*a]", "x: " + "y" * 2**19], ids=range(5)
)
def test_settings_that_would_fill_the_memory_are_refused(text):
    Path("run").mkdir()
    Path("run/settings.yaml").write_text(text)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(RunError, match="cannot be read") as error:
        RunFolder.open("run")
    unit = 1 if sys.platform == "darwin" else 2**10  # [bytes]
    assert unit * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) < 2**27
    assert len(str(error.value)) < 1000


def test_a_huge_sparse_file_or_a_pipe_in_a_run_folder_is_not_read():
    run = start("run", SETTINGS)
    for name in (runs.SETTINGS, runs.PROVENANCE):
        os.truncate(run.path / name, 2**42)
    with pytest.raises(RunError, match="must have at most"):
        RunFolder.open(run.path)
    assert run.record == {}
    (run.path / runs.SETTINGS).unlink()
    os.mkfifo(run.path / runs.SETTINGS)
    with pytest.raises(RunError, match="must be an ordinary file"):
        RunFolder.open(run.path)


def test_a_link_out_of_the_run_folder_is_not_written_through():
    Path("mine.txt").write_text("mine")
    run = start("run", SETTINGS)
    for name in (runs.METRICS, runs.TIMINGS, runs.POLICY, runs.FIGURE):
        (run.path / name).symlink_to(Path("mine.txt").absolute())
    cli.resume(run.path)
    assert Path("mine.txt").read_text() == "mine"
    assert load_policy(run.path).n_records == 4


HEADERS = {
    "a pickle": pickle.dumps(Canary()),
    "no header": b"",
    "a length beyond the file": struct.pack("<Q", 2**62),
    "no json": struct.pack("<Q", 4) + b"abcd",
    "nested": struct.pack("<Q", 10**6) + b"[" * 10**6,
    "a shape beyond the file": b'{"online":{"dtype":"F32","shape":[1099511627776],"data_offsets":[0,4]}}',
    "overlapping": b'{"a":{"dtype":"U8","shape":[4],"data_offsets":[0,4]},'
    b'"b":{"dtype":"U8","shape":[4],"data_offsets":[0,4]}}',
    "unknown type": b'{"a":{"dtype":"OBJECT","shape":[4],"data_offsets":[0,4]}}',
}


@pytest.mark.parametrize("name", HEADERS)
def test_a_malformed_header_with_the_right_checksum_costs_no_memory(name):
    data = HEADERS[name]
    if data[:1] == b"{":
        data = struct.pack("<Q", len(data)) + data + bytes(4)
    settings = {"seed": 0}
    checkpoints.write(Path("all"), 1, {"online": torch.zeros(3)}, {"epoch": 1}, settings)
    folder = Path("all/epoch_000001")
    manifest = {"format": checkpoints.FORMAT, "epoch": 1, "settings": settings, "record": {"epoch": 1}}
    (folder / checkpoints.TENSORS).write_bytes(data)
    forged = manifest | {"checksum": checkpoints._checksum(manifest, data)}
    (folder / checkpoints.MANIFEST).write_text(json.dumps(forged))
    tracemalloc.start()
    with pytest.raises(CheckpointError, match="epoch_000001 is damaged"):
        checkpoints.read_newest(Path("all"), settings)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 32 * 2**20
    assert not Path("canary").exists()


def test_a_file_that_grows_while_it_is_read_is_refused(monkeypatch):
    Path("file").write_bytes(bytes(100))
    original = os.stat

    def earlier(path, **options):
        found = original(path, **options)
        Path("file").write_bytes(bytes(1000))
        return found

    monkeypatch.setattr(os, "stat", earlier)
    with pytest.raises(ValueError, match="must have at most 200 bytes"):
        files.read_bytes("file", at_most=200)


# What runs, or may run, what it reads.
DANGEROUS = """pickle.load pickle.loads torch.load torch.jit.load numpy.load np.load joblib.load marshal.loads
shelve.open yaml.load_all yaml.unsafe_load yaml.full_load eval exec compile __import__ os.system instantiate
hydra.utils.instantiate OmegaConf.load"""


def calls(path):
    """Names of what a module calls, and their arguments."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), [ast.unparse(argument) for argument in node.args]


@pytest.mark.parametrize("package", ["swarm", "trainers"])
def test_nothing_that_could_run_what_it_reads_is_called(package):
    for path in (ROOT / package).rglob("*.py"):
        for name, arguments in calls(path):
            assert name not in DANGEROUS.split(), path
            if name == "yaml.load":
                assert arguments[1:] == ["_PlainLoader"], path
            assert "pickle" not in name, path
