"""Files of strangers: whatever lies in a run folder, a checkpoint or a policy, nothing of it runs."""

import ast
import json
import os
import pickle
import re
import resource
import struct
import subprocess
import sys
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
import typer

from swarm import load_policy
from swarm._support import files
from swarm.physics.world import World
from swarm.policies.policy_file import PolicyError
from swarm.population.contest import population_test
from swarm.population.results import save_population
from tests.policies.test_network import Canary
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
        cli.training.resume(run.path)
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
        cli.training.resume(Path("run"))
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
    cli.training.resume(run.path)
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
            assert "pickle" not in name or name == "pickle.dumps", path


# NetCDF files that announce little and cost much.

TEXT, LONG = h5py.string_dtype(), 2**17


def as_one_long_text(path, elements):
    """Makes every text of a list of `elements` one long text that the file holds once."""
    with h5py.File(path, "a") as file:
        file.attrs.create("long", "a" * LONG, dtype=TEXT)
    data = bytearray(path.read_bytes())
    places = [match.start() for match in re.finditer(re.escape(struct.pack("<I", LONG)), data)]
    heaps = [struct.unpack("<Q", data[place + 4 : place + 12])[0] for place in places]
    at = next(place for place, heap in zip(places, heaps, strict=True) if data[heap : heap + 4] == b"GCOL")
    short = re.search(rb"(?:\x09\0{3}.{12}){%d}" % elements, data, re.DOTALL).start()
    data[short : short + 16 * elements] = data[at : at + 16] * elements
    path.write_bytes(data)


def grid_file(path, item="c", name=None, value=None, dtype=None, **options):
    with h5py.File(path, "w") as file:
        for axis in "xy":
            file[axis] = np.arange(8.0)
            file[axis].make_scale(axis)
        file.create_dataset("c", (8, 8), "f8", **options)
        for dimension, axis in zip(file["c"].dims, "xy", strict=True):
            dimension.attach_scale(file[axis])
        if name is not None:
            file[item].attrs.create(name, value, dtype=dtype)


def shared_heap(path, item="c", name="units"):
    grid_file(path, item, name, ["a" * 9] * 3000, TEXT)
    as_one_long_text(path, 3000)


def population_file(path):
    save_population(population_test(World(), {}, cells=2, life=2, limit=False, record=False), path)


def shared_heap_of_policies(path, of=2000):
    population_file(path)
    with h5py.File(path, "a") as file:
        del file["policy"]
        file.create_dataset("policy", data=["a" * 9] * of, dtype=TEXT)
        file["gain"].dims[0].attach_scale(file["policy"])
    as_one_long_text(path, of)


def with_attribute(path, name, value, dtype=None):
    population_file(path)
    with h5py.File(path, "a") as file:
        file.attrs.create(name, value, dtype=dtype)


def shared_heap_of_attribute(path):
    with_attribute(path, "versions", ["a" * 9] * 3000, TEXT)
    as_one_long_text(path, 3000)


def scaled_chunk(path):
    population_file(path)
    with h5py.File(path, "a") as file:
        del file["gain"]
        file.create_dataset("gain", (2, 2), "i4", maxshape=(None, None), chunks=(2**14, 2**14), scaleoffset=0)


def many_names(path):
    with h5py.File(path, "w", libver="latest") as file:
        for number in range(3000):
            file.create_group(f"{number}")


CHUNK = {"maxshape": (None, None), "chunks": (2**14, 2**13)}  # a gigabyte of numbers
COSTLY = {
    "field": {
        "a text 3000 times": (shared_heap, "attribute units must have at most 1 values, got 3000"),
        "a name 3000 times": (lambda path: shared_heap(path, "x", "NAME2"), ""),
        "a period 3000 times": (lambda path: shared_heap(path, "x", "period"), "attribute period must"),
        "a long text": (lambda path: grid_file(path, "c", "units", "m" * 2**25, TEXT), "pieces of at most"),
        "numbers": (
            lambda path: grid_file(path, "c", "scale_factor", np.ones(7000)),
            "scale_factor must have at most 16",
        ),
        "unpacked by scaleoffset": (
            lambda path: grid_file(path, **CHUNK, scaleoffset=2),
            "c must be packed by deflate.*, got the filter scaleoffset",
        ),
        "a large chunk": (
            lambda path: grid_file(path, **CHUNK, compression="gzip"),
            "c must be stored in chunks of at most 67108864 bytes, got 1073741824",
        ),
        "many names": (many_names, "it must hold at most 1000 variables, got 3000"),
    },
    "population": {
        "a text 3000 times": (shared_heap_of_attribute, "attribute versions must have at most 1 values"),
        "a policy 2000 times": (shared_heap_of_policies, "must hold at most 1000 texts, got 2000"),
        "a policy 900 times": (
            lambda path: shared_heap_of_policies(path, 900),
            "must have at most 4194304 bytes",
        ),
        "a long text": (lambda path: with_attribute(path, "title", "m" * 2**25, TEXT), "pieces of at most"),
        "unpacked by scaleoffset": (scaled_chunk, "it must hold all of its numbers uncompressed, got 'gain'"),
        "many names": (many_names, "it must hold at most 1000 variables, got 3000"),
        "nested settings": (lambda path: with_attribute(path, "world", "[" * 100_000, TEXT), "world_of"),
    },
}
READ = """
import re, resource
import h5netcdf, h5py, xarray
from pathlib import Path
from swarm.physics.fields import GriddedField
from swarm.population.results import load_population, world_of

def peak():  # [KiB]; what Linux says of resources begins with the parent's
    status = Path("/proc/self/status")
    if status.exists():
        return int(re.search(r"VmHWM:\\s+(\\d+)", status.read_text())[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024

for kind in ("field", "population"):
    for path in sorted(Path(kind).iterdir()):
        before = peak()
        try:
            if {naive} and path.name != 'a text 3000 times':
                continue
            if {naive}:
                with h5py.File(path) as file:
                    for item in (file, *file.values()):
                        [item.attrs[name] for name in item.attrs]
            elif kind == "field":
                GriddedField(path, edges="clamped", variable="c", gradient_scale=1.0)
            else:
                world_of(load_population(path))
            said = "read"
        except ValueError as error:
            said = str(error)
        print(kind, path.name, peak() - before, said, sep="|")
"""


def test_files_that_cost_much_are_refused_before_they_do():
    for kind, files_of in COSTLY.items():
        Path(kind).mkdir()
        for name, (write, _) in files_of.items():
            write(Path(kind) / name)
            assert (Path(kind) / name).stat().st_size < 2**27

    def read(naive):
        code = READ.replace("{naive}", str(naive))
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        return [line.split("|", 3) for line in run.stdout.splitlines()]

    assert max(int(cost) for _, _, cost, _ in read(True)) > 2**18  # KiB: they do cost as much
    lines = read(False)
    assert len(lines) == sum(map(len, COSTLY.values()))
    for kind, name, cost, said in lines:
        words = COSTLY[kind][name][1].replace(
            "world_of", "results must state the world they were made in, got"
        )
        assert re.search(words or "read", said), (kind, name, said)
        assert int(cost) < 2**17, (kind, name, cost)  # KiB
