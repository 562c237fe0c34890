"""The Q-network: one small multilayer perceptron steers every cell; its parameters carry a leading axis of seeds."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor, nn


class QNetwork(nn.Module):
    """Fully connected tanh layers and a linear output, for several independent seeds at once (paper: Deep Q-Network).

    Maps observations (seeds, batch, n_inputs) to values (seeds, batch, n_actions). Seed e of the stack is a network of its
    own: nothing mixes along the leading axis. Weights start uniform within ±√(6/(fan in + fan out)) (Glorot), biases at 0,
    drawn from one generator per seed, so a seed starts alike in a stack of any size.
    """

    def __init__(
        self, n_inputs: int, hidden: tuple[int, ...], n_actions: int, generators: list[torch.Generator]
    ) -> None:
        super().__init__()
        sizes = (n_inputs, *hidden, n_actions)
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for fan_in, fan_out in zip(sizes[:-1], sizes[1:], strict=True):
            bound = math.sqrt(6 / (fan_in + fan_out))
            draws = [torch.rand(fan_in, fan_out, generator=generator) for generator in generators]
            self.weights.append(nn.Parameter((torch.stack(draws) * 2 - 1) * bound))
            self.biases.append(nn.Parameter(torch.zeros(len(generators), 1, fan_out)))

    def forward(self, observation: Tensor) -> Tensor:
        """Values (seeds, batch, n_actions) of observations (seeds, batch, n_inputs)."""
        x = observation
        last = len(self.weights) - 1
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = torch.baddbmm(bias, x, weight)
            if layer < last:
                x = torch.tanh(x)
        return x

    @torch.no_grad()
    def arrays(self, seed_index: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Weights (out, in) and biases (out,) of one seed's network, as NumPy arrays."""
        weights = [weight[seed_index].T.contiguous().cpu().numpy().copy() for weight in self.weights]
        biases = [bias[seed_index, 0].cpu().numpy().copy() for bias in self.biases]
        return weights, biases
