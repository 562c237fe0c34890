"""The Q-network: one small multilayer perceptron steers every cell; its parameters carry a leading axis of
seeds.

Values and gradients are written out, because for a network this small autograd's bookkeeping costs more than
the arithmetic (`benchmarks/training_path.py` measures both); a test holds the gradient equal to autograd's.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from swarm.policies.network import Network


class QNetwork:
    """Fully connected tanh layers and a linear output, for independent seeds at once (paper: Deep Q-Network).

    Maps observations (seeds, batch, n_inputs) to values (seeds, batch, n_actions); nothing mixes along the
    leading axis. All parameters of a seed are one row of `flat` (seeds, parameters); `weights` and `biases`
    are views of it.
    """

    def __init__(self, flat: Tensor, sizes: Sequence[int]) -> None:
        self.flat, self.sizes = flat, tuple(sizes)
        self.weights: list[Tensor] = []  # (seeds, inputs, outputs) of each layer
        self.biases: list[Tensor] = []  # (seeds, 1, outputs) of each layer
        at = 0
        for inputs, outputs in zip(self.sizes[:-1], self.sizes[1:], strict=True):
            self.weights.append(flat[:, at : at + inputs * outputs].unflatten(1, (inputs, outputs)))
            at += inputs * outputs
            self.biases.append(flat[:, None, at : at + outputs])
            at += outputs

    @classmethod
    def create(
        cls, sizes: Sequence[int], generators: Sequence[torch.Generator], device: torch.device | str = "cpu"
    ) -> QNetwork:
        """A fresh network for each generator, the same in a stack of any size; `sizes` from input to output.

        Weights are uniform within ±√(6/(inputs + outputs)) (Glorot and Bengio 2010), biases 0.
        """
        rows = []
        for generator in generators:
            parts = []
            for inputs, outputs in itertools.pairwise(sizes):
                bound = math.sqrt(6 / (inputs + outputs))
                parts += [
                    (2 * torch.rand(inputs * outputs, generator=generator) - 1) * bound,
                    torch.zeros(outputs),
                ]
            rows.append(torch.cat(parts))
        return cls(torch.stack(rows).to(device), sizes)

    def copy(self) -> QNetwork:
        """A network with equal parameters of its own."""
        return QNetwork(self.flat.clone(), self.sizes)

    def layers(self, observation: Tensor) -> list[Tensor]:
        """Inputs of every layer, then the values."""
        outputs = [observation]
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            outputs.append(torch.baddbmm(bias, outputs[-1], weight).tanh_())
        outputs.append(torch.baddbmm(self.biases[-1], outputs[-1], self.weights[-1]))
        return outputs

    def values(self, observation: Tensor) -> Tensor:
        """Action values (seeds, batch, n_actions)."""
        return self.layers(observation)[-1]

    def gradient(self, layers: list[Tensor], slope: Tensor) -> Tensor:
        """Gradient (seeds, parameters) of a loss whose `slope` (seeds, batch, n_actions) by the values is
        given.
        """
        parts: list[Tensor] = []
        for layer in range(len(self.weights) - 1, -1, -1):
            parts = [torch.bmm(layers[layer].mT, slope).flatten(1), slope.sum(1), *parts]
            if layer:
                slope = torch.ops.aten.tanh_backward(torch.bmm(slope, self.weights[layer].mT), layers[layer])
        return torch.cat(parts, dim=1)

    def exported(self, seed_index: int, card: dict[str, Any]) -> Network:
        """One seed's network as a policy that runs in NumPy."""
        return Network(
            tuple(weight[seed_index].T.contiguous().cpu().numpy() for weight in self.weights),
            tuple(bias[seed_index, 0].contiguous().cpu().numpy() for bias in self.biases),
            card,
        )
