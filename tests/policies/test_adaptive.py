"""The adaptive cell: its response, sampled and continuous, on every array library and under noise.

Its drift and its way against exact ones are held in tests/physics/test_exact.py.
"""

import numpy as np
import pytest

from swarm._support import streams
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.adaptive import Adaptation, AdaptiveSteering
from swarm.policies.strategies import Greedy
from swarm.population.contest import population_test
from swarm.population.contests import contest
from swarm.population.evaluation import evaluate
from swarm.population.rollout import rollout
from tests.reference import array, to_numpy

STEERINGS = [{}, {"mode": "on_off"}, {"clip": False}, {"gain": (40.0, 320.0), "decision": 25.0}]


def carried(state, xp=np):
    """A carry (2, cells) that is somewhere."""
    draw = np.random.default_rng(0)
    shape = state.finished.shape
    return Adaptation(*(array(xp, mean + 0.01 * draw.normal(size=shape)) for mean in (1.0, -3.0, 0.0)))


@pytest.mark.parametrize("options", STEERINGS, ids=str)
def test_sampled_steering_is_the_same_on_every_array_library(xp, options):
    world, policy = World(curvatures=(3.0, 4.0, 5.0), varying_speed=True), AdaptiveSteering(**options)
    starts = draw_starts(world, 6, 1)
    two = [np.stack([part, part[::-1]]) for part in starts]
    expected = None
    for library in (np, xp):
        state = world.start(*(array(library, part) for part in two))
        first = policy.begin(world, state)
        np.testing.assert_allclose(
            np.exp(to_numpy(first.sensitivity)) * to_numpy(state.memory)[..., 0].mean(-1), 4
        )
        found = policy.act_carrying(world, state, None, carried(state, library))
        flat = [to_numpy(part) for part in (found[0], *found[1])]
        expected = expected or flat
        for one, other in zip(flat, expected, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-12)


def test_at_a_constant_signal_the_cell_adapts_and_swims_a_circle():
    world = World(field={"type": "linear", "gradient_scale": 1e-9}, life=4.0)
    policy = AdaptiveSteering(continuous=True, clip=False)
    *_, last = rollout(world, policy, draw_starts(world, 3, 0), 0)
    np.testing.assert_allclose(world.curvature(last.state), world.mean_curvature, atol=1e-6)


def test_many_samples_steer_as_continuously():
    many = World(n_records=32, curvatures=tuple(np.linspace(3, 5, 33)), interval_rule="exact", life=4.0)
    found = population_test(
        many,
        {
            "often": AdaptiveSteering(0.75, 0.25, 100.0),
            "always": AdaptiveSteering(0.75, 0.25, 100.0, continuous=True),
        },
        cells=4,
        record=False,
        limit=False,
        life=4.0,
    )["gain"]
    np.testing.assert_allclose(found.sel(policy="often"), found.sel(policy="always"), atol=0.1)


def test_two_curvatures_take_turns_so_that_on_average_the_wanted_one_is_swum():
    world, policy = World(), AdaptiveSteering(gain=0.5)
    state = world.start(*draw_starts(world, 5, 0))
    carry = policy.begin(world, state)
    actions = []
    for _ in range(40):  # a stays near 1: 4, between the two
        action, carry = policy.act_carrying(world, state, None, carry)
        actions.append(action)
    np.testing.assert_allclose(np.mean(actions, axis=0), 0.5, atol=0.05)


@pytest.mark.parametrize("life", [0.3, 4.1])
@pytest.mark.parametrize("field", ["linear", "radial"])
def test_a_continuous_life_ends_when_any_other_does(life, field):
    world, policy = World(field=field, life=life), AdaptiveSteering(mode="on_off", continuous=True)
    found = population_test(world, {"a": policy}, cells=5, life=life)
    free = ~found["arrived"]
    np.testing.assert_allclose(found["lifetime"].where(free), life * free.where(free), rtol=1e-12)
    assert ((found["curvature"] >= 3 - 1e-6) & (found["curvature"] <= 5 + 1e-6)).sel(policy="a").sum() > 0
    assert (found["lifetime"] > 0).all()


@pytest.mark.parametrize(
    "noise",
    [
        {"binding_rate": 50.0},
        {"concentration_noise": 0.1},
        {"rotational_diffusion": 0.01},
        {"curvature_noise": 0.2},
    ],
    ids=str,
)
@pytest.mark.parametrize("continuous", [True, False])
def test_every_noise_reaches_the_cell_and_repeats(noise, continuous):
    policy = {"a": AdaptiveSteering(continuous=continuous)}
    still, noisy, again = (
        population_test(World(**words), policy, cells=2, life=3.0, seed=2, limit=False)
        for words in ({}, noise, noise)
    )
    assert noisy["gain"].identical(again["gain"])
    assert (np.abs(noisy["gain"] - still["gain"]) > 1e-9).sel(policy="a").all()


def test_divided_numbers_are_even_and_independent():
    parents = np.random.default_rng(0).random(20_000)
    first, second = (streams.divided(parents, number) for number in (0, 1))
    for numbers in (first, second):
        assert ((numbers >= 0) & (numbers < 1)).all()
        assert np.abs(np.histogram(numbers, 10, (0, 1))[0] / 2000 - 1).max() < 0.1
    assert np.abs(np.corrcoef([parents, first, second])[np.triu_indices(3, 1)]).max() < 0.03


def test_the_gain_is_decided_by_the_level_that_the_cell_has_adapted_to():
    world, policy = World(), AdaptiveSteering(gain=(1.0, 2.0), decision=25.0)
    found = policy.gain_at(world, -np.log(np.array([20.0, 24.9, 25.1, 30.0])))
    assert found.tolist() == [1.0, 1.0, 2.0, 2.0]


def test_it_stands_in_the_same_tables_and_races_sampled():
    done = evaluate("adaptive_on_off", World(), experiment="own", cells=8, life=60.0)
    assert done.summary["gain"]["fraction_of_limit"] > 0.8
    assert done.label == "adaptive_on_off"
    race = World(field="radial", first_arrivals=1, start_box=((-3, 3), (-3, 3)), life=30.0)
    assert (
        contest(race, {"a": AdaptiveSteering(mode="on_off"), "b": Greedy()}, cells=4, worlds=2)["won"].sum()
        > 0
    )
    with pytest.raises(ValueError, match="policy 'a' must take actions in a contest"):
        contest(race, {"a": AdaptiveSteering(continuous=True), "b": Greedy()}, cells=4, worlds=2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"relaxation": 0.0}, "relaxation must be a finite number above 0, got 0.0"),
        ({"gain": (1.0, -2.0), "decision": 3.0}, "gain must be a number above 0, or two, got"),
        ({"gain": (1.0, 2.0)}, "decision must go with two gains, got None"),
        ({"decision": 2.0}, "decision must go with two gains, got 2.0 with gain=None"),
        ({"mode": "onoff"}, "did you mean 'on_off'"),
        ({"gain": (1, 2), "decision": 3, "mode": "on_off"}, "decision must go with mode='linear', got 3"),
    ],
    ids=str,
)
def test_parameters_have_rules(options, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        AdaptiveSteering(**options)


def test_what_would_never_end_or_divide_by_zero_is_an_error():
    with pytest.raises(ValueError, match="relaxation and adaptation must leave at most 100000 steps"):
        population_test(World(), {"a": AdaptiveSteering(relaxation=1e-9)}, cells=3, life=2.0)
    with pytest.raises(ValueError, match="level must be a finite number above 0, got 0"):
        AdaptiveSteering().drift(World(), 0.0)


@pytest.mark.parametrize("options", [{"varying_speed": True}, {"interactions": ["contact"]}], ids=str)
def test_continuous_steering_needs_a_world_that_it_can_swim_in(options):
    policy = {"a": AdaptiveSteering(continuous=True)}
    with pytest.raises(ValueError, match="continuous steering must be in a world of one speed"):
        population_test(World(**options), policy, cells=3, life=2.0)
