"""Trained policies in NumPy and their files: what a file says is checked, and nothing in it can run."""

import contextlib
import io
import itertools
import json
import os
import pickle
import struct
import tracemalloc
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from safetensors.numpy import save

from swarm.physics.perception import Memory
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies import network as network_module
from swarm.policies.network import Network, load_policy, save_policy
from swarm.policies.policy import Policy
from swarm.policies.policy_file import MAX_FILE, PolicyError
from tests.reference import array, to_numpy

CARD = {"n_records": 4, "features": 2, "experiment": "linear_n4"}


def make(*sizes, seed=0, card=CARD):
    """A network of these layer sizes with random parameters."""
    draw = np.random.default_rng(seed)
    sizes = sizes or (8, 24, 24, 24, 2)
    weights = [
        draw.normal(size=(after, before)) / np.sqrt(before) for before, after in itertools.pairwise(sizes)
    ]
    return Network(weights, [0.1 * draw.normal(size=size) for size in sizes[1:]], card)


def observations(rows, inputs=8, seed=1):
    return np.random.default_rng(seed).normal(size=(rows, inputs)).astype(np.float32)


def test_values_are_those_of_tanh_layers_and_a_linear_output():
    first, second = [[1.0, 0, 0, 0], [0, 2.0, 0, 0]], [[1.0, -1.0], [3.0, 0.5]]
    tiny = Network([first, second], [[0.1, 0.0], [0.0, -1.0]], {"n_records": 2, "features": 2})
    a, b = np.tanh(0.5 + 0.1), np.tanh(2 * 0.25)
    assert np.allclose(tiny.values([0.5, 0.25, 9, 9]), [a - b, 3 * a + 0.5 * b - 1], atol=1e-6)
    assert tiny([0.5, 0.25, 9, 9]) == int(3 * a + 0.5 * b - 1 > a - b)


@pytest.mark.parametrize("cells", [1, 2, 40, 63, 64, 65, 1000])
def test_a_cells_values_are_the_same_to_the_last_bit_whatever_the_number_of_cells(cells):
    policy, seen = make(), observations(10_000)
    assert (policy.values(seen[:cells]) == policy.values(seen)[:cells]).all()


def test_leading_axes_of_any_number():
    policy, seen = make(), observations(24)
    assert (policy.values(seen.reshape(2, 3, 4, 8)).reshape(24, 2) == policy.values(seen)).all()
    assert policy(seen.reshape(4, 6, 8)).shape == (4, 6)
    assert policy.values(seen[:0]).shape == (0, 2)


def test_it_is_a_policy_and_acts_by_its_values(xp):
    policy, world = make(), World()
    start = draw_starts(world, 5, 0)
    state = world.start(*start)
    expected = policy(world.observation(state))
    other = world.start(*(array(xp, part) for part in start))
    assert isinstance(policy, Policy)
    assert (to_numpy(policy.act(world, other)) == expected).all()


def test_a_blind_network_acts_the_same_whether_or_not_the_world_senses_the_flow():
    policy = make()
    blind, aware = (World(flow="taylor_green", sense_flow=sense) for sense in (False, True))
    start = draw_starts(blind, 50, 0)
    chosen = [policy.act(world, world.start(*start)) for world in (blind, aware)]
    assert (chosen[0] == chosen[1]).all()
    assert 0 < chosen[0].mean() < 1


@dataclass(frozen=True)
class Compass(Memory):
    """Senses the heading."""

    name = "compass"
    names = (*Memory.names, "heading")

    def record(self, world, time, situation):
        return *super().record(world, time, situation), situation.heading[..., 1]

    def bounds(self, world):
        return *super().bounds(world), 1.0


def test_a_network_fits_a_sensor_of_the_parameters_that_its_card_tells(tmp_path):
    sensor = {"type": "memory_with_neighbours", "k": 1, "range": 2.0}
    card = {"n_records": 4, "features": 6, "sensor": sensor}
    save_policy(make(24, 6, 2, card=card), tmp_path / "seeing.safetensors")
    policy = load_policy(tmp_path / "seeing.safetensors")
    assert policy.sensor == sensor
    policy.check_fits(World(sensor=sensor))
    with pytest.raises(
        PolicyError, match=r"neighbours\(k=1, range=2.0\) in each.*\(k=1, range=3.0\) in each"
    ):
        policy.check_fits(World(sensor={**sensor, "range": 3}))


def test_a_network_fits_the_sensor_that_its_card_names():
    world, card = World(sensor=Compass()), {"n_records": 4, "features": 3, "sensor": "compass"}
    policy, blind = make(12, 6, 2, card=card), make()
    state = world.start(*draw_starts(world, 50, 0))
    assert (policy.act(world, state) == policy(world.observation(state))).all()
    plain = World()
    assert (blind.act(world, state) == blind.act(plain, plain.start(*draw_starts(plain, 50, 0)))).all()
    assert (make().sensor, make(20, 2, card={**CARD, "features": 5}).sensor) == ("memory", "memory_with_flow")
    with pytest.raises(PolicyError, match=r"12 numbers .*3 of compass in each.* world gives 8 .*2 of memory"):
        policy.check_fits(plain)
    with pytest.raises(PolicyError, match=r"must state the sensor of 3 features by name, .*, got None"):
        make(12, 2, card={"n_records": 4, "features": 3})


AWARE = make(20, 6, 2, card={"n_records": 4, "features": 5})


@pytest.mark.parametrize(
    ("policy", "world", "words"),
    [
        (make(), World(n_records=8), ["takes 8 numbers", "world gives 16"]),
        (AWARE, World(flow="taylor_green"), ["20", "8", "sense_flow=True"]),
        (AWARE, World(n_records=10), ["20", "n_records = 4", "n_records = 10"]),
        (make(), World(curvatures=(3.0, 4.0, 5.0)), ["policy has 2", "world 3"]),
    ],
)
def test_a_policy_that_does_not_fit_the_world_says_both_numbers(policy, world, words):
    with pytest.raises(PolicyError) as error:
        policy.act(world, world.start(*draw_starts(world, 2, 0)))
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize(
    ("weights", "biases", "words"),
    [
        ([np.zeros((2, 8))], [], "1 weights and 0 biases"),
        ([np.zeros((2, 8))], [np.zeros(3)], "layers.0.bias must have 2"),
        ([np.zeros((5, 8)), np.zeros((2, 6))], [np.zeros(5), np.zeros(2)], "layers.1.weight must take the 5"),
        ([np.zeros((2, 7))], [np.zeros(2)], "4 × 2 = 8, got 7"),
        ([np.full((2, 8), np.nan)], [np.zeros(2)], "finite"),
        ([np.full((2, 8), 1e30)], [np.zeros(2)], "finite numbers of size 1e\\+06"),
        ([np.zeros(8)], [np.zeros(2)], "2 axes"),
    ],
)
def test_layers_that_do_not_chain_are_refused(weights, biases, words):
    with pytest.raises(PolicyError, match=words):
        Network(weights, biases, CARD)


def test_a_saved_policy_comes_back_bit_by_bit(tmp_path):
    policy = make(card={**CARD, "validation": {"gain": 29.8, "limit": None}, "seeds": [0, 1], "note": "κ₁ …"})
    save_policy(policy, tmp_path / "policy.safetensors")
    again = load_policy(str(tmp_path))  # a run's folder stands for its policy
    seen = observations(100)
    assert (again.values(seen) == policy.values(seen)).all()
    assert again.card == policy.card
    save_policy(again, tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == (tmp_path / "policy.safetensors").read_bytes()


def test_an_unknown_shipped_policy_suggests_the_nearest(monkeypatch):
    monkeypatch.setattr(network_module, "zoo_names", lambda: ["linear_n2", "radial"])
    with pytest.raises(PolicyError, match=r"linear_n2, radial, got 'linear_2'; did you mean 'linear_n2'\?"):
        load_policy("zoo:linear_2")
    with pytest.raises(PolicyError, match="shipped policy must be one of"):
        load_policy("zoo:../../etc/passwd")


def test_a_failed_save_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "policy.safetensors"
    save_policy(make(), path)
    before = path.read_bytes()

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="No space left"):
        save_policy(make(seed=5), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


class Canary:
    """Makes a file when it is unpickled."""

    def __reduce__(self):
        return Path.touch, (Path("canary"),)


def zipped():
    """A pickle as torch writes it."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("archive/data.pkl", pickle.dumps(Canary()))
    return buffer.getvalue()


def tensors():
    return make(8, 3, 2).tensors


def written(change=None, *, card=CARD, metadata=None, parameters=None):
    """The bytes of a policy file whose header was changed."""
    text = card if isinstance(card, str) else json.dumps(card)
    data = save(parameters or tensors(), {"chemoswarm": text} if metadata is None else metadata)
    if change is None:
        return data
    (size,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + size])
    changed = change(header) or header
    text = changed if isinstance(changed, bytes) else json.dumps(changed).encode()
    return struct.pack("<Q", len(text)) + text + data[8 + size :]


def too_large(path):
    with path.open("wb") as file:
        file.truncate(MAX_FILE + 1)  # takes no space


UNCHAINED = np.zeros((2, 5), np.float32)
TWICE = b', "layers.0.bias": {}}'


def with_entry(name, **entry):
    return lambda header: header.update({name: {**header.get(name, {}), **entry}})


HOSTILE = {
    "nothing": lambda path: None,
    "a pipe": os.mkfifo,
    "too large": too_large,
    **{f"a pickle of protocol {i}": pickle.dumps(Canary(), i) for i in (0, 2, 4)},
    "a zipped pickle": zipped(),
    "empty": b"",
    "header beyond the file": struct.pack("<Q", 2**62) + b"{}",
    "header beyond the limit": struct.pack("<Q", 2**20) + b" " * 2**20,
    "header is no text": struct.pack("<Q", 4) + b"\xff\xfe\xfd\xfc",
    "header is no JSON": struct.pack("<Q", 4) + b"{]}}",
    "header nested without end": struct.pack("<Q", 200_000) + b"[" * 200_000,
    "header with a key twice": written(lambda header: json.dumps(header).encode()[:-1] + TWICE),
    "no card": written(metadata={"other": "{}"}),
    "no metadata": written(lambda header: header.pop("__metadata__") and header),
    "card is no JSON": written(card="{"),
    "card without its numbers": written(card={"experiment": "linear_n4"}),
    "card of another size": written(card={"n_records": 8, "features": 2}),
    "card with a wrong type": written(card={"n_records": "4", "features": 2}),
    "card with odd features": written(card={"n_records": 2, "features": 4}),
    "card with NaN": written(card='{"n_records": 4, "features": 2, "gain": NaN}'),
    "card with a terminal's escape": written(card={**CARD, "note": "\x1b]0;owned\x07"}),
    "card with reversed text": written(card={**CARD, "note": "\u202egnp.exe"}),
    "card nested deep": written(card='{"n_records": 4, "features": 2, "a": ' + "[" * 50 + "]" * 50 + "}"),
    "card too long": written(card={**CARD, "note": "x" * 100_000}),
    "another tensor": written(parameters={**tensors(), "extra": np.zeros(2, np.float32)}),
    "a tensor named as a path": written(parameters={"../layers.0.weight": np.zeros((2, 8), np.float32)}),
    "a layer left out": written(parameters={k: v for k, v in tensors().items() if k[7] != "0"}),
    "no tensors": written(lambda header: {"__metadata__": header["__metadata__"]}),
    "double precision": written(parameters={k: v.astype(float) for k, v in tensors().items()}),
    "not a number": written(parameters={k: v * np.float32(np.nan) for k, v in tensors().items()}),
    "a shape of another size": written(with_entry("layers.0.weight", shape=[3, 9])),
    "a shape beyond the limit": written(with_entry("layers.0.weight", shape=[2**40, 2**40])),
    "a negative shape": written(with_entry("layers.0.weight", shape=[-3, -8])),
    "an entry of text": written(lambda header: header.update({"layers.0.bias": "x"})),
    "offsets beyond the file": written(with_entry("layers.0.weight", data_offsets=[0, 2**50])),
    "offsets that overlap": written(with_entry("layers.0.weight", data_offsets=[0, 96])),
    "data cut off": written()[:-4],
    "data too long": written() + bytes(4),
    "layers that do not chain": written(parameters=tensors() | {"layers.1.weight": UNCHAINED}),
}


SAYS = {
    "nothing": "it is not there",
    "a pipe": "ordinary file",
    "too large": f"at most {MAX_FILE} bytes",
    "a pickle of protocol 4": "looks like a pickle",
    "a zipped pickle": "looks like a pickle",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_malformed_file_is_refused_by_name_runs_nothing_and_costs_no_memory(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "policy.safetensors"
    content = HOSTILE[name]
    if callable(content):
        content(path)
    else:
        path.write_bytes(content)
    tracemalloc.start()
    try:
        for called in (path, tmp_path):
            with pytest.raises(PolicyError, match=SAYS.get(name)) as error:
                load_policy(called)
            assert str(path) in str(error.value)
        assert tracemalloc.get_traced_memory()[1] < 20 * 2**20
    finally:
        tracemalloc.stop()
    assert not Path("canary").exists()
    if "pickle" in name and "zipped" not in name:
        pickle.loads(content)
        assert Path("canary").exists()  # it could have sung


def test_a_header_of_any_length_is_accepted(tmp_path):
    path = tmp_path / "policy.safetensors"
    for length in range(0, 600, 7):
        path.write_bytes(written(card={**CARD, "note": "x" * length}))
        assert load_policy(path).card["note"] == "x" * length


@given(st.data())
def test_a_damaged_file_gives_a_policy_or_an_error_that_says_so(tmp_path_factory, data):
    whole = bytearray(written())
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(whole)))
    path = tmp_path_factory.getbasetemp() / "damaged.safetensors"
    for damaged in (bytes(whole), bytes(whole[:cut])):
        path.write_bytes(damaged)
        with contextlib.suppress(PolicyError):
            load_policy(path)
