"""The Q-network: values, gradients, stacks of seeds, export."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from trainers.algorithms.q_network import QNetwork

CARD = {"n_records": 4, "features": 2}


def network(sizes=(8, 24, 24, 24, 2), seeds=3, dtype=torch.float32):
    made = QNetwork.create(sizes, [torch.Generator().manual_seed(seed) for seed in range(seeds)])
    return QNetwork(made.flat.to(dtype), sizes)


def autograd_gradient(net, observation, slope):
    flat = net.flat.clone().requires_grad_()
    values = QNetwork(flat, net.sizes)
    hidden = observation
    for layer, (weight, bias) in enumerate(zip(values.weights, values.biases, strict=True)):
        hidden = hidden @ weight + bias
        if layer < len(values.weights) - 1:
            hidden = torch.tanh(hidden)
    (hidden * slope).sum().backward()
    return hidden.detach(), flat.grad


@given(
    sizes=st.lists(st.integers(1, 6), min_size=2, max_size=5),
    seeds=st.integers(1, 3),
    rows=st.integers(1, 5),
    draw=st.integers(0, 1000),
)
@settings(max_examples=30)
def test_values_and_gradient_are_those_of_autograd(sizes, seeds, rows, draw):
    net = network(tuple(sizes), seeds, torch.float64)
    generator = torch.Generator().manual_seed(draw)
    observation = torch.randn(seeds, rows, sizes[0], generator=generator, dtype=torch.float64)
    slope = torch.randn(seeds, rows, sizes[-1], generator=generator, dtype=torch.float64)
    values, expected = autograd_gradient(net, observation, slope)
    layers = net.layers(observation)
    assert torch.allclose(layers[-1], values, rtol=1e-12, atol=1e-12)
    assert torch.allclose(net.gradient(layers, slope), expected, rtol=1e-11, atol=1e-12)


def test_float32_gradient_is_that_of_autograd_to_rounding():
    net = network()
    observation, slope = torch.randn(3, 512, 8), torch.randn(3, 512, 2)
    _, expected = autograd_gradient(net, observation, slope)
    difference = (net.gradient(net.layers(observation), slope) - expected).abs().max()
    assert difference < 1e-5 * expected.abs().max()


def test_a_network_is_the_same_alone_and_in_a_stack():
    stack = network(seeds=3)
    for seed in range(3):
        alone = QNetwork.create(stack.sizes, [torch.Generator().manual_seed(seed)])
        assert torch.equal(alone.flat[0], stack.flat[seed])


def test_no_seed_touches_another_ones_values():
    net, observation = network(seeds=3), torch.randn(3, 7, 8)
    before = net.values(observation)
    observation[1] += 1
    net.flat[1] += 0.1
    after = net.values(observation)
    assert torch.equal(after[0], before[0])
    assert torch.equal(after[2], before[2])
    assert not torch.equal(after[1], before[1])


def test_fresh_weights_are_uniform_within_glorots_bounds_and_biases_zero():
    net = network((8, 200, 2), seeds=4)
    for weight, bias in zip(net.weights, net.biases, strict=True):
        bound = math.sqrt(6 / sum(weight.shape[1:]))
        assert weight.abs().max() <= bound
        assert weight.std() == pytest.approx(bound / math.sqrt(3), rel=0.05)
        assert not bias.any()


def test_layers_are_views_so_that_one_update_moves_them_all():
    net = network()
    net.flat.zero_()
    assert not any(part.any() for part in (*net.weights, *net.biases))


def test_a_copy_goes_its_own_way():
    net = network()
    copy = net.copy()
    net.flat += 1
    assert not torch.equal(copy.flat, net.flat)
    assert torch.equal(copy.flat + 1, net.flat)


@pytest.mark.parametrize("seed", [0, 2])
def test_the_exported_policy_values_actions_as_the_network_does(seed):
    net, observation = network(), torch.randn(3, 100, 8)
    policy = net.exported(seed, CARD)
    expected = net.values(observation)[seed].numpy()
    np.testing.assert_allclose(policy.values(observation[seed].numpy()), expected, rtol=1e-4, atol=1e-5)
    assert policy.n_actions == 2
    assert [len(bias) for bias in policy.biases] == [24, 24, 24, 2]
