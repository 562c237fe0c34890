"""A trained policy: a small fully connected network that runs in NumPy, and its file.

A policy file is in safetensors: arrays and one card in JSON, nothing that could run. What it says is checked
against fixed limits before anything of its size is allocated, so anyone's file is safe to open.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from swarm._support import files, tensors
from swarm._support.arrays import as_array, namespace
from swarm._support.checks import check_name
from swarm._support.registry import TYPE
from swarm.physics import perception
from swarm.physics.world import State, World
from swarm.policies.layers import GRU, Dense, as_rows, in_blocks
from swarm.policies.policy_file import (
    MAX_FILE,
    MEMORY,
    POLICY_FILE,
    SENSORS,
    PolicyError,
    check_card,
    check_tensors,
)

Array = Any

ZOO = "zoo:"  # what names of shipped policies begin with
SUFFIX = ".safetensors"


class Network:
    """Q-values of every action by a fully connected network: tanh between layers, linear output. A network
    whose card states a `curvature_range` has one output o, and chooses the curvature at tanh o between the
    range's middle (0) and its ends (±1).

    The card says what it was made for: `n_records` (N_T), `features` (numbers per record) and `sensor`, what
    takes the records, by its name or as `{"type": name, parameter: value, …}` (default: memory for 2,
    memory_with_flow for 5 features), and by which `algorithm` it learnt (default: dqn); anything else that
    JSON can hold may follow. Raises PolicyError unless layers and card agree.
    """

    deterministic = True

    def __init__(self, weights: Sequence[Any], biases: Sequence[Any], card: dict[str, Any]) -> None:
        self.layers = Dense(weights, biases)
        self.weights, self.biases = self.layers.weights, self.layers.biases
        self.card = check_card({**card, "n_actions": card.get("n_actions", self.n_actions)})
        rule = "card must describe the network"
        self._check_inputs(rule)
        if self.card["n_actions"] != self.n_actions:
            stated = self.card["n_actions"]
            raise PolicyError(f"{rule}: n_actions is {stated}, got {self.n_actions} outputs")
        if self.curvature_range is not None and self.n_actions != 1:
            raise PolicyError(f"{rule}: a curvature_range goes with one output, got {self.n_actions}")

    def _check_inputs(self, rule: str) -> None:
        """Raises PolicyError unless the first layer takes what cells observe."""
        size = self.n_records * self.features
        if size != self.n_inputs:
            product = f"n_records × features is {self.n_records} × {self.features} = {size}"
            raise PolicyError(f"{rule}: {product}, got {self.n_inputs} inputs")

    def __repr__(self) -> str:
        name, nodes = type(self).__name__, "-".join(map(str, self.sizes))
        return f"{name}({nodes}, n_records={self.n_records}, features={self.features})"

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers that it takes, nodes of each layer, and outputs."""
        return (self.n_inputs, *(len(bias) for bias in self.biases))

    @property
    def tensors(self) -> dict[str, np.ndarray]:
        """All its numbers, by their names in a policy file."""
        return self.layers.tensors

    @property
    def n_inputs(self) -> int:
        """Numbers in an observation."""
        return self.weights[0].shape[1]

    @property
    def n_actions(self) -> int:
        """m, the number of outputs; 1 where the action is a curvature."""
        return self.weights[-1].shape[0]

    @property
    def curvature_range(self) -> tuple[float, float] | None:
        """The lowest and the highest curvature that it chooses [1 / length]; None where it takes an action by
        its value."""
        return None if (stated := self.card.get("curvature_range")) is None else (stated[0], stated[1])

    @property
    def n_records(self) -> int:
        """N_T it was trained for."""
        return self.card["n_records"]

    @property
    def features(self) -> int:
        """Numbers per record that it takes."""
        return self.card["features"]

    @property
    def sensor(self) -> str | dict[str, Any]:
        """The sensor it was trained with: its name, or its type and parameters."""
        return self.card.get("sensor") or SENSORS[self.features]

    @property
    def algorithm(self) -> str:
        """What it learnt by; all of version 0.1, which did not say, by DQN."""
        return self.card.get("algorithm", "dqn")

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of its numbers and its card."""
        digest = hashlib.sha256(json.dumps(self.card, sort_keys=True).encode())
        for array in self.tensors.values():
            digest.update(array.tobytes())
        return digest.hexdigest()

    def values(self, observation: Array) -> np.ndarray:
        """Q-values (..., m) float32 of observations (..., inputs), the same to the last bit whatever the
        number of cells.
        """
        inputs = np.asarray(observation, np.float32)
        if inputs.shape[-1:] != (self.n_inputs,):
            raise PolicyError(
                f"observation must end in {self.n_inputs} numbers, got the shape {inputs.shape}"
            )
        return as_rows(self.layers(in_blocks(inputs)), inputs.shape[:-1])

    def __call__(self, observation: Array) -> np.ndarray:
        """Best actions (...) for observations (..., inputs); curvatures in float64."""
        return self.best(self.values(observation))

    def best(self, values: np.ndarray) -> np.ndarray:
        """The action (...) of values (..., m)."""
        if self.curvature_range is None:
            return np.argmax(values, axis=-1)
        low, high = self.curvature_range
        return 0.5 * (low + high) + 0.5 * (high - low) * np.tanh(values[..., 0].astype(np.float64))

    def act(self, world: World, state: State, uniform: Array | None = None) -> Array:
        """Best actions (..., cells). What the world senses besides the plain memory, and a network that was
        trained without does not, is left out.

        Raises PolicyError where the network does not fit the world.
        """
        self.check_fits(world)
        observation = perception.observe(state.memory[..., : self.features])
        return self._as_action(self(observation), state)

    def _as_action(self, action: np.ndarray, state: State) -> Array:
        if self.curvature_range is not None:
            return as_array(action, state.memory)
        return namespace(state.memory).asarray(action)

    def check_fits(self, world: World) -> None:
        """Raises PolicyError unless the network can steer cells of this world."""
        there = perception.described(world.sensor)
        observed = (there, world.features), (SENSORS[2], 2)  # which every record begins with
        if self.n_records != world.n_records or (self.sensor, self.features) not in observed:
            hint = "; it senses the flow: sense_flow=True" if self.sensor == SENSORS[5] else ""
            raise PolicyError(
                f"policy must fit what the world's cells observe: the policy takes {self.n_inputs} numbers "
                f"(n_records = {self.n_records}, {self.features} of {_told(self.sensor)} in each), the world "
                f"gives {world.observation_size} (n_records = {world.n_records}, {world.features} of "
                f"{_told(there)} in each){hint}"
            )
        if self.curvature_range != world.action_range:
            own, theirs = (
                f"curvatures of {each}" if each else "numbers of actions"
                for each in (self.curvature_range, world.action_range)
            )
            rule = "policy must take the actions of the world"
            raise PolicyError(f"{rule}: the policy takes {own}, the world {theirs}")
        if not world.is_continuous and self.n_actions != world.n_actions:
            raise PolicyError(
                f"policy must have one value for each action of the world: the policy has {self.n_actions}, "
                f"the world {world.n_actions}"
            )


class RecurrentNetwork(Network):
    """Q-values by a network that remembers: a [`GRU`][swarm.policies.layers.GRU] is shown the newest records,
    as many as its inputs are, and layers as of a `Network` take its hidden state.

    It is a `CarryingPolicy`: what it carries is the hidden state (..., cells, nodes), at first 0. Raises
    PolicyError unless memory, layers and card agree.
    """

    def __init__(
        self, memory: Mapping[str, Any], weights: Sequence[Any], biases: Sequence[Any], card: dict[str, Any]
    ) -> None:
        self.memory = GRU(memory)
        super().__init__(weights, biases, card)

    def _check_inputs(self, rule: str) -> None:
        whole = self.n_inputs % self.features == 0 and 2 <= self.n_seen <= self.n_records
        if not whole or self.weights[0].shape[1] != self.memory.nodes:
            raise PolicyError(
                f"{rule}: its memory takes {self.features} numbers of each of 2 to {self.n_records} records, "
                f"and gives {self.memory.nodes} to the first layer, got {self.n_inputs} and "
                f"{self.weights[0].shape[1]}"
            )

    @property
    def n_inputs(self) -> int:
        """Numbers that it is shown."""
        return self.memory.inputs

    @property
    def n_seen(self) -> int:
        """Records that it is shown, the newest."""
        return self.n_inputs // self.features

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers that it is shown, nodes of its memory and of each layer, and outputs."""
        return (self.n_inputs, self.memory.nodes, *super().sizes[1:])

    @property
    def tensors(self) -> dict[str, np.ndarray]:
        """All its numbers, by their names in a policy file."""
        return super().tensors | self.memory.tensors

    def values(self, observation: Array) -> np.ndarray:
        """Raises PolicyError: see `advanced`."""
        raise PolicyError("a recurrent network must be played by begin and act_carrying, got no hidden state")

    def advanced(self, observation: Array, hidden: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Q-values (..., m) of observations (..., n_seen · features), and the hidden state (..., nodes) after
        them, in float32; the same to the last bit whatever the number of cells.
        """
        seen = np.asarray(observation, np.float32)
        after = self.memory(in_blocks(seen), in_blocks(hidden))
        cells = seen.shape[:-1]
        return as_rows(self.layers(after), cells), as_rows(after, cells)

    def begin(self, world: World, state: State) -> np.ndarray:
        """Nothing is remembered; raises PolicyError where the network does not fit the world."""
        self.check_fits(world)
        return np.zeros((*state.finished.shape, self.memory.nodes), np.float32)

    def act_carrying(
        self, world: World, state: State, uniform: Array | None, carry: np.ndarray
    ) -> tuple[Array, np.ndarray]:
        """Best actions (..., cells), and the hidden state after them."""
        self.check_fits(world)
        seen = perception.observe(state.memory[..., : self.n_seen, : self.features])
        values, carry = self.advanced(seen, carry)
        return self._as_action(self.best(values), state), carry


def _told(sensor: str | dict[str, Any]) -> str:
    if isinstance(sensor, str):
        return sensor
    parameters = ", ".join(f"{name}={value}" for name, value in sensor.items() if name != TYPE)
    return f"{sensor[TYPE]}({parameters})"


def save_policy(network: Network, path: str | os.PathLike) -> None:
    """Writes the network and its card as safetensors, whole or not at all; always in the same bytes."""
    tensors.write(path, network.tensors, network.card)


def load_policy(name: str | os.PathLike) -> Network:
    """The network of a policy file, of a run folder's `policy.safetensors`, or shipped: "zoo:linear_n4".

    Raises PolicyError that names the file and the rule it breaks; nothing in the file can run.
    """
    if isinstance(name, str) and name.startswith(ZOO):
        return _load_from_zoo(name.removeprefix(ZOO))
    path = files.expanded(name)
    if path.is_dir():
        path = path / POLICY_FILE
    return _read(path, str(path))


def zoo_names() -> list[str]:
    """Names of the shipped policies, without "zoo:"."""
    folder = resources.files("swarm") / "zoo"
    names = [item.name for item in folder.iterdir()] if folder.is_dir() else []
    return sorted(name.removesuffix(SUFFIX) for name in names if name.endswith(SUFFIX))


def _read(path: Path, source: str) -> Network:
    """The network of a policy file; `source` names it in errors."""
    try:
        layers, card = tensors.read(path, lambda card, shapes: check_tensors(shapes), at_most=MAX_FILE)
        memory = {part: layers.pop(f"memory.{part}") for part in MEMORY if f"memory.{part}" in layers}
        sizes = range(len(layers) // 2)
        weights, biases = ([layers[f"layers.{i}.{part}"] for i in sizes] for part in ("weight", "bias"))
        return RecurrentNetwork(memory, weights, biases, card) if memory else Network(weights, biases, card)
    except FileNotFoundError:
        raise PolicyError(
            f"{source} must be a policy file or a folder with a {POLICY_FILE}: it is not there"
        ) from None
    except OSError as error:
        reason = f"it cannot be read: {error.strerror}"
    except ValueError as error:
        reason = str(error)
    raise PolicyError(f"{source} is no policy that can be opened: {reason}")


def _load_from_zoo(name: str) -> Network:
    names = zoo_names()
    if not names:
        raise PolicyError(f"no policies are shipped with this copy, got {ZOO}{name}")
    try:
        check_name("shipped policy", name, names)
    except ValueError as error:
        raise PolicyError(str(error)) from None
    return _read(Path(str(resources.files("swarm") / "zoo" / f"{name}{SUFFIX}")), ZOO + name)
