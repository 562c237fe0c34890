"""Networks of several seeds: values, gradients, fresh weights."""

from __future__ import annotations

import math

import pytest
import torch
from tensordict import TensorDict
from torchrl.modules import MLP

from trainers.algorithms.networks import SeedLinear, seed_mlp


def network(sizes=(8, 24, 24, 24, 2), seeds=3, first=0):
    return seed_mlp(sizes, range(first, first + seeds))


def stock(net, place):
    """TorchRL's own MLP with the weights of one seed."""
    hidden = [layer.weight.shape[2] for layer in net if isinstance(layer, SeedLinear)]
    outputs = hidden.pop()
    made = MLP(net[0].weight.shape[1], outputs, num_cells=hidden, activation_class=torch.nn.Tanh)
    for mine, theirs in zip(net, made, strict=True):
        if isinstance(mine, SeedLinear):
            theirs.weight.data = mine.weight[place].T.detach().clone()
            theirs.bias.data = mine.bias[place, 0].detach().clone()
    return made


def test_values_and_gradients_are_those_of_vmap_over_torchrls_own_mlp():
    net, rows = network().double(), torch.randn(3, 7, 8, dtype=torch.float64)
    modules = [stock(net, place).double() for place in range(3)]
    stacked, skeleton = TensorDict.from_modules(*modules, as_module=True), stock(net, 0).double()

    def values(parameters, rows):
        with parameters.to_module(skeleton):
            return skeleton(rows)

    expected, found = torch.vmap(values, (0, 0))(stacked, rows), net(rows)
    assert torch.allclose(found, expected, rtol=1e-12, atol=1e-12)
    weights = torch.randn(3, 7, 2, dtype=torch.float64)
    for each in (found, expected):
        (each * weights).sum().backward()
    for place in (0, 2, 4, 6):
        theirs = stacked[str(place), "weight"].grad.mT
        assert torch.allclose(net[place].weight.grad, theirs, rtol=1e-11, atol=1e-12)


def test_fresh_weights_are_uniform_within_glorots_bounds_and_biases_zero():
    for layer in list(network((8, 200, 2), seeds=4))[::2]:
        bound = math.sqrt(6 / sum(layer.weight.shape[1:]))
        assert layer.weight.abs().max() <= bound
        assert layer.weight.std().item() == pytest.approx(bound / math.sqrt(3), rel=0.05)
        assert not layer.bias.any()
