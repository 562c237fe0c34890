"""Collecting: ε-greedy decisions, rows that chain, lives that end."""

from __future__ import annotations

import itertools

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import MultiStep

from swarm.envs.torchrl import SwarmEnv
from trainers.algorithms.exploration import BLOCK, Explorer, multi_step
from trainers.algorithms.q_network import QNetwork
from trainers.algorithms.transitions import Transitions


def explorer(seeds=(0,), worlds=2, swimmers=5, **parameters):
    made = Explorer(
        SwarmEnv(worlds * len(seeds), n_swimmers=swimmers, seeds=list(seeds), **({"life": 8.0} | parameters))
    )
    made.restart()
    return made


def collect(made, network, epsilon, decisions):
    """Transitions (rows, seeds)."""
    return Transitions.unpacked(made.collect(network, epsilon, decisions))


def network(made):
    world = made.env.world
    generators = [torch.Generator().manual_seed(seed) for seed in made.seeds]
    return QNetwork.create((world.observation_size, 8, world.n_actions), generators)


def test_without_exploration_every_action_is_the_best():
    made = explorer()
    net = network(made)
    rows = collect(made, net, 0.0, 5)
    best = net.values(rows.observation.transpose(0, 1)).argmax(-1).transpose(0, 1)
    assert torch.equal(rows.action, best)


@pytest.mark.parametrize("curvatures", [(3.0, 5.0), (3.0, 4.0, 5.0)], ids=["two", "three"])
def test_with_full_exploration_every_action_is_equally_likely(curvatures):
    made = explorer(swimmers=200, curvatures=curvatures)
    action = collect(made, network(made), 1.0, 20).action
    for number in range(len(curvatures)):
        share = (action == number).double().mean()
        assert share == pytest.approx(1 / len(curvatures), abs=0.02)


def test_epsilon_is_the_chance_to_explore():
    made = explorer(swimmers=500)
    net = network(made)
    rows = collect(made, net, 0.3, 20)
    best = net.values(rows.observation.transpose(0, 1)).argmax(-1).transpose(0, 1)
    # a random action is the best one half of the time
    assert (rows.action != best).double().mean() == pytest.approx(0.15, abs=0.01)


def test_rows_chain_from_one_decision_to_the_next_and_from_one_call_to_the_next():
    made = explorer((0, 1))
    net, cells = network(made), made.cells
    rows = Transitions(*map(torch.cat, zip(*(collect(made, net, 0.5, 3) for _ in range(2)), strict=True)))
    assert rows.action.shape == (6 * cells, 2)
    assert torch.equal(rows.next_observation[:-cells], rows.observation[cells:])


def test_rows_of_cells_that_were_done_are_not_valid():
    made = explorer(varying_speed=True, life=5.0)
    rows = collect(made, network(made), 0.5, 100)
    valid = rows.valid.reshape(-1, made.cells)
    assert (valid.diff(dim=0) <= 0).all()  # once done, a cell stays so
    assert valid[0].all()
    assert not valid[-1].all()
    assert (rows.reward[rows.valid == 0] == 0).all()


def test_collecting_stops_when_every_life_has_ended():
    made = explorer(life=2.0)
    rows = collect(made, network(made), 0.5, 100)
    assert made.env.all_finished()
    assert len(rows.action) == made.env.world.max_decisions * made.cells


def test_lives_that_run_out_of_time_are_not_terminated():
    made = explorer(life=2.0)
    assert (collect(made, network(made), 0.5, 100).bootstrap == made.discount).all()


def test_cells_that_arrive_are_terminated():
    made = explorer(swimmers=60, field="radial", start_box=((-1.5, 1.5), (-1.5, 1.5)))
    rows = collect(made, network(made), 1.0, 100)
    arrived = (rows.bootstrap == 0) & (rows.valid > 0)
    assert arrived.any()
    assert (rows.bootstrap[~arrived & (rows.valid > 0)] == made.discount).all()


def test_rewards_telescope_to_the_gain_of_the_mean_record():
    made = explorer(life=20.0)
    world = made.env.world
    first = made.env.state.memory[..., 0].mean(-1)
    rows = collect(made, network(made), 0.5, 1000)
    change = made.env.state.memory[..., 0].mean(-1) - first
    total = rows.reward.reshape(-1, made.cells).sum(0)
    expected = change.flatten() * world.n_records * world.reward_scale
    assert torch.allclose(total, expected, atol=1e-3)


def test_a_seed_explores_the_same_alone_and_in_a_stack():
    stack, alone = explorer((4, 5, 6)), explorer((5,))
    joint, single = network(stack), network(alone)
    for _ in range(3):
        some, rows = collect(stack, joint, 0.5, 4), collect(alone, single, 0.5, 4)
        assert torch.equal(some.action[:, 1], rows.action[:, 0])
        assert torch.allclose(some.observation[:, 1], rows.observation[:, 0], atol=1e-6)
        assert torch.allclose(some.reward[:, 1], rows.reward[:, 0], atol=1e-6)


def test_exploration_is_named_by_the_decision_however_many_are_collected_at_once():
    one, other, net = explorer(life=40.0), explorer(life=40.0), network(explorer())
    whole = collect(one, net, 1.0, 80).action
    parts = [collect(other, net, 1.0, decisions).action for decisions in (1, 30, 35, 14)]
    assert torch.equal(whole, torch.cat(parts))
    block = BLOCK * one.cells
    assert not torch.equal(whole[: 16 * one.cells], whole[block : block + 16 * one.cells])


def test_exploration_differs_between_lives_and_seeds():
    made = explorer((1, 2))
    net = network(made)
    first = collect(made, net, 1.0, 4).action
    made.restart()
    assert not torch.equal(collect(made, net, 1.0, 4).action, first)
    assert not torch.equal(first[:, 0], first[:, 1])


@pytest.mark.parametrize("parts", [(100,), (1,), (2, 3), (7, 1, 30)], ids=str)
@pytest.mark.parametrize("radial", [False, True], ids=["all live as long", "some arrive"])
def test_returns_cross_the_rounds_of_collecting(parts, radial):
    world = {"life": 4.0} | ({"field": "radial", "start_box": ((-1.5, 1.5), (-1.5, 1.5))} if radial else {})
    one_step, more_steps = (
        Explorer(SwarmEnv(2, n_swimmers=30, **world), discount=0.9, n_steps=steps) for steps in (1, 3)
    )
    net = network(explorer())
    one_step.restart()
    more_steps.restart()
    rounds = []
    for decisions in itertools.cycle(parts):
        rounds.append(more_steps.collect(net, 1.0, decisions))
        if more_steps.env.all_finished():
            break
    one, more = (
        Transitions.unpacked(rows.unflatten(0, (-1, one_step.cells)))
        for rows in (one_step.collect(net, 1.0, 100), torch.cat(rounds))
    )
    assert torch.equal(one.observation, more.observation)
    assert torch.equal(one.action, more.action)
    lived = one.valid > 0
    assert torch.equal(lived, more.valid > 0)
    assert lived.all() != radial
    expected = multi_step(one.reward, one.next_observation, one.bootstrap == 0, lived, discount=0.9, steps=3)
    for got, wanted in zip((more.reward, more.next_observation, more.bootstrap), expected, strict=True):
        assert torch.equal(got[lived], wanted[lived])


def test_a_new_life_takes_nothing_over_from_one_that_was_left():
    made, fresh = (Explorer(SwarmEnv(1, n_swimmers=4, life=8.0), n_steps=3) for _ in range(2))
    net = network(explorer())
    made.restart()
    made.collect(net, 0.5, 5)
    for each in (made, fresh):
        each.env.set_seeds([3])
        each.restart()
    assert torch.equal(made.collect(net, 0.5, 5), fresh.collect(net, 0.5, 5))


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
