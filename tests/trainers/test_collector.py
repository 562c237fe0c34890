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


def test_without_exploration_every_action_is_that_of_torchrls_actor():
    made = collector()
    rollout = collect(made, 0.0, 5)
    actor = QValueActor(
        made.policy.network, spec=Categorical(2), in_keys=["observation"], action_space="categorical"
    )
    for step in rollout:
        assert torch.equal(actor(step.select("observation"))["action"], step["action"])


@pytest.mark.parametrize("epsilon", [0.3, 1.0])
@pytest.mark.parametrize("curvatures", [(3.0, 5.0), (3.0, 4.0, 5.0)], ids=["two", "three"])
def test_epsilon_is_the_chance_of_an_action_of_which_all_are_equally_likely(curvatures, epsilon):
    made = collector(swimmers=500, curvatures=curvatures)
    rollout = collect(made, epsilon, 20)
    best = torch.stack([made.policy.network(each) for each in rollout["observation"]]).argmax(-1)
    for other in range(1, len(curvatures)):  # counted from the best on
        share = ((rollout["action"] - best) % len(curvatures) == other).double().mean()
        assert share.item() == pytest.approx(epsilon / len(curvatures), abs=0.01)


def test_rollouts_chain_from_one_decision_to_the_next_and_from_one_call_to_the_next():
    made = collector((0, 1))
    rollout = torch.cat([collect(made, 0.5, 3) for _ in range(2)])
    assert rollout.shape == (6, 2, made.cells)
    assert torch.equal(rollout["next", "observation"][:-1], rollout["observation"][1:])


@pytest.mark.parametrize("arriving", [False, True])
def test_collecting_ends_with_the_last_life_and_time_is_no_termination(arriving):
    egg = {"field": "radial", "start_box": ((-1.5, 1.5), (-1.5, 1.5))} if arriving else {}
    made = collector(swimmers=60, varying_speed=True, life=5.0, **egg)
    rollout = collect(made, 0.5, 100)
    alive, following = rollout["collector", "mask"], rollout["next"]
    assert made.env.all_finished()
    assert (alive.int().diff(dim=0) <= 0).all()  # once done, a cell stays so
    assert alive[0].all()
    assert not alive[-1].all()
    assert (following["reward"][~alive] == 0).all()
    assert torch.equal(following["done"][:-1].squeeze(-1), ~alive[1:])
    assert following["done"][-1].all()
    assert following["terminated"].any() == arriving
    assert not (following["terminated"] & ~following["done"]).any()


def test_exploration_is_named_by_seed_life_and_decision_however_many_are_collected_at_once():
    one, other = (collector((1, 2), life=40.0) for _ in range(2))
    whole = collect(one, 1.0, 80)["action"]
    parts = [collect(other, 1.0, decisions)["action"] for decisions in (1, 30, 35, 14)]
    assert torch.equal(whole, torch.cat(parts))
    one.env.restart()
    others = [whole[BLOCK : BLOCK + 16], collect(one, 1.0, 16)["action"], whole[:16].flip(1)]
    assert not any(torch.equal(whole[:16], other) for other in others)
