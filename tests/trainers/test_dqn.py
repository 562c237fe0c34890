"""Deep Q-learning: lean parts against TorchRL's own, returns, stacks of seeds, compiled updates."""

from __future__ import annotations

import itertools

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Categorical, MultiStep
from torchrl.modules import QValueActor
from torchrl.objectives import DQNLoss, SoftUpdate

from tests.short_runs import short_settings
from tests.trainers.test_networks import network, stock
from tests.trainers.test_replay import transitions
from trainers.algorithms.base import learner_of
from trainers.algorithms.collector import training_env
from trainers.algorithms.dqn import FusedSoftUpdate, SeedDQNLoss, q_error
from trainers.algorithms.networks import SeedLinear
from trainers.algorithms.replay import returns

SIZES, DISCOUNT = (8, 24, 24, 2), 0.98
KINDS = {"squared": "l2", "huber": "smooth_l1"}


def loss_of(seeds=1, *, double=True, delay_value=True, kind="huber"):
    """A loss whose target network differs from the online one where there are two."""
    options = {"error": q_error, "gamma": DISCOUNT, "double": double, "loss_function": KINDS[kind]}
    made = SeedDQNLoss(network(SIZES, seeds), delay_value=delay_value, **options)
    if delay_value:
        FusedSoftUpdate(made, tau=0.1)  # without one, TorchRL warns
        made.target_network.load_state_dict(network(SIZES, seeds, first=30).state_dict())
    return made


def actor_of(module):
    """TorchRL's actor around a network."""
    return QValueActor(module, spec=Categorical(2), in_keys=["observation"], action_space="categorical")


def slopes(module):
    """Gradients of every tensor of a network, as (inputs, outputs) and (outputs,)."""
    for layer in module:
        if isinstance(layer, SeedLinear):
            yield from (layer.weight.grad[0], layer.bias.grad[0, 0])
        elif isinstance(layer, torch.nn.Linear):
            yield from (layer.weight.grad.T, layer.bias.grad)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("double", "delay_value"), [(False, False), (False, True), (True, True)])
def test_loss_and_gradient_are_those_of_torchrl(kind, double, delay_value):
    """With terminations, truncations, returns over several decisions, and cells that were not alive."""
    ours, batch = loss_of(double=double, delay_value=delay_value, kind=kind), transitions(1, 64)
    module = stock(ours.value_network, 0)
    theirs = DQNLoss(
        actor_of(module),
        action_space="categorical",
        loss_function=KINDS[kind],
        delay_value=delay_value,
        double_dqn=double,
    )
    theirs.make_value_estimator(gamma=DISCOUNT)
    if delay_value:
        SoftUpdate(theirs, eps=0.5)  # without one, TorchRL warns
        target = TensorDict.from_module(actor_of(stock(ours.target_network, 0)))
        theirs.target_value_network_params.data.update_(target.data)
    truncated = torch.rand(64, 1, generator=torch.Generator().manual_seed(5)) < 0.3
    row = TensorDict(batch, (1, 64))[0]
    row["next", "done"] = row["next", "terminated"] | truncated
    expected, found = theirs(row)["loss"], ours(batch)
    assert found["loss"].item() == pytest.approx(expected.item(), rel=1e-5)
    expected.backward()
    found["loss"].sum().backward()
    for one, other in zip(slopes(ours.value_network), slopes(module), strict=True):
        assert torch.allclose(one, other, rtol=1e-4, atol=1e-6)
    chosen = module(batch["observation"][0]).gather(-1, batch["action"][0, :, None])
    alive = batch["collector", "mask"][0]
    assert found["chosen_action_value"].item() == pytest.approx(chosen[alive].mean().item(), rel=1e-5)


def test_cells_that_were_not_alive_count_for_nothing():
    ours, batch = loss_of(2), transitions(2, 64)
    batch["collector", "mask"] = torch.arange(64).expand(2, 64) < 40
    whole = ours({key: value[:, :40] for key, value in batch.items()})
    batch["next", "reward"][:, 40:] = torch.inf
    assert torch.allclose(whole["loss"], ours(batch)["loss"], rtol=1e-5)
    batch["collector", "mask"] = torch.zeros(2, 64) > 0
    nothing = ours(batch)["loss"]
    nothing.sum().backward()
    assert not nothing.any()
    assert not any(parameter.grad.any() for parameter in ours.value_network.parameters())


def test_the_target_network_follows_as_torchrls():
    both = []
    for updater in (SoftUpdate, FusedSoftUpdate):
        made = loss_of(3)
        follow = updater(made, tau=0.1)
        made.value_network.load_state_dict(network(SIZES, 3, first=7).state_dict())
        follow.step()
        both.append(made.target_network.state_dict())
    one, other = both
    torch.testing.assert_close(one, other, rtol=1e-6, atol=0.0)
    assert not torch.equal(other["0.weight"], made.value_network.state_dict()["0.weight"])


# --- returns over several decisions -------------------------------------------------------------------------


def rollout(reward, ended, alive, observation):
    """A rollout (decisions, cells)."""
    following = {"reward": reward, "terminated": ended, "observation": observation}
    made = {("next", name): part.unsqueeze(-1) for name, part in following.items()}
    return made | {("collector", "mask"): alive}


@pytest.mark.parametrize("terminated", [False, True])
def test_returns_end_with_the_life(terminated):
    reward, alive = torch.tensor([[1.0], [2.0], [0.0]]), torch.tensor([[True], [True], [False]])
    ends = torch.tensor([[False], [terminated], [False]])
    observation = torch.tensor([[1.0], [2.0], [3.0]])
    found = returns(rollout(reward, ends, alive, observation), 0.5, 3)
    keys = (("next", "reward"), ("next", "observation"), "steps_to_next_obs", ("next", "terminated"))
    total, reached, steps, ended = (found[key].flatten().tolist()[:2] for key in keys)
    assert (total, reached, steps) == ([2.0, 2.0], [2.0, 2.0], [2, 1])
    assert ended == [terminated, terminated]


def test_returns_are_those_of_torchrl():
    generator = torch.Generator().manual_seed(0)
    reward, observation = (torch.randn(6, 5, generator=generator) for _ in range(2))
    ends = torch.rand(6, 5, generator=generator) < 0.15
    alive = torch.cat([torch.ones(1, 5), (~ends).cumprod(0)[:-1]]) > 0
    found = returns(rollout(reward, torch.zeros_like(ends), alive, observation), 0.9, 3)
    following = {"observation": observation, "reward": reward, "done": ends, "terminated": ends}
    rows = {
        "next": {name: part.T.unsqueeze(-1) for name, part in following.items()},
        "collector": {"mask": alive.T},
    }
    theirs = MultiStep(gamma=0.9, n_steps=3)(TensorDict(rows, (5, 6)))
    for key in (("next", "reward"), ("next", "observation"), "steps_to_next_obs"):
        expected = theirs[key].reshape(5, 6).T
        assert torch.allclose(found[key].squeeze(-1)[alive], expected[alive].float(), atol=1e-6)


def begun(settings):
    """An algorithm, whose first lives have begun."""
    env = training_env(settings, settings.learning.n_worlds, settings.learning.n_swimmers)
    env.restart()
    made = learner_of(settings)(env, settings)
    made.begin(0)
    return made


@pytest.mark.parametrize("rounds", [(100,), (1,), (2, 3), (7, 1, 30)], ids=str)
@pytest.mark.parametrize("radial", [False, True], ids=["all live as long", "some arrive"])
def test_returns_cross_the_rounds_of_collecting(rounds, radial):
    box = [[-1.5, 1.5], [-1.5, 1.5]]
    world = {"field": "radial", "start_box": box} if radial else {}
    learning = {"n_swimmers": 30, "n_steps": 3, "buffer_size": 10_000, "updates": 1}
    kept = []
    for counts in ((1000,), rounds):
        made = begun(short_settings(world=world, learning=learning))
        made.explorer.epsilon = 1.0
        for decisions in itertools.cycle(counts):
            made.remember(made.collector.collect(decisions))
            if made.env.all_finished():
                break
        kept.append(made.buffer.rows.clone())
    assert torch.equal(*kept)


def test_a_new_life_takes_nothing_over_from_one_that_was_left():
    kept = []
    for decisions in (0, 5):
        made = begun(short_settings(learning={"n_steps": 3}))
        if decisions:
            made.remember(made.collector.collect(decisions))
            made.buffer.buffer.empty()
        made.env.set_seeds([3])
        made.env.restart()
        made.begin(0)
        made.learn(made.collect(0.0), 0.0)
        kept.append(made.buffer.rows.clone())
    assert torch.equal(*kept)


# --- learning -----------------------------------------------------------------------------------------------


def taught(settings, rounds=3):
    made = begun(settings)
    for _ in range(rounds):
        made.learn(made.collect(0.0), 0.0)
    return made


def test_a_target_rate_of_one_means_one_network_and_the_learning_rate_is_that_of_every_update():
    made = begun(short_settings("paper", learning={"updates": 3, "collect": 2}))
    assert made.loss.target_network is made.policy
    assert made.follow is None
    rates, update = [], made.update
    made.update = lambda batch: rates.append(made.optimiser.param_groups[0]["lr"]) or update(batch)
    for _ in range(2):
        made.learn(made.collect(0.0), 0.0)
    assert rates == pytest.approx([0.01 / (1 + 0.1 * updates) for updates in range(6)])
    assert made.updates == 6


def test_draws_are_named_by_the_epoch():
    made, other = (taught(short_settings()) for _ in range(2))
    found = []
    for each, epoch in ((made, 1), (other, 1), (made, 0), (made, 1)):
        each.begin(epoch)
        found.append(next(each.buffer.batches(1, 30, each.draws))["observation"])
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])
    assert torch.equal(found[0], found[3])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("recipe", "learning"),
    [("swarm", {}), ("paper", {}), ("drqn", {"collect": 1, "burn_in": 1})],
    ids=["swarm", "paper", "drqn"],
)
def test_a_compiled_update_is_the_stock_one(recipe, learning):
    plain, compiled = (
        taught(short_settings(recipe, n_seeds=2, compile=how, learning={"n_steps": 2, **learning}))
        for how in ("never", "always")
    )
    assert compiled.update != compiled._update
    torch.testing.assert_close(compiled.tensors(), plain.tensors(), rtol=1e-4, atol=1e-6)
