"""Networks of several seeds: values, stacks, fresh weights, export."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torchrl.modules import MLP

from trainers.algorithms.networks import SeedLinear, exported, seed_mlp

CARD = {"n_records": 4, "features": 2}


def network(sizes=(8, 24, 24, 24, 2), seeds=3, first=0):
    return seed_mlp(sizes, range(first, first + seeds))


def stock(net, place):
    """TorchRL's own MLP with the weights of one seed."""
    sizes = [
        net[0].weight.shape[1],
        *(layer.weight.shape[2] for layer in net if isinstance(layer, SeedLinear)),
    ]
    made = MLP(sizes[0], sizes[-1], num_cells=sizes[1:-1], activation_class=torch.nn.Tanh)
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


def test_a_network_is_the_same_alone_and_in_a_stack():
    stack = network(seeds=3)
    for seed in range(3):
        alone = network(seeds=1, first=seed).state_dict()
        assert all(torch.equal(alone[name][0], tensor[seed]) for name, tensor in stack.state_dict().items())


def test_no_seed_touches_another_ones_values():
    net, observation = network(), torch.randn(3, 7, 8)
    before = net(observation)
    observation[1] += 1
    with torch.no_grad():
        net[0].weight[1] += 0.1
    after = net(observation)
    assert torch.equal(after[::2], before[::2])
    assert not torch.equal(after[1], before[1])


def test_fresh_weights_are_uniform_within_glorots_bounds_and_biases_zero():
    for layer in list(network((8, 200, 2), seeds=4))[::2]:
        bound = math.sqrt(6 / sum(layer.weight.shape[1:]))
        assert layer.weight.abs().max() <= bound
        assert layer.weight.std().item() == pytest.approx(bound / math.sqrt(3), rel=0.05)
        assert not layer.bias.any()


@pytest.mark.parametrize("seed", [0, 2])
def test_the_exported_policy_values_actions_as_the_network_does(seed):
    net, observation = network(), torch.randn(3, 100, 8)
    policy = exported(net.state_dict(), seed, CARD)
    expected = net(observation)[seed].detach().numpy()
    np.testing.assert_allclose(policy.values(observation[seed].numpy()), expected, rtol=1e-4, atol=1e-5)
    assert [len(bias) for bias in policy.biases] == [24, 24, 24, 2]
