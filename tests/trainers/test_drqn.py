"""Deep recurrent Q-learning: the GRU against TorchRL's, sequences and what is learnt from them, runs."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from torchrl.modules import GRUModule

from tests.short_runs import short_settings
from tests.trainers.test_dqn import begun
from trainers.algorithms.drqn import sequence_error
from trainers.algorithms.networks import RecurrentMLP, SeedGRU
from trainers.algorithms.replay import unpacked
from trainers.settings.composition import SettingsError
from trainers.training.run import prepare


def test_values_and_gradients_are_those_of_torchrls_gru_module():
    gru = SeedGRU(4, 5, seeds=2)
    torch.manual_seed(0)
    for parameter in gru.parameters():
        torch.nn.init.normal_(parameter)
    seen, first, weights = torch.randn(2, 7, 3, 4), torch.randn(2, 3, 5), torch.randn(2, 7, 3, 5)
    found = gru(seen, first)
    (found * weights).sum().backward()
    for place in range(2):
        keys = {"in_keys": ["seen", "hidden", "is_init"], "out_keys": ["states", ("next", "hidden")]}
        stock = GRUModule(input_size=4, hidden_size=5, default_recurrent_mode=True, **keys)
        for name, parameter in stock.gru.named_parameters():
            mine = getattr(gru, name.removesuffix("_l0"))[place]
            parameter.data = (mine.T if "weight" in name else mine[0]).detach().clone()
        hidden = torch.zeros(3, 7, 1, 5)
        hidden[:, 0, 0] = first[place]
        data = {"seen": seen[place].transpose(0, 1), "hidden": hidden, "is_init": torch.zeros(3, 7, 1).bool()}
        states = stock(TensorDict(data, (3, 7)))["states"].transpose(0, 1)
        torch.testing.assert_close(found[place], states)
        (states * weights[place]).sum().backward()
        for name, parameter in stock.gru.named_parameters():
            mine = getattr(gru, name.removesuffix("_l0")).grad[place]
            torch.testing.assert_close(
                mine.T if "weight" in name else mine[0], parameter.grad, rtol=1e-4, atol=1e-4
            )


@pytest.mark.parametrize("burn_in", [0, 2, 5])
def test_every_decision_is_learnt_once_from_the_hidden_state_that_it_was_taken_in(burn_in):
    learning = {"burn_in": burn_in, "n_steps": 2, "buffer_size": 1000, "seen": 3}
    made = begun(short_settings("drqn", n_seeds=2, learning=learning))
    rollouts = []
    while not made.env.all_finished():
        rollouts.append(made.collect(0.0))
        made.remember(rollouts[-1])
    lives = torch.cat(rollouts)
    held = unpacked(made.buffer.rows.transpose(0, 1), made.buffer.layout)  # (seeds, rounds · cells, ...)
    learnt = {key: part.unflatten(1, (len(rollouts), 5)) for key, part in held.items()}
    mask, first = learnt["collector", "mask"], 0
    assert mask.sum() == lives["collector", "mask"].sum()
    for number, rollout in enumerate(rollouts):
        old, count = min(first, burn_in), len(rollout)
        row = {key: part[:, number] for key, part in learnt.items()}
        assert not row["collector", "mask"][..., :old].any()
        assert row["collector", "mask"][..., old : old + count].all()
        torch.testing.assert_close(row["hidden"], lives["hidden"][first - old])
        with torch.no_grad():
            states = made.policy.memory(row["seen"].transpose(1, 2), row["hidden"])
        if number + 1 < len(rollouts):
            torch.testing.assert_close(states[:, old + count - 1], lives["hidden"][first + count])
        expected = lives["next", "reward"][first : first + count, ..., 0].clone()
        expected[:-1] += 0.98 * lives["next", "reward"][first + 1 : first + count, ..., 0]
        torch.testing.assert_close(
            row["next", "reward"][:, :, old : old + count, 0], expected.permute(1, 2, 0)
        )
        first += count


@pytest.mark.parametrize("double", [False, True])
def test_the_loss_of_sequences_is_that_of_their_values_one_by_one(double):
    online, target = (RecurrentMLP((4, 6, 2), 2, [[key], [key + 1]]) for key in (0, 7))
    torch.manual_seed(1)
    batch = {
        "seen": torch.randn(1, 3, 6, 4),
        "hidden": torch.randn(1, 3, 6),
        "action": torch.randint(2, (1, 3, 5)),
        "steps_to_next_obs": torch.tensor([2.0, 2, 2, 2, 1]).expand(1, 3, 5).unsqueeze(-1),
        ("collector", "mask"): torch.rand(1, 3, 5) < 0.7,
        ("next", "reward"): torch.randn(1, 3, 5, 1),
        ("next", "terminated"): torch.rand(1, 3, 5, 1) < 0.3,
    }
    values, others = (each(batch["seen"].transpose(1, 2), batch["hidden"])[0][0] for each in (online, target))
    losses = []
    for row, step in batch["collector", "mask"][0].nonzero().tolist():
        reached = step + int(batch["steps_to_next_obs"][0, row, step])
        best = others[reached, row, (values if double else others)[reached, row].argmax()]
        goes_on = 1 - batch["next", "terminated"][0, row, step, 0].float()
        goal = batch["next", "reward"][0, row, step, 0] + 0.9 ** (reached - step) * goes_on * best.detach()
        losses.append((values[step, row, batch["action"][0, row, step]] - goal) ** 2)
    found, _ = sequence_error(online, target, batch, gamma=0.9, double=double, loss_function="l2")
    torch.testing.assert_close(found[0], torch.stack(losses).mean())


def test_it_shows_no_more_records_than_there_are():
    with pytest.raises(SettingsError, match=r"learning\.seen must be at most world\.n_records, 4, got 5"):
        prepare(short_settings("drqn", learning={"seen": 5}))
