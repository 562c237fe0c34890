"""The physical limit: held against enumeration, attained by play, exceeded by none."""

import itertools
import math
from collections import deque

import numpy as np
import pytest

from swarm.optimal import physical_limit as optimal
from swarm.optimal import store
from swarm.optimal.helical import HelicalLimit
from swarm.optimal.physical_limit import Optimal, bound, limit, limit_details
from swarm.optimal.problem import problem_of
from swarm.optimal.still import solve
from swarm.optimal.tables import VortexLimit, VortexTables, grid_of
from swarm.optimal.vortices import backward
from swarm.physics.fields import FunctionField, LinearField, RadialField
from swarm.physics.flows import TaylorGreen, UniformFlow
from swarm.physics.motion.arc import Pose
from swarm.physics.starts import Starts, draw_starts
from swarm.physics.world import World
from swarm.policies.strategies import Greedy, Random, Swinging
from swarm.population.rollout import rollout
from tests.reference import array, to_numpy

STILL = [
    {"n_records": 2},
    {"n_records": 4},
    {"n_records": 8},
    {"interval_rule": "exact"},
    {"varying_speed": True},
    {"curvatures": (3.0, 4.0, 5.0)},
    {"curvatures": (2.0, 3.0, 4.0, 5.0), "varying_speed": True},
    {"speed": 1.3, "time_step": 0.01},
]


def even_starts(world, cells=720):
    heading = 2 * np.pi * (np.arange(cells) + 0.5) / cells
    return Starts(np.zeros((cells, 2)), heading, np.zeros((cells, world.n_records), int))


def gains(world, policy, starts, seed=0):
    *_, last = rollout(world, policy, starts, seed)
    return last.outcome.gain


def best_of_all(world, starts):
    """The largest gain of every cell over all sequences of actions there are."""
    best = -np.inf
    for actions in itertools.product(range(world.n_actions), repeat=world.max_decisions):
        state = world.start(*starts)
        for action in actions:
            if not state.finished.all():
                state, outcome = world.step(state, np.full(len(starts.heading), action))
        best = np.maximum(best, outcome.gain)
    return best


def by_orbits(world, heading):
    """The largest gain from each heading, exactly: with one speed, j decisions lead to few headings only."""
    problem = problem_of(world)
    first, *_ = turns = np.array(problem.curvatures) * problem.speeds[0] * problem.ticks[0] * problem.tick
    later = None
    for decision in range(world.max_decisions - 1, -1, -1):
        steps = np.arange(decision * (len(turns) - 1) + 1)
        theta = heading[:, None] + decision * first + steps * (turns[1] - first)
        left = problem.life_ticks - decision * problem.ticks[0]
        values = []
        for action, curvature in enumerate(problem.curvatures):
            turn = curvature * problem.speeds[0] * problem.duration(action, left)
            gain = (np.cos(theta) - np.cos(theta + turn)) / curvature
            values.append(gain if later is None else gain + later[:, action : action + len(steps)])
        later = np.maximum.reduce(values)
    return later[:, 0]


@pytest.mark.parametrize(
    ("n_records", "varying_speed", "expected"),
    [(2, False, 28.67), (4, False, 30.27), (8, False, 32.09), (4, True, 30.18)],
)
def test_the_limit_agrees_with_independent_estimates(n_records, varying_speed, expected):
    world = World(life=200.0, n_records=n_records, varying_speed=varying_speed)
    details = limit_details(world, even_starts(world))
    assert details.value == pytest.approx(expected, rel=1e-3)
    assert details.error < 1e-4 * expected


@pytest.mark.parametrize("life", [31.013, 0.3])
@pytest.mark.parametrize("options", [one for one in STILL if "varying_speed" not in one], ids=str)
def test_the_bound_of_every_start_agrees_with_the_exact_one_on_its_orbit(options, life):
    world = World(life=life, **options)
    starts = draw_starts(world, 10, 0)
    exact = by_orbits(world, starts.heading)
    assert bound(world, starts) == pytest.approx(exact, abs=1e-3)
    assert limit(world, starts) == pytest.approx(exact.mean(), rel=5e-5)


@pytest.mark.parametrize("life", [1.56, 1.411])
@pytest.mark.parametrize("options", STILL, ids=str)
def test_no_sequence_of_actions_gains_more_than_the_bound_and_one_gains_it(options, life):
    world = World(life=life, **{**options, "n_records": min(4, options.get("n_records", 4))})
    starts = draw_starts(world, 5, 1)
    assert bound(world, starts) == pytest.approx(best_of_all(world, starts), abs=1e-4)


@pytest.mark.parametrize("life", [200.0, 33.333])
@pytest.mark.parametrize("options", STILL, ids=str)
def test_playing_the_optimal_policy_attains_its_bound(options, life):
    world = World(life=life, **options)
    starts = draw_starts(world, 40, 0)
    gain = gains(world, Optimal(world), starts)
    assert gain.mean() == pytest.approx(limit(world, starts), rel=1e-4)
    assert gain == pytest.approx(bound(world, starts), rel=0.005)


@pytest.mark.parametrize("policy", [Greedy(), Swinging(), Random()], ids=lambda policy: type(policy).__name__)
@pytest.mark.parametrize("options", STILL, ids=str)
def test_no_policy_gains_more_than_the_bound(options, policy):
    world = World(life=50.0, **options)
    starts = draw_starts(world, 40, 2)
    assert (gains(world, policy, starts) < bound(world, starts) + 1e-3).all()


def test_the_limit_is_a_gain_in_concentration_averaged_over_the_very_starts():
    world = World(life=3.0)
    starts = even_starts(world)
    plain, by_start = limit(world, starts), bound(world, starts)
    assert limit(world.replace(field=LinearField(offset=-7.0)), starts) == plain
    assert limit(world.replace(field=LinearField(gradient_scale=2.5)), starts) == pytest.approx(2.5 * plain)
    best = int(np.argmax(by_start))
    one = Starts(*(part[best : best + 1] for part in starts))
    assert limit(world, one) == pytest.approx(by_start[best], abs=1e-5)
    assert by_start[best] > plain + 0.1


@pytest.mark.parametrize(
    "options", [{"n_records": 2}, {"n_records": 4}, {"curvatures": (3.0, 4.0, 5.0)}], ids=str
)
def test_more_headings_bring_the_bound_nearer_to_the_exact_one(options):
    """Measured: kinks hold the order of cubic polynomials down to between one and two."""
    world = World(life=100.0, **options)
    heading = even_starts(world, 60).heading
    pose = Pose(np.zeros((60, 2)), np.stack([np.cos(heading), np.sin(heading)], axis=-1))
    exact = by_orbits(world, heading)
    errors = []
    for headings in (64, 512, 4096):
        *_, finest = solve(problem_of(world), headings).bounds(pose).values()
        errors.append(np.sqrt(np.mean((finest - exact) ** 2)))
    orders = -np.diff(np.log2(errors)) / 3
    assert np.all(orders > 1), orders


class Tilted(LinearField):
    """A linear field by inheritance only."""


@pytest.mark.parametrize(
    ("world", "why"),
    [
        (World(field=RadialField()), "a linear field"),
        (World(field=FunctionField(lambda position: position[..., 1], 1.0)), "a linear field"),
        (World(field=Tilted()), "a linear field"),
        (World.in_space(field="radial"), "a linear field"),
        (World(flow=UniformFlow()), "still water or the Taylor–Green flow"),
        (World(action="continuous", flow="taylor_green"), "still water where curvatures are chosen"),
        (World(rotational_diffusion=0.1), "no perturbations"),
        (World.in_space(concentration_noise=0.1), "no perturbations"),
        (World(interval_rule="exact", varying_speed=True), "share a tick"),
        (World.in_space(interval_rule="exact", varying_speed=True), "share a tick"),
        (World(life=1e6, time_step=1e-3, varying_speed=True), "a life of at most"),
    ],
)
def test_where_no_limit_is_known_it_is_none_and_the_policy_says_why(world, why):
    starts = draw_starts(world, 3, 0)
    assert limit(world, starts) is limit_details(world, starts) is bound(world, starts) is None
    with pytest.raises(ValueError, match=why):
        Optimal(world)


@pytest.mark.parametrize("world", [World(life=5.0, curvatures=(3.0, 4.0, 5.0)), World.in_space(life=2.0)])
def test_actions_are_the_same_on_any_array_library_and_with_any_leading_axes(coarse, xp, world):
    starts = draw_starts(world, 12, 0)
    state = world.start(*starts)
    folded = world.start(*(array(xp, part.reshape(3, 4, *part.shape[1:])) for part in starts))
    policy = Optimal(world)
    for _ in range(4):
        action, again = policy.act(world, state), policy.act(world, folded)
        assert to_numpy(again).reshape(-1).tolist() == action.tolist()
        state, _ = world.step(state, action)
        folded, _ = world.step(folded, again)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"life": 1.77},
        {"life": 1.3, "varying_speed": True},
        {"life": 1.2, "curvatures": (3.0, 4.0, 5.0), "interval_rule": "exact"},
    ],
    ids=str,
)
def test_in_the_flow_no_sequence_of_actions_gains_more_than_the_bound_and_one_gains_it(coarse, options):
    world = World(flow=TaylorGreen(), **options)
    starts = draw_starts(world, 40, 1)
    best = best_of_all(world, starts)
    assert bound(world, starts) == pytest.approx(best, abs=0.02)
    assert limit(world, starts) == pytest.approx(best.mean(), abs=2e-3)
    assert gains(world, Optimal(world), starts).mean() == pytest.approx(best.mean(), rel=5e-3)


@pytest.mark.slow
def test_in_the_flow_playing_the_optimal_policy_attains_its_bound_and_no_other_does(coarse):
    world = World(flow=TaylorGreen(), life=40.0)
    starts = draw_starts(world, 200, 0)
    details = limit_details(world, starts)
    assert details.error < 0.01 * details.value
    gain = gains(world, Optimal(world), starts)
    assert gain.mean() == pytest.approx(details.value, rel=0.005)
    for policy in (Greedy(), Swinging(), Random()):
        assert gains(world, policy, starts).mean() < 0.8 * details.value


def test_the_bound_repeats_as_the_flow_does(coarse):
    world = World(flow=TaylorGreen(), life=5.0)
    starts = draw_starts(world, 50, 0)
    half = 0.5 * world.flow.period
    here = bound(world, starts)
    for shift in ((half, half), (-half, half), (2 * half, 0.0), (0.0, -4 * half)):
        there = starts._replace(position=starts.position + np.array(shift))
        assert bound(world, there) == pytest.approx(here, abs=1e-6)
    aside = bound(world, starts._replace(position=starts.position + np.array((half, 0.0))))
    assert abs(aside - here).max() > 0.1


def test_finer_grids_bring_the_limit_nearer_to_its_value_at_third_order():
    problem = problem_of(World(flow=TaylorGreen(), life=30.0))
    grids = [grid_of(problem, places, 24) for places in (8, 16, 32, 48)]
    *means, finest = (deque(backward(problem, grid), maxlen=1)[0][0] for grid in grids)
    orders = -np.diff(np.log2(np.abs(np.array(means) - finest)))
    assert np.all(orders > 2.5), orders


@pytest.mark.slow
def test_fronts_in_a_fast_flow_do_not_overshoot(coarse):
    world = World(flow=TaylorGreen(speed_scale=0.3), life=20.0)
    starts = draw_starts(world, 100, 0)
    details = limit_details(world, starts)
    gain = gains(world, Optimal(world), starts).mean()
    assert 0.97 * details.value < gain < details.value + details.error


def test_with_too_many_times_to_keep_all_tables_the_policy_is_the_same(monkeypatch):
    problem = problem_of(World(flow=TaylorGreen(), life=10.0))
    pose = grid_of(problem, 16, 24).pose(*grid_of(problem, 16, 24).points)
    left = np.full(len(pose.position), problem.times[-4])
    whole = VortexTables.compute(problem, ((16, 24),)).ahead(pose, left)
    monkeypatch.setattr("swarm.optimal.tables.SAMPLES", 14)
    assert VortexTables.compute(problem, ((16, 24),)).ahead(pose, left) == pytest.approx(whole, abs=0.05)


@pytest.fixture
def stored(tmp_path):
    """A problem, its grids and the file that its tables were kept in."""
    problem, grids = problem_of(World(flow=TaylorGreen(), life=1.0)), ((8, 16),)
    store.tables.__wrapped__(VortexTables, problem, grids)
    (path,) = (tmp_path / "cache").glob("*.safetensors")
    return problem, grids, path


@pytest.mark.parametrize("kind", [VortexTables, HelicalLimit])
def test_tables_are_computed_once(kind, stored, monkeypatch, capsys):
    flow = kind is VortexTables
    problem, grids = (stored[0], ((8, 20),)) if flow else (problem_of(World.in_space(life=1.0)), (8, 12))
    capsys.readouterr()
    first = store.tables.__wrapped__(kind, problem, grids)
    assert ("computing it once" in capsys.readouterr().err) == flow
    monkeypatch.setattr(kind, "compute", None)
    again = store.tables.__wrapped__(kind, problem, grids)
    for name, values in first.tensors.items():
        np.testing.assert_array_equal(again.tensors[name], values)
    store.tables.__wrapped__(VortexTables, *stored[:2])
    assert capsys.readouterr().err == ""


DAMAGE = {
    "empty": lambda data: b"",
    "cut": lambda data: data[:-1],
    "huge header": lambda data: b"\xff" * 8 + data[8:],
    "a flipped bit": lambda data: data[:-100] + bytes([data[-100] ^ 1]) + data[-99:],
    "another life": lambda data: data.replace(b'\\"life\\": 1.0', b'\\"life\\": 2.0'),
    "pickle": lambda data: b"\x80\x04" + data,
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_file_is_replaced_and_that_is_said(stored, name, capsys):
    problem, grids, path = stored
    whole = path.read_bytes()
    damaged = DAMAGE[name](whole)
    assert damaged != whole
    path.write_bytes(damaged)
    capsys.readouterr()
    store.tables.__wrapped__(VortexTables, problem, grids)
    assert f"{path} is not used" in capsys.readouterr().err
    assert path.read_bytes() == whole


def test_tables_of_wrong_shape_or_with_nan_are_not_used(stored):
    problem, grids, path = stored
    key = store.key_of(VortexTables, problem, grids)
    shapes = VortexTables.shapes(problem, grids)
    tensors = store.read(path, key, shapes)
    for wrong, why in [
        ({**tensors, "means": tensors["means"][1:]}, "means must be finite"),
        ({**tensors, "means": tensors["means"] * np.nan}, "means must be finite"),
        ({**tensors, "means": tensors["means"].astype(np.float32)}, "means must be finite"),
        ({"means": tensors["means"]}, "its tensors must be"),
    ]:
        store.write(path, key, wrong)
        with pytest.raises(ValueError, match=why):
            store.read(path, key, shapes)


def test_where_nothing_can_be_kept_the_tables_are_there_all_the_same(tmp_path, monkeypatch, capsys):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv(store.CACHE, str(blocked))
    problem = problem_of(World(flow=TaylorGreen(), life=1.0))
    tables = store.tables.__wrapped__(VortexTables, problem, ((8, 16),))
    assert "could not be written" in capsys.readouterr().err
    assert set(tables.tensors) == {"means", "coefficients", "components"}


def test_the_cache_is_where_the_user_wants_it(monkeypatch, tmp_path):
    assert store.cache_folder() == tmp_path / "cache"
    monkeypatch.delenv(store.CACHE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert store.cache_folder() == tmp_path / "chemoswarm"


def test_the_papers_flow_is_shipped(monkeypatch, capsys):
    monkeypatch.setattr(VortexLimit, "compute", None)
    monkeypatch.setattr(VortexTables, "compute", None)
    world = World(flow=TaylorGreen(), life=400.0, sense_flow=True)
    starts = draw_starts(world, 400, 0)
    details = limit_details(world, starts)
    assert details.error < 5e-4 * details.value
    assert 71.0 < details.value < 73.0
    Optimal(world)
    assert capsys.readouterr().err == ""
    assert sum(path.stat().st_size for path in store.SHIPPED.iterdir()) < 3e6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "within"), [({"life": 400.0}, 2e-3), ({"n_records": 2}, 5e-3), ({"n_records": 8}, 5e-3)]
)
def test_in_the_flow_of_the_paper_play_attains_the_limit(options, within):
    world = World(flow=TaylorGreen(), **{"life": 100.0} | options)
    starts = draw_starts(world, 200, 0)
    details = limit_details(world, starts)
    assert details.error < 5e-3 * details.value
    gain, best = gains(world, Optimal(world), starts), bound(world, starts)
    assert gain.mean() == pytest.approx(details.value, rel=within)
    if "n_records" in options:
        return
    assert (gain > best - 1.0).all()
    assert (gain < best + 0.5).all()
    assert gains(world, Greedy(), starts).mean() < 0.6 * best.mean()


@pytest.mark.slow
def test_what_is_shipped_is_what_is_computed(tmp_path):
    for path in optimal.ship(tmp_path):
        problem = problem_of(World(flow=TaylorGreen(), life=400.0))
        kind, grids = (
            (VortexLimit, optimal.GRIDS) if "limit" in path.name else (VortexTables, (optimal.POLICY_GRID,))
        )
        key, shapes = store.key_of(kind, problem, grids), kind.shapes(problem, grids)
        fresh = kind(problem, grids, store.read(path, key, shapes))
        shipped = kind(problem, grids, store.read(store.SHIPPED / path.name, key, shapes))
        assert fresh.tensors["means"] == pytest.approx(shipped.tensors["means"], abs=1e-3)
        if kind is VortexTables:
            grid = grid_of(problem, *grids[0])
            pose = grid.pose(*(part[::7] for part in grid.points))
            left = np.full(len(pose.position), math.floor(0.5 * problem.life_ticks))
            assert fresh.ahead(pose, left) == pytest.approx(shipped.ahead(pose, left), abs=0.02)
