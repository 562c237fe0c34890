"""Deep Q-learning: the loss against TorchRL's, replay, target networks, stacks of seeds."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Categorical
from torchrl.modules import QValueActor
from torchrl.objectives import DQNLoss, SoftUpdate

from trainers.algorithms.dqn import Learner, dqn_loss
from trainers.algorithms.q_network import QNetwork
from trainers.algorithms.transitions import Transitions
from trainers.settings.learning import DQNSettings

SIZES = (8, 24, 24, 2)
ROWS = 64
DISCOUNT = 0.98


def network(seeds, first=0):
    return QNetwork.create(SIZES, [torch.Generator().manual_seed(first + seed) for seed in range(seeds)])


def batch(seeds=1, rows=ROWS, draw=0):
    """Transitions (seeds, rows): some terminated, all valid."""
    generator = torch.Generator().manual_seed(draw)
    shape = (seeds, rows)
    return Transitions(
        observation=torch.randn(*shape, 8, generator=generator),
        next_observation=torch.randn(*shape, 8, generator=generator),
        action=torch.randint(2, shape, generator=generator),
        reward=2 * torch.randn(shape, generator=generator),
        bootstrap=DISCOUNT * (torch.rand(shape, generator=generator) >= 0.2),
        valid=torch.ones(shape),
    )


def part(data, *key):
    """A part of every tensor of the transitions."""
    return Transitions(*(values[key] for values in data))


def torch_module(net):
    """The same network as a module of torch's own layers."""
    layers = []
    for weight, bias in zip(net.weights, net.biases, strict=True):
        layer = torch.nn.Linear(weight.shape[1], weight.shape[2])
        layer.weight.data = weight[0].T.clone()
        layer.bias.data = bias[0, 0].clone()
        layers += [layer, torch.nn.Tanh()]
    return torch.nn.Sequential(*layers[:-1])


def torchrl_loss(online, target, data, *, double, kind, truncated):
    """Loss and gradient by torchrl.objectives.DQNLoss."""
    module = torch_module(online)
    actor = QValueActor(module, spec=Categorical(2), in_keys=["observation"], action_space="categorical")
    loss = DQNLoss(
        actor,
        action_space="categorical",
        loss_function={"huber": "smooth_l1", "squared": "l2"}[kind],
        delay_value=True,
        double_dqn=double,
    )
    loss.make_value_estimator(gamma=DISCOUNT)
    SoftUpdate(loss, eps=0.5)  # without one, TorchRL warns
    for name, parameter in leaves(loss.target_value_network_params):
        parameter.data.copy_(dict(torch_module(target).named_parameters())[name])
    row = part(data, 0)
    terminated = row.bootstrap[:, None] == 0
    stock = TensorDict(
        {
            "observation": row.observation,
            "action": row.action,
            "next": {
                "observation": row.next_observation,
                "reward": row.reward[:, None],
                "terminated": terminated,
                "done": terminated | truncated[:, None],
            },
        },
        batch_size=row.reward.shape,
    )
    value = loss(stock)["loss"]
    value.backward()
    slopes = {name: parameter.grad for name, parameter in leaves(loss.value_network_params)}
    places = range(0, 2 * len(online.weights), 2)
    pairs = [(slopes[f"{place}.weight"].T.flatten(), slopes[f"{place}.bias"]) for place in places]
    return value.detach(), torch.cat([slope for pair in pairs for slope in pair])


def leaves(parameters):
    """("0.weight", tensor) … of TorchRL's nested parameters."""
    for key, value in parameters.items(include_nested=True, leaves_only=True):
        yield ".".join(key[-2:]), value


@pytest.mark.parametrize("kind", ["squared", "huber"])
@pytest.mark.parametrize("double", [False, True])
def test_loss_and_gradient_are_those_of_torchrl(kind, double):
    data, online, target = batch(), network(1), network(1, first=10)
    truncated = torch.rand(ROWS, generator=torch.Generator().manual_seed(5)) < 0.3
    expected, gradient = torchrl_loss(online, target, data, double=double, kind=kind, truncated=truncated)
    outcome = dqn_loss(online, target, data, double=double, kind=kind)
    assert outcome.loss[0] == pytest.approx(float(expected), rel=1e-5)
    assert torch.allclose(outcome.gradient[0], gradient, rtol=1e-4, atol=1e-6)


def test_targets_bootstrap_unless_terminated():
    online = network(1)
    data = part(batch(), slice(None), slice(1))
    data.bootstrap[:] = DISCOUNT
    following = online.values(data.next_observation).amax(-1)
    value = online.values(data.observation)[0, 0, data.action[0, 0]]
    reward = data.reward
    for ended, goal in ((False, reward + DISCOUNT * following), (True, reward)):
        data.bootstrap[:] = 0.0 if ended else DISCOUNT
        outcome = dqn_loss(online, online, data, double=False, kind="squared")
        assert outcome.loss[0] == pytest.approx(float((value - goal) ** 2), rel=1e-5)


def test_double_dqn_values_with_the_target_what_the_online_network_chooses():
    online, target, data = network(1), network(1, first=3), part(batch(), slice(None), slice(1))
    data.bootstrap[:] = DISCOUNT
    choice = online.values(data.next_observation).argmax(-1)[0, 0]
    goal = data.reward + DISCOUNT * target.values(data.next_observation)[..., choice]
    value = online.values(data.observation)[0, 0, data.action[0, 0]]
    outcome = dqn_loss(online, target, data, double=True, kind="squared")
    assert outcome.loss[0] == pytest.approx(float((value - goal) ** 2), rel=1e-5)


@pytest.mark.parametrize("kind", ["squared", "huber"])
def test_rows_that_are_not_valid_count_for_nothing(kind):
    online, target, data = network(2), network(2, first=7), batch(2)
    whole = dqn_loss(online, target, part(data, slice(None), slice(40)), double=True, kind=kind)
    data.valid[:, 40:] = 0
    data.reward[:, 40:] = 1e6
    masked = dqn_loss(online, target, data, double=True, kind=kind)
    for name in ("loss", "value", "gradient"):
        assert torch.allclose(getattr(whole, name), getattr(masked, name), rtol=1e-5, atol=1e-6)
    data.valid[:] = 0
    nothing = dqn_loss(online, target, data, double=True, kind=kind)
    assert not nothing.loss.any()
    assert not nothing.gradient.any()


def test_seeds_in_a_stack_do_not_mix():
    online, target, data = network(3), network(3, first=20), batch(3)
    stacked = dqn_loss(online, target, data, double=True, kind="huber")
    for seed in range(3):
        alone = dqn_loss(
            QNetwork(online.flat[seed : seed + 1], SIZES),
            QNetwork(target.flat[seed : seed + 1], SIZES),
            part(data, slice(seed, seed + 1)),
            double=True,
            kind="huber",
        )
        assert torch.allclose(alone.gradient[0], stacked.gradient[seed], rtol=1e-5, atol=1e-7)


# --- replay -------------------------------------------------------------------------------------------------


def test_replay_draws_every_row_equally_often():
    made = Learner(8, 2, settings_of(buffer_size=50), [1, 2])
    numbered = transitions(50, 2)._replace(reward=torch.arange(50.0)[:, None].expand(50, 2))
    made.remember(numbered.packed())
    made.begin(0)
    drawn = made.sample(20_000)
    for rows in drawn.reward:
        counts = torch.bincount(rows.long(), minlength=50)
        chi_square = ((counts - 400) ** 2 / 400).sum()
        assert chi_square < 85.4  # 0.999 quantile with 49 degrees of freedom


def test_every_seed_draws_rows_of_its_own():
    made = learner((1, 2))
    made.begin(0)
    held, drawn = Transitions.unpacked(made.buffer[:]), made.sample(30)
    for seed in range(2):
        mine = set(held.reward[:, seed].tolist())
        assert set(drawn.reward[seed].tolist()) <= mine
        assert not set(drawn.reward[1 - seed].tolist()) & mine


def test_draws_are_named_by_the_epoch():
    one, other = learner((1,)), learner((1,))
    one.begin(0)
    first = one.sample(30)
    for each in (one, other):
        each.begin(1)
    assert torch.equal(one.sample(30).reward, other.sample(30).reward)
    one.begin(0)
    again = one.sample(30)
    assert torch.equal(first.reward, again.reward)
    assert not torch.equal(first.reward, other.sample(30).reward)


@pytest.mark.parametrize("shape", [(), (5,), (3, 2)])
def test_transitions_come_out_of_their_rows_as_they_went_in(shape):
    generator = torch.Generator().manual_seed(0)
    made = Transitions(
        torch.randn(*shape, 20, generator=generator),
        torch.randn(*shape, 20, generator=generator),
        torch.randint(1000, shape, generator=generator),
        torch.randn(shape, generator=generator),
        torch.rand(shape, generator=generator),
        torch.ones(shape),
    )
    for before, after in zip(made, Transitions.unpacked(made.packed()), strict=True):
        assert torch.equal(before, after)
        assert before.dtype == after.dtype


def settings_of(**changes):
    defaults = DQNSettings(batch_size=16, buffer_size=60, updates=2, hidden=[12, 12], learning_rate=0.01)
    return dataclasses.replace(defaults, **changes)


def transitions(rows, seeds, draw=0):
    return Transitions(*(values.transpose(0, 1) for values in batch(seeds, rows, draw)))


def learner(seeds=(0, 1, 2), **changes):
    made = Learner(8, 2, settings_of(**changes), list(seeds))
    made.remember(transitions(40, len(seeds)).packed())
    return made


def test_the_buffer_keeps_the_newest_transitions():
    made = learner((0,), buffer_size=60)
    newest = transitions(50, 1, draw=1)
    made.remember(newest.packed())
    assert len(made.buffer) == 60
    held = Transitions.unpacked(made.buffer[:]).reward
    assert torch.equal(held[40:60, 0], newest.reward[:20, 0])
    assert torch.equal(held[:30, 0], newest.reward[20:, 0])


def test_a_rollout_longer_than_the_buffer_leaves_its_newest_rows():
    made = learner((0,), buffer_size=7)
    long = transitions(40, 1, draw=1)
    made.remember(long.packed())
    held = Transitions.unpacked(made.buffer[:]).reward
    assert sorted(held[:, 0].tolist()) == sorted(long.reward[-7:, 0].tolist())


@pytest.mark.parametrize("more", [0, 50])
def test_a_refilled_buffer_goes_on_where_it_was(more):
    before, after = learner(), learner()
    if more:
        before.remember(transitions(more, 3, draw=2).packed())
    after.refill(before.buffer[:].clone(), before.buffer.writer.state_dict()["_cursor"])
    for each in (before, after):
        each.remember(transitions(9, 3, draw=3).packed())
    assert len(before.buffer) == len(after.buffer)
    assert torch.equal(before.buffer[:], after.buffer[:])


# --- learning -----------------------------------------------------------------------------------------------


def test_target_rate_one_means_one_network_for_both():
    made = learner(target_rate=1.0, average_rate=1.0)
    assert made.target is made.online
    assert made.played is made.online


def test_target_and_played_networks_follow_by_their_rates():
    made = learner(target_rate=0.1, average_rate=0.25, updates=1)
    target, played = made.target.flat.clone(), made.played.flat.clone()
    made.learn(lambda updates: 0.01)
    assert torch.allclose(made.target.flat, target + 0.1 * (made.online.flat - target))
    assert torch.allclose(made.played.flat, played + 0.25 * (made.online.flat - played))


def test_an_update_is_adams():
    made = learner((0,), updates=1)
    before = made.online.flat.clone()
    made.learn(lambda updates: 0.003)
    gradient = made.moments["exp_avg"] / 0.1
    step = made.online.flat - before  # Adam's first has the size of the rate wherever there is a slope
    moved = gradient.abs() > 1e-4
    assert moved.any()
    assert torch.allclose(step[moved], -0.003 * gradient[moved].sign(), rtol=1e-3)


def test_descending_is_what_torchs_optimiser_does():
    made, generator = learner((0, 1)), torch.Generator().manual_seed(0)
    twin = made.online.flat.clone().requires_grad_()
    optimiser = torch.optim.Adam([twin])
    for rate in (0.01, 0.003, 0.02):
        gradient = torch.randn(twin.shape, generator=generator)
        made.rate = optimiser.param_groups[0]["lr"] = rate
        made.descend(gradient)
        twin.grad = gradient.clone()
        optimiser.step()
    assert torch.allclose(made.online.flat, twin, rtol=1e-5, atol=1e-7)


def test_the_learning_rate_is_asked_for_at_every_update():
    asked = []
    made = learner(updates=3)
    made.learn(lambda updates: asked.append(updates) or 0.01)
    made.learn(lambda updates: asked.append(updates) or 0.01)
    assert asked == [0, 1, 2, 3, 4, 5]
    assert made.updates == 6


def test_a_seed_learns_the_same_alone_and_in_a_stack():
    options = {"double": True, "target_rate": 0.1, "average_rate": 0.2, "loss": "huber"}
    stack = learner((3, 4, 5), **options)
    alone = Learner(8, 2, settings_of(**options), [4])
    alone.remember(part(transitions(40, 3), slice(None), slice(1, 2)).packed())
    for each in (stack, alone):
        each.begin(0)
    for _ in range(5):
        stack.learn(lambda updates: 0.01)
        alone.learn(lambda updates: 0.01)
    np.testing.assert_allclose(alone.online.flat[0], stack.online.flat[1], rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(alone.played.flat[0], stack.played.flat[1], rtol=1e-3, atol=1e-5)


def test_learning_fits_what_it_is_shown():
    made = learner((0,), discount=0.0, updates=300, batch_size=40, hidden=[24, 24])
    first, _ = made.learn(lambda updates: 0.0 if updates == 0 else 0.01)
    last, _ = made.learn(lambda updates: 0.001)
    assert last < 0.2 * first
