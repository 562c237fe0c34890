"""The paper's claims: each verdict on made-up results that make it true, false and reversed."""

import math

import numpy as np
import pytest

from swarm.physics.world import World
from swarm.policies.strategies import Greedy, Random, Swinging
from trainers.studies.claims import (
    NOT_REPRODUCED,
    REPRODUCED,
    REVERSED,
    Criterion,
    all_claims,
    judged,
    statements,
)
from trainers.studies.estimates import Estimate, estimate, loss
from trainers.studies.paper.measurements import (
    MEASURES,
    Case,
    Circle,
    Evidence,
    Lives,
    Measured,
    TrainingGains,
    centreline,
    measure,
    pattern_broken,
    predicted_circle,
    swinging_circle,
    wound,
)
from trainers.studies.paper.plan import RECORDS

CELLS, SEEDS = 60, (0, 1, 2, 3, 4)
STARTS = np.random.default_rng(7).standard_normal(CELLS)  # what a start does to the gain under every policy
DEVISED = ("greedy", "swinging", "optimal")
STATEMENTS = {statement.id: statement for statement in statements("trainers.studies.paper", MEASURES)}


def lives(gain=20.0, *, seeds=SEEDS, std=1.0, angle=0.0, arrived=1.0, winding=90.0, broken=0.3, **changes):
    """Lives whose numbers have a mean and a spread over cells, shifted a little from seed to seed."""
    rows = len(seeds) or 1
    shift = (np.arange(rows) - (rows - 1) / 2)[:, None]
    direction = np.radians(angle + 0.05 * shift) + 0.01 * STARTS[None]
    part = (np.arange(CELLS) / CELLS)[None] + np.zeros((rows, 1))
    made = Lives(
        seeds=seeds,
        gain=gain + 0.1 * shift + std * STARTS[None],
        arrived=part < arrived,
        lifetime=np.full((rows, CELLS), 200.0),
        drift=20.0 * np.stack([-np.sin(direction), np.cos(direction)], axis=-1),
        wave=0.5 + 0.001 * shift + 0.01 * np.abs(STARTS[None]),
        winding=np.radians(winding + 0.1 * shift + STARTS[None]),
        broken=broken + 0.001 * shift + 0.01 * STARTS[None],
        ahead=part < changes.pop("ahead", 1.0),
    )
    return made._replace(wave=made.wave * changes.pop("wave", 1.0), **changes)


def circle(*, deviation=1e-6, back=0.3):
    spread = np.linspace(0.9, 1.1, 5)[None]
    return Circle(np.full((1, 5), 2.0), 2.0, deviation * spread, back * spread, 100.0)


def evidence(samples, circles=None, training=None):
    """What was measured, of samples by CASE/KIND."""
    cases = {}
    for where, each in samples.items():
        case, kind = where.split("/")
        recipe = "" if kind in DEVISED else "paper"
        made = each._replace(seeds=()) if kind in DEVISED else each
        cases.setdefault(case, Measured(30.0, 0.0, {})).lives[recipe, kind] = made
    return Evidence(cases, circles or {}, training or {})


def claim(identity, samples, **others):
    """The claim with this name, judged on samples by CASE/KIND."""
    return judged(STATEMENTS[identity], evidence(samples, **others).sample, "paper")


@pytest.mark.parametrize(
    ("criterion", "true", "false", "reverse"),
    [
        (Criterion(">"), [(0.1, 2)], [(-0.1, 2), (0, 1), (math.nan, math.nan)], [(-2, -0.1)]),
        (Criterion("<", 1.0), [(0.1, 0.9)], [(0.9, 1.1), (1, 2)], [(1.1, 2)]),
        (Criterion("±", 1.0), [(1.1, 9), (-9, -1.1)], [(0.9, 9), (-9, 0.5), (-2, 2)], [(-0.9, 0.9)]),
    ],
    ids=str,
)
def test_a_claim_is_reproduced_only_where_the_whole_interval_satisfies_it(criterion, true, false, reverse):
    for intervals, verdict in ((true, REPRODUCED), (false, NOT_REPRODUCED), (reverse, REVERSED)):
        for interval in intervals:
            assert criterion.verdict(Estimate(float(np.mean(interval)), interval, 0.0, 0.0)) == verdict


N2, N4, N8 = (f"{name}/dqn" for name in RECORDS)
G2, G4, G8 = (f"{name}/greedy" for name in RECORDS)
VARYING, EGG, AWARE = "varying_speed/dqn", "radial/dqn", "taylor_green/aware"
BLIND, STILL = "taylor_green/blind", "taylor_green/still"


@pytest.mark.parametrize(
    ("identity", "name", "samples", "true", "false", "reverse"),
    [
        ("dqn_beats_greedy_linear_n4", "gain", (N4, G4), (21, 20), (20, 20), (20, 21)),
        ("lead_grows_2_to_8", "gain", (N8, G8, N2, G2), (23, 20, 21, 20), (21, 20) * 2, (21, 20, 23, 20)),
        ("varying_speed_costs_dqn", "gain", (N4, VARYING), (20, 18), (20, 20), (18, 20)),
        ("varying_speed_costs_little_dqn", "gain", (N4, VARYING), (20, 19), (20, 18), (20, 15)),
        ("flow_aware_beats_still", "gain", (AWARE, STILL), (21, 20), (20, 20), (20, 21)),
        ("flow_awareness_narrows_blind", "std", (BLIND, AWARE), (3, 1), (2, 2), (1, 3)),
        ("angle_dqn_linear_n4", "angle", (N4,), (-12,), (1,), (0.3,)),
        ("angle_is_a_trade_off_linear_n8", "angle", ("linear_n8/optimal",), (5,), (-1,), (0.0,)),
        ("dqn_straighter_linear_n2", "angle", (N2, G2), (4, -10), (-10, 10), (10, -4)),
        ("centrelines_straightest_linear_n4", "wave", (N4, N8), (2, 1), (1, 1), (1, 2)),
        ("dqn_swings_linear_n2", "broken", (N2,), (0.2,), (0.5,), (0.8,)),
        ("greedy_discards_swinging_linear_n8", "broken", (G8,), (0.8,), (0.5,), (0.2,)),
        ("dqn_always_ahead_linear_n4", "ahead", (N4,), (1.0,), (0.95,), (0.1,)),
        ("radial_arrives", "arrived", (EGG,), (1.0,), (0.95,), (0.1,)),
        ("radial_spirals", "winding", (EGG,), (-60.0,), (45.0,), (10.0,)),
    ],
)
def test_a_claim_is_judged_by_what_is_measured(identity, name, samples, true, false, reverse):
    for values, verdict in ((true, REPRODUCED), (false, NOT_REPRODUCED), (reverse, REVERSED)):
        made = {where: lives(**{name: value}) for where, value in zip(samples, values, strict=True)}
        assert claim(identity, made).verdict == verdict, values


def test_swinging_and_training_are_judged_too():
    verdicts = [REPRODUCED, NOT_REPRODUCED, REVERSED]
    for name, values in (("deviation", (1e-6, 0.01, 0.5)), ("back", (0.3, 1.0, 40.0))):
        identity = {"deviation": "swinging_circle_linear_n2", "back": "swinging_returns_linear_n2"}[name]
        circles = [{"linear_n2": circle(**{name: value})} for value in values]
        assert [claim(identity, {}, circles=each).verdict for each in circles] == verdicts
    rising = np.linspace(0, 1, 50) + 0.1 * np.arange(-2.0, 3.0)[:, None]  # five seeds
    uncertain = np.linspace(-1, 1, 50) * np.arange(-2.0, 3.0)[:, None]
    for gain, verdict in zip((rising, uncertain, -rising), verdicts, strict=True):
        training = {("paper", "linear_n2"): TrainingGains(SEEDS, gain)}
        assert claim("gain_rises_linear_n2", {}, training=training).verdict == verdict


def test_a_claim_states_its_seeds_and_the_least_favourable_of_them():
    found = claim("dqn_beats_greedy_linear_n4", {N4: lives(21), G4: lives(20, seeds=(0,))})
    assert found.measurement == pytest.approx(1.0)
    assert found.seeds == SEEDS
    assert found.worst_seed == pytest.approx(0.8)
    assert found.by_seed[N4] == pytest.approx(np.arange(20.8, 21.3, 0.1) + STARTS.mean())
    left = claim("angle_dqn_linear_n4", {N4: lives(angle=12.0)})
    right = claim("angle_dqn_linear_n4", {N4: lives(angle=-12.0)})
    assert (left.worst_seed, right.worst_seed) == pytest.approx((11.9, -11.9), abs=0.2)
    assert right.spread_of_seeds == pytest.approx(0.05 * np.std(range(5), ddof=1), rel=0.01)


def test_cells_are_paired_so_that_a_small_lead_shows_through_a_wide_spread():
    samples = {N4: lives(20.5, std=5.0), G4: lives(20, std=5.0, seeds=(0,))}
    found = claim("dqn_beats_greedy_linear_n4", samples)
    assert found.verdict == REPRODUCED
    assert found.interval[1] - found.interval[0] < 0.5


@pytest.mark.parametrize("n_seeds", [3, 5, 20])
@pytest.mark.parametrize(("identity", "scale"), [("angle_dqn_linear_n4", 20.0), ("radial_spirals", 120.0)])
def test_noise_of_seeds_around_0_is_no_angle(identity, scale, n_seeds):
    """However wide: each seed alone would deviate, and so would the mean of |angle|."""
    generator, passed = np.random.default_rng(n_seeds), 0
    for _ in range(200):
        turned = generator.normal(0.0, scale, (n_seeds, 1)) + generator.normal(0.0, 5.0, (1, CELLS))
        direction = np.radians(turned)
        drift = np.stack([-np.sin(direction), np.cos(direction)], axis=-1)
        made = lives(seeds=tuple(range(n_seeds)), drift=drift)._replace(winding=direction)
        where = EGG if identity == "radial_spirals" else N4
        passed += claim(identity, {where: made}).verdict == REPRODUCED
    assert passed <= 16  # of 200; 10 are expected of 95% intervals around exactly 0


def everything():
    """Results in which every claim of the paper holds."""
    greedy = {"linear_n2": (18, 30), "linear_n4": (19, 4), "linear_n8": (3, 15), "varying_speed": (18, 8)}
    learnt = {"linear_n2": (20, 20), "linear_n4": (25, 10), "linear_n8": (22, 40), "varying_speed": (24, 15)}
    samples = {}
    for name in greedy:
        broken = 0.7 if name == "linear_n8" else 0.2
        gain, angle = greedy[name]
        samples[f"{name}/greedy"] = lives(gain, angle=angle, broken=broken + 0.1, seeds=(0,))
        gain, angle = learnt[name]
        wave = 0.2 if name == "linear_n8" else 1.0
        samples[f"{name}/dqn"] = lives(gain, angle=angle, broken=broken, wave=wave)
        samples[f"{name}/optimal"] = lives(30, angle=5, seeds=(0,))
    samples |= {"radial/greedy": lives(seeds=(0,)), "radial/dqn": lives()}
    flow = {"greedy": (37, 1.0), "still": (49, 8.0), "blind": (59, 7.0), "aware": (63, 2.0)}
    samples |= {f"taylor_green/{kind}": lives(gain, std=std) for kind, (gain, std) in flow.items()}
    rising = TrainingGains(SEEDS, np.linspace(0, 10, 40) + np.zeros((5, 1)))
    training = {("paper", name): rising for name in RECORDS}
    return evidence(samples, {name: circle() for name in RECORDS}, training)


def test_where_everything_is_as_the_paper_says_every_claim_is_reproduced():
    found = all_claims(STATEMENTS.values(), everything().sample, ["paper"])
    assert {claim.id: claim.verdict for claim in found if claim.verdict != REPRODUCED} == {}
    assert [claim.id for claim in found] == list(STATEMENTS)
    assert len({claim.id for claim in found}) == len(found) == 57


def test_claims_without_measurements_are_left_out():
    found = all_claims(STATEMENTS.values(), evidence({"radial/dqn": lives()}).sample, ["paper", "swarm"])
    assert [claim.id for claim in found] == ["radial_arrives", "radial_spirals"]


def test_a_claim_is_judged_under_each_recipe_that_trains_for_it_and_else_once():
    both = everything()
    for measured in both.cases.values():
        for (recipe, kind), each in list(measured.lives.items()):
            if recipe:
                measured.lives["swarm", kind] = each
    found = [
        (claim.id, claim.recipe) for claim in all_claims(STATEMENTS.values(), both.sample, ["swarm", "paper"])
    ]
    place = found.index(("dqn_beats_greedy_linear_n4", "swarm"))
    assert found[place + 1] == ("dqn_beats_greedy_linear_n4", "paper")
    assert [recipe for name, recipe in found if name == "angle_greedy_linear_n2"] == [None]
    assert len(set(found)) == len(found)


def test_the_slopes_of_what_is_not_linear_are_exact():
    first, second = np.random.default_rng(2).normal([[20.0]], 1.0, (2, 1, 40))
    found = estimate(first, 0.9 * second, combine=loss)
    m, n = first.mean(), 0.9 * second.mean()
    weights = n / m**2, -1 / m
    each = weights[0] * first + weights[1] * 0.9 * second
    assert found.value == pytest.approx(1 - n / m)
    half = 2.0227 * each.std(ddof=1) / math.sqrt(40)  # t of 39 degrees of freedom
    assert found.interval == pytest.approx((found.value - half, found.value + half), rel=1e-4)


@pytest.mark.parametrize("name", ["gain", "spread of the gain", "angle", "part of the way up"])
def test_a_measure_is_the_mean_of_its_values_and_to_first_order_their_sum(name):
    """Leaving out one of many cells changes the number as the cell's value says."""
    generator = np.random.default_rng(3)
    made = lives(angle=20.0)._replace(
        gain=generator.normal(20, 3, (5, CELLS)), drift=generator.normal(5, 1, (5, CELLS, 2))
    )
    values = MEASURES[name].values(made)
    drift = made.drift.mean(axis=1)
    angle = np.arctan2(-drift[:, 0], drift[:, 1])
    expected = {
        "gain": made.gain.mean(axis=1),
        "spread of the gain": made.gain.std(axis=1),
        "angle": np.degrees(angle),
        "part of the way up": np.cos(angle),
    }[name]
    assert values.mean(axis=1) == pytest.approx(expected)
    without = made._replace(gain=made.gain[:, 1:], drift=made.drift[:, 1:])
    change = MEASURES[name].values(without).mean(axis=1) - expected
    first_order = -(values[:, 0] - expected) / (CELLS - 1)
    assert change == pytest.approx(first_order, rel=0.1, abs=0.03 * np.abs(first_order).max())


@pytest.mark.parametrize(("agree", "interval"), [(True, (0.9404, 1.0)), (False, (0.0, 0.0596))])
def test_what_all_cells_do_is_as_sure_as_their_number_allows(agree, interval):
    assert estimate(np.array([[4.0]])) == (4.0, None, 4.0, 4.0)  # of one number nothing is known
    found = estimate(np.full((5, 60), agree))
    assert found.interval == pytest.approx(interval, abs=1e-4)  # Clopper and Pearson, 60 of 60


@pytest.mark.parametrize("turns", [-1.5, -0.1, 0.0, 0.25, 2.0])
def test_a_line_winds_from_its_start_to_the_egg(turns):
    radius = np.geomspace(12.0, 0.5, 400)
    angle = 2.0 + 2 * np.pi * turns * np.log(radius / 12.0) / np.log(1.0 / 12.0)  # at the egg's radius
    places = np.stack([3.0 + radius * np.cos(angle), 1.0 + radius * np.sin(angle)], axis=-1)
    assert wound(np.array([[[0.1, 0.0], [5.0, 0.0]]]), ((0.0, 0.0), 1.0)) == [0.0]  # begins within the egg
    lived = np.concatenate([places, np.full((9, 2), np.nan)])[None]
    assert wound(lived, ((3.0, 1.0), 1.0)) == pytest.approx([2 * np.pi * turns], rel=0.01, abs=1e-9)


def test_a_centreline_has_a_way_and_a_wave():
    along = np.linspace(0.0, 10.0, 400, endpoint=False)
    wavy = np.stack([along, 2.0 * along + 0.3 * np.sin(2 * np.pi * along)], axis=-1)
    straight = np.stack([along, -along], axis=-1)
    straight[300:] = np.nan
    way, wave = centreline(np.stack([wavy, straight]))
    assert way[1] == pytest.approx([along[299], -along[299]])
    assert wave[0] == pytest.approx(0.3 / np.sqrt(2) / np.sqrt(5), rel=0.01)  # across the line
    assert wave[1] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("n_records", [2, 4, 8])
def test_swinging_keeps_its_pattern_and_chance_breaks_it_half_the_time(n_records):
    case = Case("linear", World(n_records=n_records).replace(life=60.0), (), cells=20, seed=1)
    found = measure(case)
    assert found.lives["", "swinging"].broken.max() == 0.0
    greedy = found.lives["", "greedy"]
    assert found.lives["", "optimal"].gain.mean() > greedy.gain.mean()
    assert np.array_equal(found.lives["", "optimal"].ahead, found.lives["", "optimal"].gain > greedy.gain)
    chosen = np.random.default_rng(0).choice([3.0, 5.0], (50, 401))
    assert pattern_broken(chosen, n_records).mean() == pytest.approx(0.5, abs=0.02)
    chosen[0, 10:] = np.nan
    assert 0 < pattern_broken(chosen, n_records)[0] <= 1
    assert pattern_broken(np.full((1, 30), 3.0), n_records) == [1.0]


@pytest.mark.parametrize("options", [{"n_records": 2}, {"n_records": 5}, {"varying_speed": True}])
def test_swinging_runs_round_the_circle_that_geometry_predicts(options):
    found = swinging_circle(World(**options), cells=3, seed=0)
    assert found.fitted == pytest.approx(found.predicted, rel=1e-5)
    assert np.all(found.deviation < 1e-5)
    assert np.all(found.back < 0.51)  # half a step at most: it goes round in whole steps


@pytest.mark.parametrize("strategy", [Greedy(), Random()])
def test_a_strategy_that_migrates_neither_comes_back_nor_keeps_to_the_circle(monkeypatch, strategy):
    monkeypatch.setattr(Swinging, "act", lambda self, *arguments: strategy.act(*arguments))
    monkeypatch.setattr(Swinging, "deterministic", False)
    found = {"linear_n4": swinging_circle(World(n_records=4), cells=10, seed=0)}
    assert claim("swinging_circle_linear_n4", {}, circles=found).verdict == REVERSED
    if isinstance(strategy, Greedy):
        assert claim("swinging_returns_linear_n4", {}, circles=found).verdict == REVERSED


def test_swinging_with_exact_intervals_goes_straight_on_and_has_no_circle():
    with pytest.raises(ValueError, match="must turn by less or more than a circle"):
        predicted_circle(World(n_records=4, interval_rule="exact"))
