"""Replay: what goes in comes out, the newest is kept, every seed draws its own."""

from __future__ import annotations

import pytest
import torch

from trainers.algorithms import replay
from trainers.algorithms.replay import SeedReplay, packed, unpacked

INPUTS = 8
LAYOUT = replay.transitions(INPUTS)


def transitions(*shape, draw=0, actions=2):
    """Transitions (...) of any leading axes."""
    generator = torch.Generator().manual_seed(draw)

    def normal(size):
        return torch.randn(*shape, size, generator=generator)

    return {
        "observation": normal(INPUTS),
        "action": torch.randint(actions, shape, generator=generator),
        "steps_to_next_obs": torch.randint(1, 4, (*shape, 1), generator=generator).float(),
        ("collector", "mask"): torch.rand(shape, generator=generator) < 0.9,
        ("next", "observation"): normal(INPUTS),
        ("next", "reward"): normal(1),
        ("next", "terminated"): torch.rand(*shape, 1, generator=generator) < 0.2,
    }


def filled(seeds=1, size=60, rows=40):
    made = SeedReplay(size, LAYOUT, seeds)
    made.extend(transitions(1, seeds, rows), 1)
    return made


def drawn(made, rows, *seeds):
    """A batch of so many rows, drawn by generators with these seeds."""
    return next(made.batches(1, rows, [torch.Generator().manual_seed(seed) for seed in seeds]))


def rewards(replay):
    """(rows, seeds) of what is kept."""
    return unpacked(replay.rows, LAYOUT)["next", "reward"].squeeze(-1)


@pytest.mark.parametrize("shape", [(5,), (3, 2)])
def test_transitions_come_out_of_their_rows_as_they_went_in(shape):
    made = transitions(*shape, actions=1000)
    found = unpacked(packed(made, LAYOUT), LAYOUT)
    assert found.keys() == made.keys()
    for key, value in made.items():
        assert torch.equal(value, found[key])
        assert value.dtype == found[key].dtype


def test_batches_hold_rows_that_were_put_in():
    replay, made = filled(2), transitions(1, 2, 40)
    batches = list(replay.batches(3, 5, [torch.Generator().manual_seed(seed) for seed in range(2)]))
    assert len(batches) == 3
    for batch in batches:
        assert {key: value.shape[:2] for key, value in batch.items()} == dict.fromkeys(made, (2, 5))
        for seed in range(2):
            for row in range(5):
                same = made["next", "reward"][0, seed, :, 0] == batch["next", "reward"][seed, row, 0]
                place = same.nonzero()[0, 0]
                assert all(torch.equal(made[key][0, seed, place], batch[key][seed, row]) for key in made)


def test_every_row_is_drawn_equally_often():
    replay = SeedReplay(50, LAYOUT, 2)
    numbered = transitions(1, 2, 50) | {("next", "reward"): torch.arange(50.0).expand(1, 2, 50).unsqueeze(-1)}
    replay.extend(numbered, 1)
    for rows in drawn(replay, 20_000, 1, 2)["next", "reward"]:
        counts = torch.bincount(rows[:, 0].long(), minlength=50)
        assert ((counts - 400) ** 2 / 400).sum() < 85.4  # χ², 0.999 quantile with 49 degrees of freedom


def test_every_seed_draws_by_its_own_generator():
    replay, same = SeedReplay(60, LAYOUT, 3), transitions(1, 1, 40)
    replay.extend({key: value.expand(1, 3, *value.shape[2:]) for key, value in same.items()}, 1)
    one, other, another = drawn(replay, 30, 5, 5, 6)["next", "reward"]
    assert torch.equal(one, other)
    assert not torch.equal(one, another)


@pytest.mark.parametrize("rows", [20, 60, 150])
def test_the_newest_transitions_are_kept(rows):
    replay, newest = filled(size=60, rows=40), transitions(1, 1, rows, draw=1)
    before = rewards(replay).clone()
    replay.extend(newest, 1)
    everything = torch.cat([before[:, 0], newest["next", "reward"].flatten()])
    assert sorted(rewards(replay)[:, 0].tolist()) == sorted(everything[-60:].tolist())


@pytest.mark.parametrize("rows", [40, 90])
def test_a_refilled_buffer_goes_on_where_it_was(rows):
    before, after = filled(3, rows=rows), filled(3, rows=7)
    after.refill(before.rows.clone(), before.cursor, n_actions=2)
    for each in (before, after):
        each.extend(transitions(1, 3, 9, draw=3), 1)
    assert torch.equal(before.rows, after.rows)
    assert before.cursor == after.cursor
