"""Contests: whom each cell is steered by, what each policy sees, and what share of the wins it has."""

import numpy as np
import pytest
from scipy.stats import beta

import swarm
from swarm._support import streams
from swarm.physics.fields import RadialField
from swarm.physics.perception import Memory
from swarm.physics.world import World
from swarm.policies.policy_file import PolicyError
from swarm.policies.strategies import Greedy, Random, Swinging
from swarm.population.contest import population_test
from swarm.population.contests import contest, table
from swarm.population.statistics import share_interval
from tests.policies.test_network import CARD, make

RACE = World(field=RadialField(), life=60, first_arrivals=1, start_box=((-4, 4), (-4, 4)))


@pytest.mark.parametrize(
    ("cells", "shares", "counts", "turn"),
    [
        (8, None, (4, 4), 2),
        (8, {"a": 1, "b": 3}, (2, 6), 4),
        (5, {"a": 0.4, "b": 0.6}, (2, 3), 5),
        (7, None, (4, 3), 7),
        (6, {"a": 0.01, "b": 0.2, "c": 0.79}, None, None),
        (6, {"a": 1, "b": 2, "c": 3}, (1, 2, 3), 6),
    ],
    ids=str,
)
def test_every_policy_has_had_every_start_as_often_as_its_share_says(cells, shares, counts, turn):
    players = {name: Random() for name in shares or "ab"}
    if counts is None:
        with pytest.raises(ValueError, match="shares must leave every policy a cell of 6"):
            contest(RACE, players, shares, cells=cells)
        return
    results = contest(RACE.replace(life=1), players, shares, cells=cells, worlds=2 * turn)
    steered = results["steered_by"].values
    for i, count in enumerate(counts):
        assert ((steered == i).sum(axis=1) == count).all()
        for rows in (slice(None, turn), slice(turn, None)):
            assert ((steered[rows] == i).sum(axis=0) * cells == count * turn).all()
    np.testing.assert_array_equal(results["turn"], np.repeat([0, 1], turn))
    np.testing.assert_array_equal(results["crowd"] * cells, counts)


def test_policies_that_do_the_same_live_the_lives_of_a_crowd_and_share_the_wins():
    results = contest(RACE, {"a": Greedy(), "b": Greedy()}, cells=6, worlds=40, seed=3)
    for turn in range(3):
        crowd = population_test(RACE, {}, cells=6, life=60, seed=3, episode=turn)
        for world in (2 * turn, 2 * turn + 1):
            np.testing.assert_array_equal(results["gain"][world], crowd["gain"].sel(policy="greedy"))
    assert results["won"].values.tolist() == [0.5, 0.5]  # each start is each policy's once
    assert results["winner"].sum() == 40


EATING = {"box": ((-6, 6), (-6, 6)), "shape": (64, 64), "uptake": 0.1, "decay": 0.01}


@pytest.mark.parametrize("options", [{"concentration_noise": 0.1}, {"medium": EATING}], ids=str)
def test_many_worlds_are_lived_a_few_at_a_time(monkeypatch, options):
    world, players, told = RACE.replace(life=4, **options), {"a": Random(), "b": Swinging()}, []
    whole = contest(world, players, cells=6, worlds=10, seed=1)
    monkeypatch.setattr(streams, "BLOCK", 25)
    assert contest(world, players, cells=6, worlds=10, seed=1, progress=told.append).identical(whole)
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0, 1)
    monkeypatch.setattr("swarm.population.contests.KEPT", 1e15)
    with pytest.raises(ValueError, match=r"cells × worlds must be fewer, got 6 × 10: .* GiB of memory"):
        contest(world, players, cells=6, worlds=10)


def test_the_better_policy_wins_and_the_table_says_so():
    results = contest(
        RACE, {"swinging": Swinging(), "greedy": Greedy()}, {"swinging": 3, "greedy": 1}, cells=8
    )
    low, high = results["won_interval"].sel(policy="greedy").values
    assert 0.25 < low < results["won"].sel(policy="greedy") <= high
    shown = table(results)
    assert [row[:2] for row in shown.rows] == [["greedy", "25.0%"], ["swinging", "75.0%"]]
    assert sum(row[4] for row in shown.rows) == int(results["winner"].sum())


class Counting:
    """Carries how often it has decided; what it chooses depends on that."""

    def begin(self, world, state):
        return np.zeros(state.clock.shape, int)

    def act_carrying(self, world, state, uniform, carry):
        return carry // 3 % 2, carry + 1


def test_a_carry_goes_from_decision_to_decision():
    class Timed:
        def act(self, world, state, uniform):
            return state.clock // world.interval_ticks[0] // 3 % 2

    one, other = (
        contest(RACE, {"a": each, "b": Greedy()}, cells=4, worlds=4) for each in (Counting(), Timed())
    )
    np.testing.assert_array_equal(one["gain"], other["gain"])


class Straight:
    """Always turns alike, and keeps what it was shown."""

    def __init__(self, sensor):
        self.sensor, self.seen = sensor, []

    def act(self, world, state, uniform):
        self.seen.append(world.observation(state))
        return 0 * state.clock


def test_each_policy_sees_what_its_own_sensor_records():
    world = RACE.replace(flow="taylor_green", spread={"speed": 0.1}, sensor="memory_with_flow", life=9)
    sensors = {
        "own": None,
        "plain": Memory(),
        "traits": "memory_with_traits",
        "others": {"type": "memory_with_neighbours", "k": 2, "range": 5.0},
    }
    mixed = {name: Straight(each) for name, each in sensors.items()}
    contest(world, mixed, cells=4, worlds=4)
    for name, sensor in sensors.items():
        alone = [Straight(None), Straight(None)]
        contest(
            world if sensor is None else world.replace(sensor=sensor),
            dict(zip("ab", alone, strict=True)),
            cells=4,
            worlds=4,
        )
        seen, expected = np.array(mixed[name].seen), np.array(alone[0].seen)
        np.testing.assert_array_equal(
            seen[:, 0], expected[:, 0]
        )  # of the first world, whose start is the same
        assert seen.shape[1:3] == (4, 4)


def test_networks_are_shown_the_sensors_of_their_cards():
    blind, seeing = make(), make(20, 6, 2, card={**CARD, "features": 5, "sensor": "memory_with_flow"})
    world = RACE.replace(flow="taylor_green")
    results = contest(world, {"blind": blind, "seeing": seeing}, cells=4, worlds=2)
    assert results.sizes == {"policy": 2, "bound": 2, "world": 2, "cell": 4}


def sensing(sensor, features):
    """A network that reads so many numbers of a sensor in each record."""
    return make(4 * features, 2, card={**CARD, "features": features, "sensor": sensor})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"world": World()}, "contest must be in a world with first_arrivals"),
        ({"policies": {"a": Greedy()}}, "policies must be at least two"),
        ({"shares": {"a": 1, "c": 1}}, "shares must be of a, b, got a, c"),
        ({"shares": {"a": 0, "b": 1}}, "share of 'a' must be a finite number above 0"),
        ({"worlds": 3}, r"worlds must be a multiple of 2, so that .* \(2, 2\) of 4 cells, got 3"),
        (
            {"policies": {"a": Greedy(), "b": make(20, 2, card={**CARD, "features": 5})}},
            "policy 'b' must be able",
        ),
        ({"policies": {"a": Greedy(), "b": make(12, 2, card={**CARD, "n_records": 6})}}, "n_records = 6"),
        *(
            ({"policies": {"a": Greedy(), "b": network}, "worlds": 10**9}, f"policy 'b' must .*: {rule}, got")
            for network, rule in (
                (sensing("memory_with_traits", 4), "sensor memory_with_traits must go with .* a spread"),
                (sensing("memory_with_flow", 5), "sense_flow must go with a flow .*"),
                (sensing("memory_with_light", 3), "sensor must be one of .*"),
            )
        ),
        ({"cells": 1}, "shares must leave every policy a cell of 1"),
    ],
    ids=str,
)
def test_what_no_contest_can_be_is_named_in_a_line(options, words):
    options = {"world": RACE, "policies": {"a": Greedy(), "b": Random()}, "cells": 4, "worlds": 2} | options
    with pytest.raises((ValueError, PolicyError), match=words) as found:
        swarm.contest(options.pop("world"), options.pop("policies"), **options)
    assert "\n" not in str(found.value)


def test_intervals_of_shares_hold_the_truth_about_as_often_as_they_say():
    draw = np.random.default_rng(1)
    held = []
    for _ in range(1500):
        chance = draw.beta(6, 4, size=20)  # units differ: their wins are not independent
        part = draw.binomial(4, chance)
        _, low, high = share_interval(part, np.full(20, 4))
        held.append(low <= 0.6 <= high)
    assert 0.94 < np.mean(held) <= 0.985


def test_a_share_of_all_or_nothing_has_an_interval():
    share, low, high = share_interval(np.full(10, 2), np.full(10, 2))
    assert (share, high) == (1.0, 1.0)
    assert low == pytest.approx(beta.ppf(0.025, 10, 1))
    assert share_interval(np.zeros(10), np.full(10, 2))[2] == pytest.approx(1 - low)
    assert np.isnan(share_interval(np.zeros(3), np.zeros(3))).all()
    assert np.isnan(share_interval(np.array([1]), np.array([2]))).tolist() == [False, True, True]
