"""Exports of a network for programs without this package: ONNX, a C99 header, JSON."""

from __future__ import annotations

import itertools
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarm._support import files
from swarm._support.checks import check_name
from swarm.physics.perception import SENSORS
from swarm.policies.network import Network, RecurrentNetwork
from swarm.policies.policy_file import PolicyError

OPSET, IR_VERSION = 17, 8  # of ONNX, which runtimes since 2022 know
WIDTH = 100  # of a header's lines


class Cost(NamedTuple):
    """What a network takes."""

    parameters: int
    bytes: int  # of its parameters
    multiplications: int  # per decision
    tanhs: int  # per decision


def cost(network: Network) -> Cost:
    """What a decision of one cell takes, but for the scale of a curvature."""
    arrays = network.tensors.values()
    parameters, multiplications = (sum(each.size for each in arrays if each.ndim >= axes) for axes in (1, 2))
    tanhs = sum(bias.size for bias in network.biases[:-1])
    if isinstance(
        network, RecurrentNetwork
    ):  # three for each node, of which two are sigmoids, and as many products
        multiplications, tanhs = (each + 3 * network.memory.nodes for each in (multiplications, tanhs))
    return Cost(parameters, 4 * parameters, multiplications, tanhs)


def export_policy(network: Network, path: str | os.PathLike, format: str) -> Cost:
    """Writes a network as "onnx", "c" or "json" to a new file, whole or not at all, whose folder is made;
    returns what it costs.

    All take an observation (N_T · features) in float32, whose numbers are named in the file, and give a value
    per action, or the curvature of a network that chooses one; a recurrent network, which goes to JSON alone,
    takes the newest records. Raises FileExistsError where there is something at `path`, PolicyError where
    ONNX is asked for and the package `onnx` is missing.
    """
    encode = FORMATS[check_name("format", format, FORMATS)]
    target = files.expanded(path)
    if not isinstance(network, Network):
        raise PolicyError(f"policy must be a network to be exported, got {network!r}")
    if isinstance(network, RecurrentNetwork) and format != "json":
        raise PolicyError(f"format must be json for a recurrent network, got {format!r}")
    if target.exists() or target.is_symlink():
        raise FileExistsError(f"{target} must be a new file: what is there is never overwritten")
    data = encode(network, _identifier(target.name.partition(".")[0]))
    target.parent.mkdir(parents=True, exist_ok=True)
    files.write_bytes(target, data)
    return cost(network)


def input_names(network: Network) -> list[str]:
    """Names of an observation's numbers, record by record, the newest (0) first; a concentration is
    c κ̄/c_k less its mean over the records.
    """
    try:
        names = list(SENSORS.make(network.sensor).names)
    except (TypeError, ValueError):  # a stranger's own
        names = ["concentration", "curvature", *(f"number_{i}" for i in range(2, network.features))]
    records = network.n_seen if isinstance(network, RecurrentNetwork) else network.n_records
    return [f"{name}_{record}" for record in range(records) for name in names]


def _json(network: Network, name: str) -> bytes:
    layers = [
        {"weight": _numbers(weight), "bias": _numbers(bias), "activation": "tanh"}
        for weight, bias in zip(network.weights, network.biases, strict=True)
    ]
    layers[-1]["activation"] = "identity"
    about = {"name": name, "card": network.card, "inputs": input_names(network), "layers": layers}
    if isinstance(network, RecurrentNetwork):
        about["memory"] = {part: _numbers(array) for part, array in network.memory.arrays.items()}
    return (json.dumps(about, indent=1, ensure_ascii=False) + "\n").encode()


def _numbers(values: np.ndarray) -> Any:
    """Lists of the shortest numbers that are these in float32."""
    return float(str(values)) if values.ndim == 0 else [_numbers(np.asarray(each)) for each in values]


def _c(network: Network, name: str) -> bytes:
    guard = f"CHEMOSWARM_{name.upper()}_H"
    sizes = [network.n_inputs, *(len(bias) for bias in network.biases)]
    lines = [
        f"/* {network!r}: a policy for chemotactic swimmers.",
        *(f"   {line}" for line in _wrapped(["observation:", *input_names(network)])),
        "   where a concentration is c K/c_k less its mean over the records, K the mean curvature,",
        "   and a curvature lies in [-1, 1]. C99; needs nothing but tanhf of the standard library. */",
        f"#ifndef {guard}\n#define {guard}\n\n#include <math.h>\n",
        f"enum {{ {name}_inputs = {sizes[0]}, {name}_actions = {sizes[-1]} }};\n",
    ]
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        rows, columns = weight.shape
        lines.append(f"static const float {name}_weight_{i}[{rows}][{columns}] = {{")
        lines += [f"  {line}" for row in weight for line in _wrapped(_literals(row, "{", "},"))]
        lines += ["};", f"static const float {name}_bias_{i}[{rows}] = {{"]
        lines += [*(f"  {line}" for line in _wrapped(_literals(bias, "", ""))), "};\n"]
    lines += [
        "/* The value of each action. */",
        f"static inline void {name}_values(const float *observation, float *values) {{",
        *(f"  float layer_{i}[{size}];" for i, size in enumerate(sizes[1:-1])),
    ]
    places = ["observation", *(f"layer_{i}" for i in range(len(sizes) - 2)), "values"]
    for i, (before, after) in enumerate(itertools.pairwise(places)):
        total = "sum" if after == "values" else "tanhf(sum)"
        lines += [
            f"  for (int i = 0; i < {sizes[i + 1]}; i++) {{",
            "    float sum = 0.0f;",
            f"    for (int j = 0; j < {sizes[i]}; j++) sum += {name}_weight_{i}[i][j] * {before}[j];",
            f"    sum += {name}_bias_{i}[i];",
            f"    {after}[i] = {total};",
            "  }",
        ]
    lines += [
        "}\n",
        *_act_in_c(network, name),
        f"\n#endif /* {guard} */",
    ]
    return ("\n".join(lines) + "\n").encode()


def _act_in_c(network: Network, name: str) -> list[str]:
    if network.curvature_range is not None:
        middle, half = _middle_and_half(network)
        return [
            "/* The curvature, in the units of the world that it learnt in. */",
            f"static inline float {name}_act(const float *observation) {{",
            "  float value;",
            f"  {name}_values(observation, &value);",
            f"  return {middle!s}f + {half!s}f * tanhf(value);\n}}",
        ]
    return [
        "/* The action of the largest value, the first of several. */",
        f"static inline int {name}_act(const float *observation) {{",
        f"  float values[{network.n_actions}];",
        "  int best = 0;",
        f"  {name}_values(observation, values);",
        f"  for (int i = 1; i < {network.n_actions}; i++) if (values[i] > values[best]) best = i;",
        "  return best;\n}",
    ]


def _middle_and_half(network: Network) -> tuple[np.float32, np.float32]:
    """Of the range of a network that chooses a curvature [1 / length]."""
    assert network.curvature_range is not None
    low, high = network.curvature_range
    return np.float32(0.5 * (low + high)), np.float32(0.5 * (high - low))


def _literals(values: np.ndarray, opening: str, closing: str) -> list[str]:
    """A row of float constants, the shortest that are these in float32."""
    words = [f"{value!s}f," for value in values]
    words[0] = opening + words[0]
    words[-1] = words[-1].removesuffix(",") + closing
    return words


def _wrapped(words: list[str]) -> list[str]:
    lines = [words[0]]
    for word in words[1:]:
        if len(lines[-1]) + len(word) < WIDTH - 4:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines


def _onnx(network: Network, name: str) -> bytes:
    try:
        from onnx import TensorProto, helper, numpy_helper
    except ImportError as error:
        raise PolicyError(
            f"format onnx must have the package onnx, chemoswarm[onnx] brings it: {error}"
        ) from None
    nodes, constants, before = [], [], "observation"
    last = len(network.weights) - 1
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        after = "values" if i == last else f"sum_{i}"
        constants += [
            numpy_helper.from_array(np.asarray(each), f"{part}_{i}")
            for part, each in (("weight", weight), ("bias", bias))
        ]
        nodes.append(helper.make_node("Gemm", [before, f"weight_{i}", f"bias_{i}"], [after], transB=1))
        if i < last:
            nodes.append(helper.make_node("Tanh", [after], [f"layer_{i}"]))
        before = f"layer_{i}"
    kind, shape = TensorProto.INT64, list[Any](["cells"])
    if network.curvature_range is None:
        nodes.append(helper.make_node("ArgMax", ["values"], ["action"], axis=1, keepdims=0))
    else:
        kind, shape = TensorProto.FLOAT, ["cells", 1]
        pair = zip(("middle", "half"), _middle_and_half(network), strict=True)
        constants += [numpy_helper.from_array(np.asarray(each), part) for part, each in pair]
        nodes.append(helper.make_node("Tanh", ["values"], ["part"]))
        nodes.append(helper.make_node("Mul", ["part", "half"], ["away"]))
        nodes.append(helper.make_node("Add", ["away", "middle"], ["action"]))
    taken = helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["cells", network.n_inputs])
    given = [
        helper.make_tensor_value_info("values", TensorProto.FLOAT, ["cells", network.n_actions]),
        helper.make_tensor_value_info("action", kind, shape),
    ]
    graph = helper.make_graph(nodes, name, [taken], given, constants)
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="chemoswarm",
    )
    told = {"card": network.card, "inputs": input_names(network)}
    helper.set_model_props(model, {key: json.dumps(value, ensure_ascii=False) for key, value in told.items()})
    return model.SerializeToString(deterministic=True)


def _identifier(text: str) -> str:
    name = re.sub(r"\W", "_", text, flags=re.ASCII) or "policy"
    return f"policy_{name}" if name[0].isdigit() else name


FORMATS: dict[str, Callable[[Network, str], bytes]] = {"c": _c, "json": _json, "onnx": _onnx}


def default_path(policy: str, format: str) -> Path:
    """Where a policy of this name goes: into the current folder, called as it is."""
    name = Path(policy.rpartition(":")[2]).expanduser().name.removesuffix(".safetensors") or "policy"
    suffix = "h" if check_name("format", format, FORMATS) == "c" else format
    return Path(f"{name}.{suffix}")
