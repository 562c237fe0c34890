"""Layers of networks in NumPy: fully connected ones, and a recurrent one before them.

Rows are computed in blocks of a fixed size, the last one padded, so that a cell's numbers are the same to the
last bit whatever the number of cells.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swarm.policies.policy_file import MAX_LAYERS, MAX_SIZE, MEMORY, PolicyError, check_shape

BLOCK = 64  # rows that are always computed together


class Dense:
    """Fully connected layers, tanh between them: weights (outputs, inputs) and biases (outputs,) in float32.

    Raises PolicyError unless each takes what the one before gives.
    """

    def __init__(self, weights: Sequence[Any], biases: Sequence[Any]) -> None:
        self.weights = tuple(checked(f"layers.{i}.weight", array) for i, array in enumerate(weights))
        self.biases = tuple(checked(f"layers.{i}.bias", array) for i, array in enumerate(biases))
        _check_chain(self.weights, self.biases)
        self._transposed = tuple(np.ascontiguousarray(weight.T) for weight in self.weights)

    def __call__(self, hidden: np.ndarray) -> np.ndarray:
        """Outputs (blocks, BLOCK, outputs) of blocks (blocks, BLOCK, inputs)."""
        for weight, bias in zip(self._transposed[:-1], self.biases[:-1], strict=True):
            hidden = np.matmul(hidden, weight)
            hidden += bias
            np.tanh(hidden, out=hidden)
        return np.matmul(hidden, self._transposed[-1]) + self.biases[-1]

    @property
    def tensors(self) -> dict[str, np.ndarray]:
        """By their names in a policy file."""
        weights = {f"layers.{i}.weight": array for i, array in enumerate(self.weights)}
        return weights | {f"layers.{i}.bias": array for i, array in enumerate(self.biases)}


class GRU:
    """Gated recurrent unit (Cho et al. 2014), as one layer of PyTorch's `GRU`.

    Takes arrays by PyTorch's names without their ending: weight_ih (3 · nodes, inputs), weight_hh (3 · nodes,
    nodes), bias_ih and bias_hh (3 · nodes,), the parts of each for reset, update and new state in this order.
    Raises PolicyError unless they fit together.
    """

    def __init__(self, arrays: Mapping[str, Any]) -> None:
        if set(arrays) != set(MEMORY):
            raise PolicyError(f"memory must hold {', '.join(MEMORY)}, got {', '.join(map(str, arrays))}")
        self.arrays = {name: checked(f"memory.{name}", arrays[name]) for name in MEMORY}
        rows = {name: len(array) for name, array in self.arrays.items()}
        if set(rows.values()) != {3 * self.nodes}:
            told = ", ".join(f"{name} {count}" for name, count in rows.items())
            raise PolicyError(f"memory must have three rows for each of its {self.nodes} nodes, got {told}")
        self._transposed = [np.ascontiguousarray(self.arrays[name].T) for name in MEMORY[:2]]

    @property
    def inputs(self) -> int:
        return self.arrays["weight_ih"].shape[1]

    @property
    def nodes(self) -> int:
        return self.arrays["weight_hh"].shape[1]

    @property
    def tensors(self) -> dict[str, np.ndarray]:
        """By their names in a policy file."""
        return {f"memory.{name}": array for name, array in self.arrays.items()}

    def __call__(self, inputs: np.ndarray, hidden: np.ndarray) -> np.ndarray:
        """The hidden state (blocks, BLOCK, nodes) after inputs (blocks, BLOCK, inputs) in a hidden state."""
        given, held = (
            np.matmul(each, weight) + self.arrays[bias]
            for each, weight, bias in zip((inputs, hidden), self._transposed, MEMORY[2:], strict=True)
        )
        gates, nodes = np.s_[..., : 2 * self.nodes], np.s_[..., 2 * self.nodes :]
        reset, update = np.split(0.5 + 0.5 * np.tanh(0.5 * (given[gates] + held[gates])), 2, axis=-1)
        new = np.tanh(given[nodes] + reset * held[nodes])
        return new + update * (hidden - new)


def in_blocks(rows: np.ndarray) -> np.ndarray:
    """Rows (..., numbers) in blocks (blocks, BLOCK, numbers) of float32, the last one padded with 0."""
    count, numbers = math.prod(rows.shape[:-1]), rows.shape[-1]
    padded = np.zeros((-(-count // BLOCK), BLOCK, numbers), np.float32)
    padded.reshape(-1, numbers)[:count] = rows.reshape(count, numbers)
    return padded


def as_rows(blocks: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The rows (*shape, numbers) that are in blocks."""
    numbers = blocks.shape[-1]
    return blocks.reshape(-1, numbers)[: math.prod(shape)].reshape(*shape, numbers)


def checked(name: str, array: Any) -> np.ndarray:
    """An array of a network in float32, read-only; raises PolicyError where it cannot be one."""
    result = np.array(array, dtype=np.float32, order="C")
    check_shape(name, result.shape)
    beyond = ~(np.abs(result) <= MAX_SIZE)  # NaN too
    if np.any(beyond):
        raise PolicyError(
            f"{name} must hold finite numbers of size {MAX_SIZE:g} at most, got {result[beyond][0]:g}"
        )
    result.flags.writeable = False
    return result


def _check_chain(weights: Sequence[np.ndarray], biases: Sequence[np.ndarray]) -> None:
    """Raises PolicyError unless every layer takes what the one before gives."""
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
