"""A recurrent policy: PyTorch's GRU in NumPy, its file, its lives, its export."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import torch

import swarm
from swarm.policies.export import cost, export_policy, input_names
from swarm.policies.network import RecurrentNetwork, load_policy, save_policy
from swarm.policies.policy_file import PolicyError

CARD = {"n_records": 4, "features": 2, "algorithm": "drqn"}
NODES, SEEN = 6, np.random.default_rng(2).normal(size=(9, 70, 4)).astype(np.float32)  # (steps, cells, inputs)


def torchs(inputs=4, nodes=NODES, seed=0):
    """PyTorch's own layers."""
    torch.manual_seed(seed)
    return torch.nn.GRU(inputs, nodes), torch.nn.Linear(nodes, 5), torch.nn.Linear(5, 2)


def policy_of(gru, *linears, card=CARD, **changes):
    memory = {
        name.removesuffix("_l0"): tensor.detach().numpy() for name, tensor in gru.named_parameters()
    } | changes
    weights, biases = (
        [getattr(each, part).detach().numpy() for each in linears] for part in ("weight", "bias")
    )
    return RecurrentNetwork(memory, weights, biases, card)


def through(policy, seen=SEEN):
    """Values (steps, cells, actions) and hidden states (steps, cells, nodes)."""
    hidden, found = np.zeros((seen.shape[1], policy.memory.nodes), np.float32), []
    for each in seen:
        values, hidden = policy.advanced(each, hidden)
        found.append((values, hidden))
    return [np.stack(part) for part in zip(*found, strict=True)]


def test_it_values_actions_as_pytorchs_layers_do():
    gru, first, second = torchs()
    hidden = gru(torch.from_numpy(SEEN))[0]
    expected = second(first(hidden).tanh())
    values, states = through(policy_of(gru, first, second))
    np.testing.assert_allclose(states, hidden.detach(), atol=2e-6)
    np.testing.assert_allclose(values, expected.detach(), atol=2e-6)
    alone = through(policy_of(gru, first, second), SEEN[:, 66:67])
    assert all(np.array_equal(few, many[:, 66:67]) for few, many in zip(alone, (values, states), strict=True))


def test_its_file_and_its_json_hold_all_of_it(tmp_path):
    policy = policy_of(*torchs())
    save_policy(policy, tmp_path / "file")
    again = load_policy(tmp_path / "file")
    assert repr(again) == "RecurrentNetwork(4-6-5-2, n_records=4, features=2)"
    assert (again.fingerprint, again.card) == (policy.fingerprint, policy.card)
    assert policy.fingerprint != policy_of(*torchs(), bias_hh=np.zeros(18)).fingerprint
    assert all(np.array_equal(*pair) for pair in zip(through(again), through(policy), strict=True))
    assert export_policy(again, tmp_path / "it.json", "json") == cost(policy)
    assert cost(policy)[:1] + cost(policy)[2:] == (3 * 6 * 12 + 47, 3 * 6 * 11 + 40, 3 * 6 + 5)
    told = json.loads((tmp_path / "it.json").read_text())
    assert (
        told["inputs"]
        == input_names(policy)
        == [f"c{rest}" for rest in ("oncentration_0", "urvature_0", "oncentration_1", "urvature_1")]
    )
    assert all(
        np.array_equal(np.float32(told["memory"][name]), array)
        for name, array in policy.memory.arrays.items()
    )
    with pytest.raises(PolicyError, match="format must be json for a recurrent network, got 'c'"):
        export_policy(policy, tmp_path / "it.h", "c")


def test_in_a_population_it_carries_what_it_remembers():
    world, policy = swarm.World(life=6.0, binding_rate=800.0), policy_of(*torchs(seed=3))
    lives = [swarm.population_test(world, {"it": policy}, cells=cells, life=6.0) for cells in (70, 3)]
    np.testing.assert_array_equal(lives[0]["gain"][0, :3], lives[1]["gain"][0])
    state = world.start(*swarm.draw_starts(world, 5, 1))
    carry = policy.begin(world, state)
    for number in range(3):
        records = state.memory[..., :2, :].copy()
        records[..., 0] -= records[..., 0].mean(-1, keepdims=True)
        values, expected = policy.advanced(records.reshape(5, 4), carry)
        action, carry = policy.act_carrying(world, state, None, carry)
        assert np.array_equal(carry, expected)
        assert np.array_equal(action, values.argmax(-1))
        state, _ = world.step(state, action, np.full((5, 4), 0.1 * number))
    with pytest.raises(PolicyError, match="must be played by begin and act_carrying, got no hidden state"):
        policy.act(world, state)
    with pytest.raises(PolicyError, match="policy must fit what the world's cells observe"):
        policy.begin(swarm.World(n_records=2), state)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"bias_hh": np.zeros(17)}, "memory must have three rows for each of its 6 nodes, got weight_ih 18"),
        ({"weight_ih": np.zeros((18, 3))}, "its memory takes 2 numbers of each of 2 to 4 records"),
        ({"weight_ih": np.zeros((18, 2))}, "and gives 6 to the first layer, got 2 and 6"),
        ({"weight_ih": np.zeros((18, 10))}, "2 to 4 records, and gives 6 to the first layer, got 10 and 6"),
        ({"weight_hh": np.full((18, 6), np.nan)}, "memory.weight_hh must hold finite numbers"),
        ({"weight_ho": np.zeros(2)}, "memory must hold weight_ih, weight_hh, bias_ih, bias_hh, got"),
    ],
)
def test_a_memory_that_does_not_fit_is_told(changes, said):
    with pytest.raises(PolicyError, match=re.escape(said)):
        policy_of(*torchs(), **changes)


@pytest.mark.parametrize(
    ("name", "shape"), [("memory.bias_hh", None), ("memory.weight_hh", (18,)), ("memory.more", (2,))]
)
def test_a_strangers_file_is_checked_before_it_is_read(tmp_path, name, shape):
    from swarm._support import tensors

    policy = policy_of(*torchs())
    arrays = policy.tensors | ({name: np.zeros(shape, np.float32)} if shape else {})
    if shape is None:
        del arrays[name]
    tensors.write(tmp_path / "file", arrays, policy.card)
    with pytest.raises(PolicyError, match=r"its tensors must be|must have 2 axes"):
        load_policy(tmp_path / "file")
