"""A trained policy: a small fully connected network that runs in NumPy, and its file.

A policy file is in safetensors: arrays and one card in JSON, nothing that could run. What it says is checked
against fixed limits before anything of its size is allocated, so anyone's file is safe to open.
"""

from __future__ import annotations

import json
import math
import os
import stat
import struct
from collections.abc import Sequence
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm import files, perception
from swarm.arrays import namespace
from swarm.checks import check_count, check_name

if TYPE_CHECKING:
    from swarm.world import State, World

Array = Any

CARD = "chemoswarm"  # the one key of the file's metadata
POLICY_FILE = "policy.safetensors"  # its name in a run folder
ZOO = "zoo:"  # what names of shipped policies begin with
MAX_FILE = 16 * 2**20  # [bytes]
MAX_HEADER = 256 * 2**10  # [bytes]
MAX_LAYERS = 16
MAX_WIDTH = 4096  # nodes of a layer
MAX_DEPTH = 8  # of a card's nesting
BLOCK = 64  # rows that are always computed together


class PolicyError(ValueError):
    """A file that is no policy, or a policy that does not fit a world."""


class Network:
    """Q-values of every action by a fully connected network: tanh between layers, linear output.

    The card says what it was made for: `n_records` (N_T) and `features` (numbers per record: 2, or 5 with the
    flow sensed) are needed, anything else that JSON can hold may follow. Raises PolicyError unless layers and
    card agree.
    """

    def __init__(self, weights: Sequence[Any], biases: Sequence[Any], card: dict[str, Any]) -> None:
        self.weights = tuple(_layer(f"layers.{i}.weight", array, 2) for i, array in enumerate(weights))
        self.biases = tuple(_layer(f"layers.{i}.bias", array, 1) for i, array in enumerate(biases))
        _check_chain(self.weights, self.biases)
        self.card = _check_card({**card, "n_actions": card.get("n_actions", self.n_actions)})
        size = self.n_records * self.features
        if size != self.n_inputs:
            raise PolicyError(
                f"card must describe the network: n_records × features is "
                f"{self.n_records} × {self.features} = {size}, got {self.n_inputs} inputs"
            )
        if self.card["n_actions"] != self.n_actions:
            raise PolicyError(
                f"card must describe the network: n_actions is {self.card['n_actions']}, "
                f"got {self.n_actions} outputs"
            )

    def __repr__(self) -> str:
        nodes = "-".join(str(size) for size in (self.n_inputs, *(len(bias) for bias in self.biases)))
        return f"Network({nodes}, n_records={self.n_records}, features={self.features})"

    @property
    def n_inputs(self) -> int:
        """Numbers in an observation."""
        return self.weights[0].shape[1]

    @property
    def n_actions(self) -> int:
        """m, the number of outputs."""
        return self.weights[-1].shape[0]

    @property
    def n_records(self) -> int:
        """N_T it was trained for."""
        return self.card["n_records"]

    @property
    def features(self) -> int:
        """Numbers per record: 2, or 5 with the flow sensed."""
        return self.card["features"]

    @cached_property
    def _transposed(self) -> tuple[np.ndarray, ...]:
        return tuple(np.ascontiguousarray(weight.T) for weight in self.weights)

    def values(self, observation: Array) -> np.ndarray:
        """Q-values (..., m) float32 of observations (..., inputs).

        Rows are computed in blocks of a fixed size, the last one padded, so that a cell's values are the same
        to the last bit whatever the number of cells.
        """
        inputs = np.asarray(observation, np.float32)
        if inputs.shape[-1:] != (self.n_inputs,):
            raise PolicyError(
                f"observation must end in {self.n_inputs} numbers, got the shape {inputs.shape}"
            )
        rows = math.prod(inputs.shape[:-1])
        padded = np.zeros((-(-rows // BLOCK), BLOCK, self.n_inputs), np.float32)
        padded.reshape(-1, self.n_inputs)[:rows] = inputs.reshape(rows, self.n_inputs)
        hidden = padded
        for weight, bias in zip(self._transposed[:-1], self.biases[:-1], strict=True):
            hidden = np.matmul(hidden, weight)
            hidden += bias
            np.tanh(hidden, out=hidden)
        output = np.matmul(hidden, self._transposed[-1]) + self.biases[-1]
        return output.reshape(-1, self.n_actions)[:rows].reshape(*inputs.shape[:-1], self.n_actions)

    def __call__(self, observation: Array) -> np.ndarray:
        """Best actions (...) for observations (..., inputs)."""
        return np.argmax(self.values(observation), axis=-1)

    def act(self, world: World, state: State, uniform: Array | None = None) -> Array:
        """Best actions (..., cells). A flow that the world senses and the network does not is left out.

        Raises PolicyError where the network does not fit the world.
        """
        self.check_fits(world)
        observation = perception.observe(state.memory[..., : self.features])
        action = self(observation)
        return namespace(state.memory).asarray(action)

    def check_fits(self, world: World) -> None:
        """Raises PolicyError unless the network can steer cells of this world."""
        if self.n_records == world.n_records and self.features <= world.features:
            if self.n_actions == world.n_actions:
                return
            raise PolicyError(
                f"policy must have one value for each action of the world: the policy has {self.n_actions}, "
                f"the world {world.n_actions}"
            )
        hint = (
            "; it senses the flow, so the world needs sense_flow=True"
            if self.features > world.features
            else ""
        )
        raise PolicyError(
            f"policy must fit what the world's cells observe: the policy takes {self.n_inputs} numbers "
            f"(n_records = {self.n_records}, {self.features} in each), the world gives "
            f"{world.observation_size} (n_records = {world.n_records}, {world.features} in each){hint}"
        )


def save_policy(network: Network, path: str | os.PathLike) -> None:
    """Writes the network and its card as safetensors, whole or not at all; always in the same bytes."""
    from safetensors.numpy import save

    tensors = {}
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        tensors[f"layers.{i}.weight"], tensors[f"layers.{i}.bias"] = weight, bias
    card = json.dumps(network.card, sort_keys=True, allow_nan=False, ensure_ascii=False)
    files.write_bytes(path, save(tensors, {CARD: card}))


def load_policy(name: str | os.PathLike) -> Network:
    """The network of a policy file, of a run folder's `policy.safetensors`, or shipped: "zoo:linear_n4".

    Raises PolicyError that names the file and the rule it breaks; nothing in the file can run.
    """
    if isinstance(name, str) and name.startswith(ZOO):
        return _load_from_zoo(name.removeprefix(ZOO))
    path = Path(name)
    if path.is_dir():
        path = path / POLICY_FILE
    return parse_policy(_read(path), str(path))


def zoo_names() -> list[str]:
    """Names of the shipped policies, without "zoo:"."""
    folder = resources.files("swarm") / "zoo"
    if not folder.is_dir():
        return []
    return sorted(
        item.name.removesuffix(".safetensors")
        for item in folder.iterdir()
        if item.name.endswith(".safetensors")
    )


def parse_policy(data: bytes, source: str) -> Network:
    """The network in the bytes of a policy file; `source` names it in errors (PolicyError)."""
    try:
        shapes, card = _check_header(data)
        return Network(*_tensors(data, shapes), card)
    except PolicyError as error:
        raise PolicyError(f"{source} is no policy that can be opened: {error}") from None


def _load_from_zoo(name: str) -> Network:
    names = zoo_names()
    try:
        check_name("shipped policy", name, names)
    except ValueError as error:
        raise PolicyError(str(error)) from None
    file = resources.files("swarm") / "zoo" / f"{name}.safetensors"
    return parse_policy(file.read_bytes(), ZOO + name)


def _read(path: Path) -> bytes:
    """The file's bytes; nothing is read that is no ordinary file of a reasonable size."""
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise PolicyError(f"{path} must be an ordinary file")
        if about.st_size > MAX_FILE:
            raise PolicyError(f"{path} must have at most {MAX_FILE} bytes, got {about.st_size}")
        with path.open("rb") as file:
            data = file.read(MAX_FILE + 1)
    except FileNotFoundError:
        raise PolicyError(
            f"{path} must be a policy file or a folder with a {POLICY_FILE}: it is not there"
        ) from None
    except OSError as error:
        raise PolicyError(f"{path} must be a policy file that can be read, got {error.strerror}") from None
    if len(data) > MAX_FILE:
        raise PolicyError(f"{path} must have at most {MAX_FILE} bytes")
    return data


def _check_header(data: bytes) -> tuple[dict[str, tuple[int, ...]], dict[str, Any]]:
    """Shapes of the tensors and the card; raises PolicyError before anything of their size is allocated."""
    if data[:1] == b"\x80" or data[:2] == b"PK" or data[:4] in (b"cos\n", b"cpos"):
        raise PolicyError(
            "it looks like a pickle, which could run anything; a policy must be a safetensors file"
        )
    if len(data) < 8:
        raise PolicyError(f"a safetensors file must have at least 8 bytes, got {len(data)}")
    (size,) = struct.unpack("<Q", data[:8])
    if size > min(MAX_HEADER, len(data) - 8):
        raise PolicyError(
            f"a policy's safetensors header must have at most {MAX_HEADER} bytes, all in the file, "
            f"got {size} announced in a file of {len(data)}"
        )
    header = _parse_json(data[8 : 8 + size], "header")
    metadata = header.pop("__metadata__", None)
    if not isinstance(metadata, dict) or not isinstance(metadata.get(CARD), str):
        raise PolicyError(f"its metadata must hold a card named {CARD!r}")
    shapes = _check_tensors(header)
    stored = 4 * sum(math.prod(shape) for shape in shapes.values())
    if stored != len(data) - 8 - size:
        raise PolicyError(
            f"its tensors must fill the file: {stored} bytes by the header, got {len(data) - 8 - size}"
        )
    return shapes, _parse_json(metadata[CARD].encode(), "card")


def _check_tensors(header: dict[str, Any]) -> dict[str, tuple[int, ...]]:
    layers = len(header) // 2
    names = [f"layers.{i}.{part}" for i in range(layers) for part in ("weight", "bias")]
    if not 1 <= layers <= MAX_LAYERS or set(header) != set(names):
        raise PolicyError(
            f"its tensors must be layers.0.weight, layers.0.bias, … of at most {MAX_LAYERS} layers, "
            f"got {', '.join(repr(name)[:60] for name in list(header)[:6]) or 'none'}"
        )
    shapes = {}
    for name in names:
        entry = header[name]
        entry = entry if isinstance(entry, dict) else {}
        dtype, shape = entry.get("dtype"), entry.get("shape")
        if dtype != "F32":
            raise PolicyError(f"{name} must be of dtype F32, got {str(dtype)[:60]!r}")
        axes = 2 if name.endswith("weight") else 1
        sides = shape if isinstance(shape, list) else []
        if len(sides) != axes or not all(type(side) is int and 1 <= side <= MAX_WIDTH for side in sides):
            raise PolicyError(
                f"{name} must have {axes} axes of 1 to {MAX_WIDTH}, got the shape {str(shape)[:60]}"
            )
        shapes[name] = tuple(sides)
    return shapes


def _tensors(data: bytes, shapes: dict[str, tuple[int, ...]]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        tensors = load(data)
    except SafetensorError as error:
        raise PolicyError(f"it must be a valid safetensors file, got {error}") from None
    layers = range(len(shapes) // 2)
    return [tensors[f"layers.{i}.weight"] for i in layers], [tensors[f"layers.{i}.bias"] for i in layers]


def _parse_json(data: bytes, part: str) -> dict[str, Any]:
    """A JSON object; raises PolicyError for anything that JSON proper does not allow."""

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        result = dict(pairs)
        if len(result) != len(pairs):
            raise ValueError("a key appears twice")
        return result

    def no_number(text: str) -> Any:
        raise ValueError(f"{text} is no number")

    try:
        value = json.loads(data.decode(), object_pairs_hook=unique, parse_constant=no_number)
    except (ValueError, RecursionError) as error:
        raise PolicyError(f"its {part} must be valid JSON, got {str(error)[:100]}") from None
    if not isinstance(value, dict):
        raise PolicyError(f"its {part} must be a JSON object, got {type(value).__name__}")
    return value


def _check_card(card: dict[str, Any]) -> dict[str, Any]:
    """The card as plain JSON values, printable as it is; raises PolicyError otherwise."""
    plain = _plain(card, 0)
    if len(json.dumps(plain)) > MAX_HEADER // 4:
        raise PolicyError(f"card must have at most {MAX_HEADER // 4} bytes")
    for name in ("n_records", "features", "n_actions"):
        if name not in plain:
            raise PolicyError(f"card must state {name}, got {', '.join(list(plain)[:10]) or 'an empty card'}")
        try:
            check_count(f"card's {name}", plain[name], at_least=1 if name == "features" else 2)
        except (TypeError, ValueError) as error:
            raise PolicyError(str(error)) from None
    return plain


def _plain(value: Any, depth: int) -> Any:
    if depth > MAX_DEPTH:
        raise PolicyError(f"card must be nested at most {MAX_DEPTH} deep")
    if isinstance(value, dict):
        return {_plain_text(key): _plain(item, depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, depth + 1) for item in value]
    if isinstance(value, str):
        return _plain_text(value)
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float) and math.isfinite(value):
        return float(value)
    raise PolicyError(f"card must hold JSON values only, with finite numbers, got {str(value)[:60]!r}")


def _plain_text(value: Any) -> str:
    # Cards are printed: an escape sequence of a stranger must not reach the terminal.
    if not isinstance(value, str) or not all(
        character.isprintable() or character == "\n" for character in value
    ):
        raise PolicyError(f"card must hold printable text only, got {ascii(value)[:60]}")
    return value


def _layer(name: str, array: Any, axes: int) -> np.ndarray:
    result = np.array(array, dtype=np.float32, order="C")
    if result.ndim != axes or not all(1 <= side <= MAX_WIDTH for side in result.shape):
        raise PolicyError(f"{name} must have {axes} axes of 1 to {MAX_WIDTH}, got the shape {result.shape}")
    if not np.all(np.isfinite(result)):
        raise PolicyError(f"{name} must hold finite numbers, got {np.sum(~np.isfinite(result))} that are not")
    result.flags.writeable = False
    return result


def _check_chain(weights: Sequence[np.ndarray], biases: Sequence[np.ndarray]) -> None:
    if len(weights) != len(biases) or not 1 <= len(weights) <= MAX_LAYERS:
        raise PolicyError(
            f"a network must have 1 to {MAX_LAYERS} layers with a weight and a bias each, "
            f"got {len(weights)} weights and {len(biases)} biases"
        )
    for i, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        if weight.shape[0] != len(bias):
            raise PolicyError(
                f"layers.{i}.bias must have {weight.shape[0]} numbers like its weight, got {len(bias)}"
            )
        if i and weight.shape[1] != len(biases[i - 1]):
            raise PolicyError(
                f"layers.{i}.weight must take the {len(biases[i - 1])} numbers of the layer before, "
                f"got {weight.shape[1]}"
            )
