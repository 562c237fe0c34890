"""The rollout and its random numbers: whoever plays a population's life plays the same one."""

import numpy as np
import pytest
import torch

from swarm.physics.starts import NOISE_BLOCK, Draws, draw_chance, draw_noise, draw_record_noise, draw_starts
from swarm.physics.world import World
from swarm.policies.policy import CarryingPolicy, Policy
from swarm.policies.strategies import Random, Swinging
from swarm.population.contest import population_test
from swarm.population.evaluation import evaluate
from swarm.population.noise import sweep_noise
from swarm.population.rollout import rollout

NOISY = {"concentration_noise": 0.1, "curvature_noise": 0.2, "rotational_diffusion": 0.01}


class Counting:
    """Swinging by counting its own decisions, in place of reading them off the clock."""

    def begin(self, world, state):
        return np.zeros(state.finished.shape, int)

    def act_carrying(self, world, state, uniform, carry):
        return Swinging.schedule(world)[carry % world.n_records], carry + 1


class Hesitant:
    """A random action, held on to with probability 0.7."""

    def begin(self, world, state):
        return np.zeros(state.finished.shape, int)

    def act_carrying(self, world, state, uniform, carry):
        action = np.where(uniform < 0.3, (uniform < 0.15).astype(int), carry)
        return action, action


def test_a_life_goes_from_its_start_to_the_end_of_the_last_cell():
    world = World(field="radial", varying_speed=True, life=200.0)
    starts = draw_starts(world, 9, 3)
    first, *rest = rollout(world, Random(), starts, 3)
    assert first.outcome is None
    np.testing.assert_array_equal(first.state.position, starts.position)
    for before, after in zip([first, *rest], rest, strict=False):
        np.testing.assert_array_equal(after.alive, ~before.state.finished)
    assert rest[-1].state.finished.all()
    assert not rest[-2].state.finished.all()


def test_every_decision_takes_the_random_numbers_of_its_block_and_episode():
    world = World(life=25.0, **NOISY)
    where = {"population": "validation", "episode": 2}
    starts = draw_starts(world, 4, 5, **where)
    state = world.start(*starts, noise=draw_record_noise(world, 4, 5, **where))
    played = list(rollout(world, Random(), starts, 5, population="validation", episode=2))
    assert len(played) > NOISE_BLOCK + 2
    for decision, moment in enumerate(played[1:]):
        block, turn = divmod(decision, NOISE_BLOCK)
        options = {"population": "validation", "episode": 2, "block": block}
        chance, noise = (draw(5, 4, NOISE_BLOCK, **options)[:, turn] for draw in (draw_chance, draw_noise))
        state, _ = world.step(state, Random().act(world, state, chance), noise)
        for ours, theirs in zip(moment.state[:6], state, strict=False):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("draw", [draw_chance, draw_noise])
@pytest.mark.parametrize("cells", [(6,), (6, 5), (6, 5, 2)], ids=str)
@pytest.mark.parametrize("seeds", [(3,), (0, 2**70, 1)], ids=str)
def test_draws_are_those_of_each_groups_seed_episode_and_decision(draw, cells, seeds):
    rng = np.random.default_rng(0)
    draws = Draws(draw, cells, seeds, population="training", dtype=np.float32)
    tensors = Draws(draw, cells, seeds, population="training", dtype=np.float32, place=torch.as_tensor)
    episode, decision = np.zeros(6, int), np.zeros(6, int)
    for _ in range(12):
        found = draws.at(episode, decision)
        each = 6 // len(seeds)
        for group in range(6):
            seed, place = seeds[group // each], group % each
            block, turn = divmod(int(decision[group]), NOISE_BLOCK)
            options = {"population": "training", "episode": int(episode[group]), "block": block}
            rows = draw(seed, each * int(np.prod(cells[1:])), NOISE_BLOCK, **options)[:, turn]
            expected = rows.reshape(each, *cells[1:], *rows.shape[1:])[place].astype(np.float32)
            np.testing.assert_array_equal(found[group], expected)
        np.testing.assert_array_equal(tensors.at(episode, decision).numpy(), found)
        some = rng.random(6) < 0.3
        episode, decision = episode + some, np.where(some, 0, decision + 30)


def test_a_policys_carry_is_handed_on_from_decision_to_decision_everywhere():
    world, counting = World(life=30.0, n_records=5, **NOISY), Counting()
    assert isinstance(counting, CarryingPolicy)
    assert not isinstance(counting, Policy)
    contest = {"counting": counting, "swinging": Swinging()}
    results = population_test(world, contest, cells=5, life=30.0, seed=3)
    counted, swung = (results.sel(policy=name, drop=True) for name in contest)
    assert counted.identical(swung)
    seen = [rollout(world, policy, draw_starts(world, 5, 3), 3) for policy in contest.values()]
    for one, other in zip(*seen, strict=True):
        np.testing.assert_array_equal(one.state.position, other.state.position)
    done = evaluate(counting, world, experiment="own", cells=5, life=30.0, seed=3)
    assert done.summary["policy"] == "counting"
    np.testing.assert_array_equal(done.results["gain"].sel(policy="counting"), swung["gain"])
    swept = [sweep_noise(one, world, (0.1, 0.4), cells=5, life=30.0, seed=3) for one in contest.values()]
    np.testing.assert_array_equal(swept[0].results["cell_gain"][:, 0], swept[1].results["cell_gain"][:, 0])


def test_a_carry_belongs_to_one_population_and_uses_its_own_random_numbers():
    world, policy = World(life=40.0), Hesitant()
    starts = draw_starts(world, 6, 1)
    alone = [moment.state.position for moment in rollout(world, policy, starts, 1)]
    twice = zip(rollout(world, policy, starts, 1), rollout(world, policy, starts, 2), strict=True)
    together = [(one.state.position, other.state.position) for one, other in twice]
    np.testing.assert_array_equal(alone, [one for one, _ in together])
    assert not np.array_equal(alone[-1], together[-1][1])
