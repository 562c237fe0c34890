"""Exported policies choose what the network chooses: in ONNX, in C, from JSON."""

import ctypes
import itertools
import json
import shutil
import subprocess

import numpy as np
import pytest
from typer.testing import CliRunner

from swarm.policies.export import cost, default_path, export_policy, input_names
from swarm.policies.network import Network, load_policy
from swarm.policies.policy_file import PolicyError
from swarm.policies.strategies import Greedy
from trainers.cli import app

SEEN = np.random.default_rng(0).normal(size=(10_000, 10)).astype(np.float32)
CARDS = [{"n_records": 4, "features": 2}, {"n_records": 2, "features": 5, "algorithm": "ppo"}]
STEERED = CARDS[0] | {"curvature_range": [-1.0, 5.0]}
SHAPES = [(), (1,), (24, 24, 24)]


def networks():
    draw = np.random.default_rng(1)
    for card, hidden in (*itertools.product(CARDS, SHAPES), (STEERED, (6,))):
        sizes = (card["n_records"] * card["features"], *hidden, 1 if card is STEERED else 3)
        pairs = list(itertools.pairwise(sizes))
        weights = [draw.normal(size=(after, before)) for before, after in pairs]
        yield Network(weights, [draw.normal(size=after) for _, after in pairs], card)


def values_in_c(path, network, seen):
    """What the header computes, compiled as strictly as compilers can."""
    name, source, library = path.stem, path.with_suffix(".c"), path.with_suffix(".so")
    kind = "int" if network.curvature_range is None else "float"
    source.write_text(f"""#include "{path.name}"
        void all(const float *seen, float *values, {kind} *actions, int rows) {{
          for (int i = 0; i < rows; i++, seen += {name}_inputs, values += {name}_actions) {{
            {name}_values(seen, values);
            actions[i] = {name}_act(seen);
          }}
        }}
    """)
    strict = ["-std=c99", "-pedantic-errors", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC"]
    subprocess.run(["cc", *strict, "-o", library, source, "-lm"], check=True)
    values, actions = (
        np.empty((len(seen), network.n_actions), np.float32),
        np.empty(len(seen), {"int": np.int32, "float": np.float32}[kind]),
    )
    pointers = [each.ctypes.data_as(ctypes.c_void_p) for each in (seen, values, actions)]
    ctypes.CDLL(str(library)).all(*pointers, len(seen))
    return values, actions


def values_from_json(path, network, seen):
    layer, stored = seen, json.loads(path.read_text())
    for each in stored["layers"]:
        weight, bias = (np.array(each[part], np.float32) for part in ("weight", "bias"))
        layer = layer @ weight.T + bias
        layer = np.tanh(layer) if each["activation"] == "tanh" else layer
    assert stored["inputs"] == input_names(network)
    assert stored["card"] == network.card
    return layer, network.best(layer)


def values_in_onnx(path, network, seen):
    runtime = pytest.importorskip("onnxruntime")
    session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    assert json.loads(session.get_modelmeta().custom_metadata_map["card"]) == network.card
    return session.run(["values", "action"], {"observation": seen})


READERS = {"c": values_in_c, "json": values_from_json, "onnx": values_in_onnx}


@pytest.mark.parametrize("network", list(networks()), ids=repr)
@pytest.mark.parametrize("format", READERS)
def test_an_exported_network_is_the_same_to_rounding(tmp_path, format, network):
    if format == "onnx":
        pytest.importorskip("onnx")
    if format == "c" and shutil.which("cc") is None:
        pytest.skip("no C compiler")
    seen = np.ascontiguousarray(SEEN[:, : network.n_inputs])
    path = tmp_path / default_path("zoo:own_1", format)
    assert export_policy(network, path, format) == cost(network)
    values, actions = READERS[format](path, network, seen)
    expected = network.values(seen)
    np.testing.assert_allclose(values, expected, rtol=1e-4, atol=2e-5)
    if network.curvature_range is not None:
        np.testing.assert_allclose(np.ravel(actions), network(seen), rtol=1e-4, atol=1e-4)
        return
    first, second = np.sort(expected, axis=-1)[:, :-3:-1].T
    sure = first - second > 1e-4
    assert sure.mean() > 0.99
    np.testing.assert_array_equal(actions[sure], network(seen)[sure])


def test_the_cost_of_a_decision_is_counted():
    network = next(each for each in networks() if len(each.weights) == 4)
    assert tuple(cost(network)) == (1491, 5964, 8 * 24 + 2 * 24 * 24 + 24 * 3, 72)


def test_the_command_writes_once_and_says_what_it_costs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*words):
        result = CliRunner().invoke(app, ["export", *words])
        return result.exit_code, result.stdout + result.stderr

    code, text = run("zoo:linear_n4", "--format", "c")
    assert (code, (tmp_path / "linear_n4.h").exists()) == (0, True)
    found = cost(load_policy("zoo:linear_n4"))
    assert f"{found.parameters} parameters, {found.bytes} bytes" in text
    assert f"per decision: {found.multiplications} multiplications, {found.tanhs} tanh" in text
    for words, rule in (
        (("zoo:linear_n4", "--format", "c"), "must be a new file"),
        (("zoo:linear_n4", "--format", "jsn"), "did you mean 'json'?"),
        (
            ("greedy", "--format", "c", "--out", "a/b.h"),
            "policy must be a network to be exported, got 'greedy'",
        ),
        (("optimal", "--format", "onnx"), "must be a network to be exported, got 'optimal'"),
        (("gredy", "--format", "c"), "gredy must be a policy file or a folder with a policy.safetensors"),
        (("zoo:linear_n4", "--format", "c", "--out", "linear_n4.h/x.h"), "linear_n4.h"),
    ):
        code, text = run(*words)
        assert (code, rule in text) == (2, True), text
    assert [each.name for each in tmp_path.iterdir()] == ["linear_n4.h"]
    assert run("zoo:linear_n4", "--format", "json", "--out", "deep/er/x.json")[0] == 0
    assert (tmp_path / "deep/er/x.json").exists()
    with pytest.raises(PolicyError, match="policy must be a network to be exported, got Greedy"):
        export_policy(Greedy(), tmp_path / "x.h", "c")


def test_names_that_are_no_identifiers_become_some(tmp_path):
    network = load_policy("zoo:linear_n2")
    export_policy(network, tmp_path / "2-nd try.v1.h", "c")
    text = (tmp_path / "2-nd try.v1.h").read_text()
    assert "static inline int policy_2_nd_try_act(" in text
