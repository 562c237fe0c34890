"""Collecting: ε-greedy decisions, rollouts that chain, lives that end, random numbers by name."""

import pytest
import torch
from torchrl.data import Categorical
from torchrl.modules import QValueActor

from swarm.torchrl_env import SwarmEnv
from trainers.algorithms.collector import BLOCK, SeedCollector
from trainers.algorithms.dqn import EpsilonGreedy
from trainers.algorithms.networks import seed_mlp


def collector(seeds=(0,), worlds=2, swimmers=5, **parameters):
    env = SwarmEnv(
        worlds * len(seeds), n_swimmers=swimmers, seeds=list(seeds), **({"life": 8.0} | parameters)
    )
    env.restart()
    sizes = (env.world.observation_size, 8, env.world.n_actions)
    net = seed_mlp(sizes, seeds)
    return SeedCollector(env, EpsilonGreedy(net, env.world.n_actions))


def collect(made, epsilon, decisions):
    made.policy.epsilon = epsilon
    return made.collect(decisions)


def best(made, rollout):
    """(decisions, seeds, cells)."""
    return torch.stack([made.policy.network(each) for each in rollout["observation"]]).argmax(-1)


def test_without_exploration_every_action_is_that_of_torchrls_actor():
    made = collector()
    rollout = collect(made, 0.0, 5)
    actor = QValueActor(
        made.policy.network, spec=Categorical(2), in_keys=["observation"], action_space="categorical"
    )
    for step in rollout:
        assert torch.equal(actor(step.select("observation"))["action"], step["action"])


@pytest.mark.parametrize("curvatures", [(3.0, 5.0), (3.0, 4.0, 5.0)], ids=["two", "three"])
def test_with_full_exploration_every_action_is_equally_likely(curvatures):
    action = collect(collector(swimmers=200, curvatures=curvatures), 1.0, 20)["action"]
    for number in range(len(curvatures)):
        share = (action == number).double().mean()
        assert share.item() == pytest.approx(1 / len(curvatures), abs=0.02)


def test_epsilon_is_the_chance_to_explore():
    made = collector(swimmers=500)
    rollout = collect(made, 0.3, 20)
    # a random action is the best one half of the time
    differs = (rollout["action"] != best(made, rollout)).double().mean()
    assert differs.item() == pytest.approx(0.15, abs=0.01)


def test_rollouts_chain_from_one_decision_to_the_next_and_from_one_call_to_the_next():
    made = collector((0, 1))
    rollout = torch.cat([collect(made, 0.5, 3) for _ in range(2)])
    assert rollout.shape == (6, 2, made.cells)
    assert torch.equal(rollout["next", "observation"][:-1], rollout["observation"][1:])


def test_cells_that_were_done_are_masked():
    rollout = collect(collector(varying_speed=True, life=5.0), 0.5, 100)
    alive = rollout["collector", "mask"]
    assert (alive.int().diff(dim=0) <= 0).all()  # once done, a cell stays so
    assert alive[0].all()
    assert not alive[-1].all()
    assert (rollout["next", "reward"][~alive] == 0).all()
    assert torch.equal(rollout["next", "done"][:-1].squeeze(-1), ~alive[1:])


def test_collecting_stops_when_every_life_has_ended_and_time_is_no_termination():
    made = collector(life=2.0)
    rollout = collect(made, 0.5, 100)
    assert made.env.all_finished()
    assert len(rollout) == made.env.world.max_decisions
    assert not rollout["next", "terminated"].any()
    assert rollout["next", "done"][-1].all()


def test_cells_that_arrive_are_terminated():
    made = collector(swimmers=60, field="radial", start_box=((-1.5, 1.5), (-1.5, 1.5)))
    following = collect(made, 1.0, 100)["next"]
    assert following["terminated"].any()
    assert not (following["terminated"] & ~following["done"]).any()


def test_a_seed_explores_the_same_alone_and_in_a_stack():
    stack, alone = collector((4, 5, 6)), collector((5,))
    for _ in range(3):
        some, one = collect(stack, 0.5, 4), collect(alone, 0.5, 4)
        assert torch.equal(some["action"][:, 1], one["action"][:, 0])
        assert torch.allclose(some["observation"][:, 1], one["observation"][:, 0], atol=1e-6)


def test_exploration_is_named_by_the_decision_however_many_are_collected_at_once():
    one, other = collector(life=40.0), collector(life=40.0)
    whole = collect(one, 1.0, 80)["action"]
    parts = [collect(other, 1.0, decisions)["action"] for decisions in (1, 30, 35, 14)]
    assert torch.equal(whole, torch.cat(parts))
    assert not torch.equal(whole[:16], whole[BLOCK : BLOCK + 16])


def test_exploration_differs_between_lives_and_seeds():
    made = collector((1, 2))
    first = collect(made, 1.0, 4)["action"]
    made.env.restart()
    assert not torch.equal(collect(made, 1.0, 4)["action"], first)
    assert not torch.equal(first[:, 0], first[:, 1])
