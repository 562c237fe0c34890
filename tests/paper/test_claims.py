"""The paper's claims: each verdict on made-up results that make it true, false and reversed."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from swarm.physics.world import World
from swarm.policies.strategies import Swinging
from trainers.paper import claims
from trainers.paper import intervals as resampling
from trainers.paper.claims import NOT_REPRODUCED, REPRODUCED, REVERSED
from trainers.paper.intervals import estimate, mean, off_gradient, spread
from trainers.paper.measurements import (
    Circle,
    Lives,
    Measured,
    fit_circle,
    predicted_circle,
    spiral_angle,
    swinging_circle,
)
from trainers.paper.statements import Evidence, TrainingGains, all_claims

CELLS, SEEDS = 60, (0, 1, 2)
STARTS = np.random.default_rng(7).standard_normal(
    CELLS
)  # what a cell's start does to its gain under every policy


def lives(gain=20.0, *, seeds=SEEDS, std=1.0, off_seeds=0.1, angle=0.0, arrived=1.0, spiral=0.3):
    """Lives whose gains have a mean and a spread over cells, shifted a little from seed to seed."""
    rows = len(seeds) or 1
    shift = off_seeds * (np.arange(rows) - (rows - 1) / 2)[:, None]
    direction = np.radians(angle) + 0.01 * STARTS[None] + np.zeros((rows, 1))
    return Lives(
        seeds=seeds,
        gain=gain + shift + std * STARTS[None],
        arrived=np.broadcast_to(np.arange(CELLS) < arrived * CELLS, (rows, CELLS)),
        lifetime=np.full((rows, CELLS), 200.0),
        drift=20.0 * np.stack([-np.sin(direction), np.cos(direction)], axis=-1),
        spiral=spiral + 0.01 * STARTS[None] + np.zeros((rows, 1)),
    )


def verdicts(make, true, false, reverse):
    """Verdicts of a claim on arguments that make it true, false and reversed."""
    return [make(*arguments).verdict for arguments in (true, false, reverse)]


ALL = [REPRODUCED, NOT_REPRODUCED, REVERSED]


# --- verdicts follow from intervals -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("interval", "verdict"),
    [
        ((0.1, 2.0), REPRODUCED),
        ((-0.1, 2.0), NOT_REPRODUCED),
        ((-2.0, -0.1), REVERSED),
        ((0.0, 1.0), NOT_REPRODUCED),
    ],
)
def test_a_claim_is_reproduced_only_where_the_whole_interval_is_on_its_side(interval, verdict):
    found = resampling.Estimate(float(np.mean(interval)), interval, 0.0, 0.0)
    assert claims.judged(found, above=0.0) == verdict
    mirrored = found._replace(interval=(-interval[1], -interval[0]))
    assert claims.judged(mirrored, below=0.0) == verdict


def test_nothing_follows_from_what_is_not_a_number():
    assert (
        claims.judged(resampling.Estimate(math.nan, (math.nan, math.nan), 0, 0), above=0.0) == NOT_REPRODUCED
    )


def test_one_network_gains_more_than_another():
    def make(better, worse):
        return claims.higher("id", "text", "swarm", lives(better), lives(worse))

    assert verdicts(make, (21, 20), (20, 20), (20, 21)) == ALL
    found = make(21, 20)
    assert found.measurement == pytest.approx(1.0)
    assert found.seeds == SEEDS
    assert found.worst_seed == pytest.approx(0.8)  # the worst of the better against the best of the worse


def test_cells_are_paired_so_that_a_small_lead_shows_through_a_wide_spread():
    found = claims.higher("id", "text", "swarm", lives(20.5, std=5.0), lives(20.0, std=5.0, seeds=()))
    assert found.verdict == REPRODUCED
    assert found.interval[1] - found.interval[0] < 0.5


def test_gains_of_one_network_vary_less():
    def make(narrow, wide):
        return claims.narrower("id", "text", "swarm", lives(std=narrow), lives(std=wide))

    assert verdicts(make, (1.0, 3.0), (2.0, 2.0), (3.0, 1.0)) == ALL
    assert make(1.0, 3.0).measurement == pytest.approx(2.0 * STARTS.std())


def test_the_lead_grows():
    def make(before, after):
        pairs = [(lives(20.0 + lead), lives(20.0, seeds=())) for lead in (before, after)]
        return claims.lead_grows("id", "text", "swarm", *pairs)

    assert verdicts(make, (1.0, 3.0), (2.0, 2.0), (3.0, 1.0)) == ALL


def test_migration_makes_an_angle_with_the_gradient():
    def make(angle):
        return claims.off_the_gradient("id", "text", "swarm", lives(angle=angle))

    assert verdicts(make, (-12.0,), (claims.STRAIGHT,), (0.3,)) == ALL
    found = make(-12.0)  # to the right of the gradient
    assert found.measurement == pytest.approx(12.0, abs=0.3)
    assert found.details["signed_by_seed"] == pytest.approx([-12.0] * 3, abs=0.3)


def test_one_migration_is_straighter_than_another_whatever_their_sides():
    def make(straight, oblique):
        return claims.straighter("id", "text", "swarm", lives(angle=straight), lives(angle=oblique))

    assert verdicts(make, (4.0, -10.0), (-10.0, 10.0), (10.0, -4.0)) == ALL


def test_gain_rises_in_training():
    def make(slope):
        gain = slope * np.linspace(0, 1, 50) + 0.1 * np.arange(3)[:, None]
        return claims.gain_rises("id", "text", "swarm", gain, SEEDS)

    assert verdicts(make, (5.0,), (0.0,), (-5.0,)) == ALL
    assert make(5.0).details["last_tenth"] > make(5.0).details["first_tenth"]


def test_everyone_arrives():
    def make(part):
        return claims.everyone_arrives("id", "text", "swarm", lives(arrived=part))

    assert verdicts(make, (1.0,), (0.95,), (0.1,)) == ALL


def test_centrelines_are_spirals():
    def make(angle):
        return claims.centrelines_spiral("id", "text", "swarm", lives(spiral=math.radians(angle)))

    assert verdicts(make, (20.0,), (claims.STRAIGHT,), (0.2,)) == ALL
    assert make(-20.0).details["signed_by_seed"] == pytest.approx([-20.0] * 3, abs=0.2)


def circle(*, deviation=1e-6, back=0.3):
    spread = np.linspace(0.9, 1.1, 5)[None]
    return Circle(np.full((1, 5), 2.0), 2.0, deviation * spread, back * spread, 100.0)


def test_swinging_goes_round_in_the_predicted_circle():
    def make(deviation):
        return claims.swinging_circle("linear_n2", "N_T = 2", circle(deviation=deviation))

    assert verdicts(make, (1e-6,), (claims.ROUND,), (0.5,)) == ALL


def test_swinging_comes_back():
    def make(back):
        return claims.swinging_returns("linear_n2", "N_T = 2", circle(back=back))

    assert verdicts(make, (0.3,), (1.0,), (40.0,)) == ALL


# --- the list of claims -------------------------------------------------------------------------------------


def evidence(**changed):
    """Results in which every claim of the paper holds."""
    greedy = {"linear_n2": (18, 30), "linear_n4": (19, 4), "linear_n8": (3, 15), "varying_speed": (17, 8)}
    learnt = {"linear_n2": (20, 20), "linear_n4": (25, 10), "linear_n8": (22, 40), "varying_speed": (24, 15)}
    cases = {
        name: Measured(
            30.0,
            0.0,
            {
                ("", "greedy"): lives(greedy[name][0], angle=greedy[name][1], seeds=()),
                ("paper", "dqn"): lives(learnt[name][0], angle=learnt[name][1]),
            },
        )
        for name in greedy
    }
    cases["radial"] = Measured(None, None, {("", "greedy"): lives(seeds=()), ("paper", "dqn"): lives()})
    cases["taylor_green"] = Measured(
        71.0,
        0.2,
        {
            ("", "greedy"): lives(37, seeds=()),
            ("paper", "still"): lives(49),
            ("paper", "aware"): lives(63, std=2.0),
            ("paper", "blind"): lives(59, std=7.0),
        },
    )
    rising = TrainingGains(SEEDS, np.linspace(0, 10, 40) + np.zeros((3, 1)))
    names = ("linear_n2", "linear_n4", "linear_n8")
    whole = Evidence(
        cases, {name: circle() for name in names}, {("paper", name): rising for name in names}, 0
    )
    return whole._replace(**changed)


def test_where_everything_is_as_the_paper_says_every_claim_is_reproduced():
    found = all_claims(evidence(), ("paper",))
    assert {claim.verdict for claim in found} == {REPRODUCED}
    assert len({claim.id for claim in found}) == len(found) == 38


def test_every_subject_of_the_paper_is_judged():
    ids = {claim.id for claim in all_claims(evidence(), ("paper",))}
    for records in (2, 4, 8):
        for subject in ("swinging_returns", "swinging_circle", "gain_rises", "dqn_beats_greedy", "angle_dqn"):
            assert f"{subject}_linear_n{records}" in ids
    assert ids >= {
        "greedy_improves_2_to_4",
        "dqn_improves_2_to_4",
        "dqn_deteriorates_4_to_8",
        "lead_grows_2_to_4",
        "lead_grows_4_to_8",
        "varying_speed_costs_greedy",
        "varying_speed_costs_dqn",
        "dqn_beats_greedy_varying_speed",
        "radial_arrives",
        "radial_spirals",
        "flow_aware_beats_blind",
        "flow_blind_beats_greedy",
        "flow_awareness_narrows",
    }


def test_claims_without_measurements_are_left_out():
    without = evidence(training={}, circles={}, cases={"radial": evidence().cases["radial"]})
    assert [claim.id for claim in all_claims(without, ("paper", "swarm"))] == [
        "radial_arrives",
        "radial_spirals",
    ]


def test_a_claim_about_training_is_judged_under_each_recipe_one_after_the_other():
    both = evidence()
    for measured in both.cases.values():
        for (recipe, kind), each in list(measured.lives.items()):
            if recipe:
                measured.lives["swarm", kind] = each
    found = all_claims(both, ("swarm", "paper"))
    recipes = [claim.recipe for claim in found if claim.id == "dqn_beats_greedy_linear_n4"]
    assert recipes == ["swarm", "paper"]
    places = [place for place, claim in enumerate(found) if claim.id == "dqn_beats_greedy_linear_n4"]
    assert places[1] == places[0] + 1


def test_claims_are_plain_json():
    found = [claim.as_json() for claim in all_claims(evidence(), ("paper",))]
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert set(found[0]) >= {"id", "claim", "recipe", "measurement", "interval", "seeds", "verdict"}


# --- resampling ---------------------------------------------------------------------------------------------


def test_intervals_are_those_of_the_mean_where_only_cells_vary():
    sample = np.random.default_rng(1).normal(5.0, 2.0, (1, 400))
    found = estimate(lambda mean: mean, sample)
    error = sample.std() / 20
    assert found.value == pytest.approx(sample.mean())
    assert found.interval == pytest.approx(
        (sample.mean() - 1.96 * error, sample.mean() + 1.96 * error), abs=0.15 * error
    )


def test_the_spread_of_seeds_is_in_the_interval():
    still = estimate(lambda mean: mean, np.full((5, 50), 3.0) + 0.01 * STARTS[:50])
    moving = estimate(lambda mean: mean, np.arange(5.0)[:, None] + 0.01 * STARTS[:50])
    assert still.interval[1] - still.interval[0] < 0.02
    assert moving.interval[1] - moving.interval[0] > 1.0
    assert (moving.lowest, moving.highest) == pytest.approx((0, 4), abs=0.01)


def test_estimates_are_the_same_every_time():
    sample = np.random.default_rng(1).normal(size=(3, 20))
    assert estimate(np.subtract, sample, sample[:1]) == estimate(np.subtract, sample, sample[:1])


def test_one_number_has_no_interval():
    assert estimate(lambda mean: mean, np.array([[4.0]])) == (4.0, None, 4.0, 4.0)


def test_samples_must_have_the_same_cells():
    with pytest.raises(ValueError, match=r"with the same cells, got the shapes \(1, 3\), \(1, 4\)"):
        estimate(np.subtract, np.zeros((1, 3)), np.zeros((1, 4)))


def test_summaries_with_equal_weights_are_the_plain_ones():
    sample = np.random.default_rng(2).normal(3.0, 2.0, (3, 30))
    even = [np.full((1, length), 1 / length) for length in sample.shape]
    assert mean(sample, *even) == pytest.approx(sample.mean())
    assert spread(sample, *even) == pytest.approx(sample.std(axis=1).mean())
    drift = np.exp(1j * np.radians([[10.0, 20.0], [-30.0, -40.0]]))
    assert off_gradient(drift, np.full((1, 2), 0.5), np.full((1, 2), 0.5)) == pytest.approx(25.0)


# --- what is read off lives ---------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [-40.0, -5.0, 0.0, 25.0, 70.0])
def test_a_logarithmic_spiral_keeps_its_angle_to_the_way_inwards(degrees):
    radius = np.geomspace(12.0, 0.5, 400)
    angle = 2.0 + np.tan(np.radians(degrees)) * np.log(radius)
    places = np.stack([3.0 + radius * np.cos(angle), 1.0 + radius * np.sin(angle)], axis=-1)
    assert np.degrees(spiral_angle(places, ((3.0, 1.0), 1.0))) == pytest.approx(degrees, abs=1e-6)


def test_a_line_that_begins_within_the_egg_has_no_angle():
    assert math.isnan(spiral_angle(np.array([[0.1, 0.0], [5.0, 0.0]]), ((0.0, 0.0), 1.0)))


def test_a_circle_is_fitted_to_points_on_it():
    angle = np.linspace(0.3, 2.0, 30)
    middle, radius = fit_circle(np.stack([4 + 2.5 * np.cos(angle), -7 + 2.5 * np.sin(angle)], axis=-1))
    assert middle == pytest.approx([4, -7])
    assert radius == pytest.approx(2.5)


@pytest.mark.parametrize(
    "options",
    [{"n_records": 2}, {"n_records": 4}, {"n_records": 5}, {"n_records": 8}, {"varying_speed": True}],
)
def test_swinging_runs_round_the_circle_that_geometry_predicts(options):
    world = World(**options)
    found = swinging_circle(world, cells=3, seed=0)
    assert found.fitted == pytest.approx(found.predicted, rel=1e-5)
    assert np.all(found.deviation < 1e-5)
    assert np.all(found.back < 0.51)  # half a step at most: it goes round in whole steps


def test_a_strategy_that_migrates_neither_comes_back_nor_keeps_to_the_circle(monkeypatch):
    from swarm.policies.strategies import Greedy
    from trainers.paper import measurements as measuring

    monkeypatch.setattr(Swinging, "act", Greedy().act)
    found = measuring.swinging_circle(World(n_records=4), cells=3, seed=0)
    assert claims.swinging_circle("linear_n4", "N_T = 4", found).verdict == REVERSED
    assert claims.swinging_returns("linear_n4", "N_T = 4", found).verdict == REVERSED


def test_swinging_with_exact_intervals_goes_straight_on_and_has_no_circle():
    with pytest.raises(ValueError, match="must turn by less or more than a circle"):
        predicted_circle(World(n_records=4, interval_rule="exact"))
