"""Collecting: ε-greedy decisions, rows that chain, lives that end."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import MultiStep

from swarm.torchrl_env import SwarmEnv
from trainers.collecting import Explorer, multi_step
from trainers.q_network import QNetwork


def explorer(seeds=(0,), worlds=2, swimmers=5, **parameters):
    made = Explorer(
        SwarmEnv(worlds * len(seeds), n_swimmers=swimmers, seeds=list(seeds), **({"life": 8.0} | parameters))
    )
    made.env.restart()
    return made


def network(made):
    world = made.env.world
    generators = [torch.Generator().manual_seed(seed) for seed in made.seeds]
    return QNetwork.create((world.observation_size, 8, world.n_actions), generators)


def test_without_exploration_every_action_is_the_best():
    made = explorer()
    net = network(made)
    rows = made.collect(net, 0.0, 5)
    best = net.values(rows["observation"].transpose(0, 1)).argmax(-1).transpose(0, 1)
    assert torch.equal(rows["action"], best)


@pytest.mark.parametrize("curvatures", [(3.0, 5.0), (3.0, 4.0, 5.0)], ids=["two", "three"])
def test_with_full_exploration_every_action_is_equally_likely(curvatures):
    made = explorer(swimmers=200, curvatures=curvatures)
    action = made.collect(network(made), 1.0, 20)["action"]
    for number in range(len(curvatures)):
        share = (action == number).double().mean()
        assert share == pytest.approx(1 / len(curvatures), abs=0.02)


def test_epsilon_is_the_chance_to_explore():
    made = explorer(swimmers=500)
    net = network(made)
    rows = made.collect(net, 0.3, 20)
    best = net.values(rows["observation"].transpose(0, 1)).argmax(-1).transpose(0, 1)
    # a random action is the best one half of the time
    assert (rows["action"] != best).double().mean() == pytest.approx(0.15, abs=0.01)


def test_rows_chain_from_one_decision_to_the_next_and_from_one_call_to_the_next():
    made = explorer((0, 1))
    net, cells = network(made), made.cells
    rows = torch.cat([made.collect(net, 0.5, 3), made.collect(net, 0.5, 3)])
    assert rows.batch_size == (6 * cells, 2)
    assert torch.equal(rows["next_observation"][:-cells], rows["observation"][cells:])


def test_rows_of_cells_that_were_done_are_not_valid():
    made = explorer(varying_speed=True, life=5.0)
    rows = made.collect(network(made), 0.5, 100)
    valid = rows["valid"].reshape(-1, made.cells)
    assert (valid.diff(dim=0) <= 0).all()  # once done, a cell stays so
    assert valid[0].all()
    assert not valid[-1].all()
    assert (rows["reward"][rows["valid"] == 0] == 0).all()


def test_collecting_stops_when_every_life_has_ended():
    made = explorer(life=2.0)
    rows = made.collect(network(made), 0.5, 100)
    assert made.everyone_done()
    assert len(rows) == made.env.world.max_decisions * made.cells


def test_lives_that_run_out_of_time_are_not_terminated():
    made = explorer(life=2.0)
    assert (made.collect(network(made), 0.5, 100)["bootstrap"] == made.discount).all()


def test_cells_that_arrive_are_terminated():
    made = explorer(swimmers=60, field="radial", start_box=((-1.5, 1.5), (-1.5, 1.5)))
    rows = made.collect(network(made), 1.0, 100)
    arrived = (rows["bootstrap"] == 0) & (rows["valid"] > 0)
    assert arrived.any()
    assert (rows["bootstrap"][~arrived & (rows["valid"] > 0)] == made.discount).all()


def test_rewards_telescope_to_the_gain_of_the_mean_record():
    made = explorer(life=20.0)
    world = made.env.world
    first = made.env.state.memory[..., 0].mean(-1)
    rows = made.collect(network(made), 0.5, 1000)
    change = made.env.state.memory[..., 0].mean(-1) - first
    total = rows["reward"].reshape(-1, made.cells).sum(0)
    expected = change.flatten() * world.n_records * world.reward_scale
    assert torch.allclose(total, expected, atol=1e-3)


def test_a_seed_explores_the_same_alone_and_in_a_stack():
    stack, alone = explorer((4, 5, 6)), explorer((5,))
    joint, single = network(stack), network(alone)
    for _ in range(3):
        some, rows = stack.collect(joint, 0.5, 4), alone.collect(single, 0.5, 4)
        assert torch.equal(some["action"][:, 1], rows["action"][:, 0])
        assert torch.allclose(some["observation"][:, 1], rows["observation"][:, 0], atol=1e-6)
        assert torch.allclose(some["reward"][:, 1], rows["reward"][:, 0], atol=1e-6)


def test_draws_are_named_by_the_round_and_differ_between_rounds():
    one, other = explorer(), explorer()
    net = network(one)
    first, second = (one.collect(net, 1.0, 4)["action"] for _ in range(2))
    other.rounds = 1
    assert torch.equal(other.collect(net, 1.0, 4)["action"], second)
    assert not torch.equal(first, second)


def test_returns_over_several_decisions_by_hand():
    reward = torch.tensor([[1.0], [2.0], [4.0], [8.0]])
    following = torch.arange(1.0, 5.0)[:, None, None]
    alive = torch.ones(4, 1, dtype=torch.bool)
    total, reached, bootstrap = multi_step(reward, following, ~alive, alive, discount=0.5, steps=3)
    assert total.flatten().tolist() == [1 + 1 + 1, 2 + 2 + 2, 4 + 4, 8]
    assert reached.flatten().tolist() == [3, 4, 4, 4]
    assert bootstrap.flatten().tolist() == [0.125, 0.125, 0.25, 0.5]


def test_returns_end_with_the_life():
    reward = torch.tensor([[1.0], [2.0], [0.0]])
    following = torch.arange(1.0, 4.0)[:, None, None]
    valid = torch.tensor([[True], [True], [False]])
    for terminated, last in ((False, 0.5), (True, 0.0)):
        ends = torch.tensor([[False], [terminated], [False]])
        total, reached, bootstrap = multi_step(reward, following, ends, valid, discount=0.5, steps=3)
        assert total.flatten().tolist()[:2] == [2.0, 2.0]
        assert reached.flatten().tolist()[:2] == [2.0, 2.0]
        assert bootstrap.flatten().tolist()[:2] == [0.5 * last, last]


def test_returns_are_those_of_torchrl():
    generator = torch.Generator().manual_seed(0)
    reward = torch.randn(6, 5, generator=generator)
    following = torch.randn(6, 5, 3, generator=generator)
    ends = torch.rand(6, 5, generator=generator) < 0.15
    valid = torch.cat([torch.ones(1, 5), (~ends).cumprod(0)[:-1]]).bool()
    never = torch.zeros_like(ends)  # TorchRL leaves the termination of later decisions to its user
    total, reached, bootstrap = multi_step(reward, following, never, valid, discount=0.9, steps=3)
    rows = TensorDict(
        {
            "observation": torch.zeros(5, 6, 3),
            "collector": {"mask": valid.T},
            "next": {
                "observation": following.transpose(0, 1),
                "reward": reward.T.unsqueeze(-1),
                "done": ends.T.unsqueeze(-1),
                "terminated": never.T.unsqueeze(-1),
            },
        },
        batch_size=(5, 6),
    )
    stock = MultiStep(gamma=0.9, n_steps=3)(rows)
    seen = valid.T
    assert torch.allclose(stock["next", "reward"].squeeze(-1)[seen], total.T[seen], atol=1e-6)
    assert torch.allclose(stock["next", "observation"][seen], reached.transpose(0, 1)[seen])
    assert torch.allclose(stock["gamma"].squeeze(-1)[seen], bootstrap.T[seen], atol=1e-6)
