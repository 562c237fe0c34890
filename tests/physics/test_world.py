"""One decision of every cell: kinematics, clock, reward, arrival, and what a life does not depend on."""

import functools
import itertools
import re

import numpy as np
import pytest

from swarm.physics.fields import DiffusingSource, FunctionField, GaussianPlume, LinearField
from swarm.physics.flows import FunctionFlow, PoiseuilleFlow, StillWater, TaylorGreen
from swarm.physics.starts import draw_noise, draw_starts
from swarm.physics.world import World
from tests.reference import array, describe, place_and_heading, reference, to_numpy


@functools.cache
def functions(xp, world):
    """The world's `start` and `step`, in jax compiled: op by op it is slow."""
    if not xp.__name__.startswith("jax"):
        return world.start, world.step
    jax = pytest.importorskip("jax")
    return jax.jit(world.start), jax.jit(world.step)


def begin(xp, world, cells, *, seed=0, dtype=None):
    """The state of `cells` cells at their drawn starts."""
    floats = dtype or xp.float64
    kinds = floats, floats, xp.int64, floats
    parts = zip(draw_starts(world, cells, seed), kinds, strict=False)
    return functions(xp, world)[0](*(array(xp, part, kind) for part, kind in parts))


def present(parts):
    """Those that there are: a state has further ones where cells share what changes."""
    return [part for part in parts if part is not None]


def actions(world, decisions, cells, seed=0):
    return np.random.default_rng(seed).integers(world.n_actions, size=(decisions, cells))


def live(xp, world, cells, decisions, *, seed=0, dtype=None, noise=False):
    """States and outcomes of random actions; noise is that of the cells' own streams."""
    state = begin(xp, world, cells, seed=seed, dtype=dtype)
    states, outcomes = [state], []
    kicks = draw_noise(seed, cells, decisions) if noise else None
    for turn, action in enumerate(actions(world, decisions, cells, seed)):
        kick = array(xp, kicks[:, turn], dtype or xp.float64) if noise else None
        state, outcome = functions(xp, world)[1](state, array(xp, action, xp.int64), kick)
        states.append(state)
        outcomes.append(outcome)
    return states, outcomes


def equal(a, b):
    """Whether two states or outcomes are equal bit by bit."""
    return all(np.array_equal(to_numpy(x), to_numpy(y)) for x, y in zip(a, b, strict=True))


WORLDS = [
    World(
        n_records=n_records,
        flow=flow,
        varying_speed=varying_speed,
        interval_rule=rule,
        curvatures=curvatures,
        life=200.0,
    )
    for flow, varying_speed, rule, (n_records, curvatures) in itertools.product(
        ("still", "taylor_green"),
        (False, True),
        ("truncated", "exact"),
        ((2, (3.0, 5.0)), (3, (2.0, 4.0, 6.0)), (4, (3.0, 5.0)), (5, (3.0, 5.0)), (8, (3.0, 4.0, 5.0))),
    )
]


@functools.cache
def references(index):
    """Poses (decisions, cells, 4) after each interval, every one from where NumPy's cell was before it."""
    world = WORLDS[index]
    states, _ = live(np, world, 6, 4)
    flow = world.flow if world.in_flow else None
    poses = []
    for state, action in zip(states[:-1], actions(world, 4, 6), strict=True):
        curvature, speed, duration = (
            np.asarray(values)[action] for values in (world.curvatures, world.action_speeds, world.intervals)
        )
        poses.append(reference(state.position, state.heading, curvature, speed, duration, flow))
    return poses


@pytest.mark.parametrize("index", range(len(WORLDS)), ids=lambda i: describe(WORLDS[i]))
def test_poses_after_random_actions_are_those_of_the_reference(xp, index):
    world = WORLDS[index]
    states, _ = live(xp, world, 6, 4)
    tolerance = 1e-6 if world.in_flow else 1e-12
    for state, expected in zip(states[1:], references(index), strict=True):
        np.testing.assert_allclose(place_and_heading(state), expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("world", WORLDS[:20:3] + WORLDS[20::3], ids=describe)
def test_swimming_the_past_forward_leads_back_to_the_start(xp, world):
    position, heading, past = draw_starts(world, 5, 1)
    start, step = functions(xp, world)
    state = start(array(xp, position), array(xp, heading), array(xp, past, xp.int64))
    seen = to_numpy(state.memory)
    # the oldest record is where the remembered path began; walk it with the reference
    curvature, speed, interval = (
        np.asarray(values)[past] for values in (world.curvatures, world.action_speeds, world.intervals)
    )
    flow = world.flow if world.in_flow else None
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    here = np.concatenate([position, direction], axis=-1)
    scale = world.record_scale
    for i in range(world.n_records):
        np.testing.assert_allclose(
            seen[:, i, 0] / scale, world.field.concentration(here[:, :2]), rtol=0, atol=1e-5
        )
        np.testing.assert_allclose(seen[:, i, 1], world.normal_curvature(curvature[:, i]), atol=1e-12)
        here = reference(here[:, :2], here[:, 2:], curvature[:, i], speed[:, i], -interval[:, i], flow)
    back = start(
        array(xp, here[:, :2]), array(xp, np.arctan2(here[:, 3], here[:, 2])), array(xp, past, xp.int64)
    )
    for i in reversed(range(world.n_records)):
        back, _ = step(back, array(xp, past[:, i], xp.int64))
    tolerance = 1e-5 if world.in_flow else 1e-11
    np.testing.assert_allclose(to_numpy(back.position), position, rtol=0, atol=tolerance)
    np.testing.assert_allclose(to_numpy(back.heading), direction, rtol=0, atol=tolerance)
    np.testing.assert_allclose(to_numpy(back.memory), seen, rtol=0, atol=tolerance * 10)


KINDS = [
    World(),
    World(n_records=8, varying_speed=True),
    World(n_records=2, flow="taylor_green", sense_flow=True, rotational_diffusion=0.01),
    World(n_records=9, flow="taylor_green", varying_speed=True, interval_rule="exact"),
    World(field="radial", curvatures=(2.0, 3.0, 4.0), start_box=((-4, 4), (-4, 4)), curvature_noise=0.5),
    World(field="diffusing_source", flow="vortex", concentration_noise=0.1, rotational_diffusion=0.1),
]


@pytest.mark.parametrize("world", WORLDS[::7] + KINDS[3:], ids=describe)
def test_every_array_library_computes_the_same_world(xp, world):
    expected, expected_outcomes = live(np, world, 7, 30, noise=world.has_noise)
    states, outcomes = live(xp, world, 7, 30, noise=world.has_noise)
    for ours, theirs in zip(states, expected, strict=True):
        for a, b in zip(present(ours), present(theirs), strict=True):
            np.testing.assert_allclose(to_numpy(a), b, rtol=0, atol=1e-9)
    for ours, theirs in zip(outcomes, expected_outcomes, strict=True):
        for a, b in zip(present(ours), present(theirs), strict=True):
            np.testing.assert_allclose(to_numpy(a), b, rtol=0, atol=1e-5)


@pytest.mark.parametrize("world", WORLDS[::7], ids=describe)
def test_float32_stays_float32(xp, world):
    states, outcomes = live(xp, world, 3, 3, dtype=xp.float32)
    for part in (states[-1].position, states[-1].heading, states[-1].memory, states[-1].start_concentration):
        assert part.dtype == xp.float32
    for part in (outcomes[-1].reward, outcomes[-1].gain, outcomes[-1].observation):
        assert part.dtype == xp.float32
    assert states[-1].clock.dtype == xp.int32
    assert world.time(states[-1]).dtype == xp.float32


@pytest.mark.parametrize(
    "world", [World(), World(flow="taylor_green", sense_flow=True), World(field="radial")], ids=describe
)
def test_a_step_leaves_its_input_as_it_was(xp, world):
    state = begin(xp, world, 5)
    before = state.each(lambda part: to_numpy(part).copy())
    action = array(xp, np.ones(5, int), xp.int64)
    world.step(state, action)
    assert equal(state, before)
    np.testing.assert_array_equal(to_numpy(action), 1)


EXACT = {"varying_speed": True, "interval_rule": "exact"}


@pytest.mark.parametrize(
    ("options", "intervals"),
    [
        *(({"n_records": n}, (interval,) * 2) for n, interval in ((2, 0.78), (4, 0.38), (8, 0.18))),
        ({"varying_speed": True}, (0.34, 0.42)),  # of the speed in use
        (EXACT, (np.pi / 8 / 1.1, np.pi / 8 / 0.9)),
        ({"speed": 2 * np.pi / 3.2}, (0.2, 0.2)),  # T/(4 Δt) is 10 but for rounding, and not cut down to 9
    ],
    ids=str,
)
def test_intervals_are_whole_time_steps_below_the_period_or_exact(options, intervals):
    assert World(**options).intervals == pytest.approx(intervals, abs=1e-15, rel=1e-15)


LIVES = [
    (world.replace(life=life), decisions)
    for world, life, decisions in [
        (World(), 80.0, 211),
        (World(), 0.4, 2),
        (World(), 0.01, 1),
        (World(), 3.8, 10),
        (World(), 1.234567, 4),
        (World(n_records=8), 3.8, 22),
        (World(interval_rule="exact"), 3.8, 10),
        (World(interval_rule="exact"), 4 * np.pi / 8, 4),
        (World(flow="taylor_green"), 1.234567, 4),
        (World(varying_speed=True), 1.234567, 4),
        (World(varying_speed=True, interval_rule="exact"), 1.234567, 4),
        (World(varying_speed=True, interval_rule="exact", flow="taylor_green"), 3.0, 9),
    ]
]


@pytest.mark.parametrize(
    ("world", "decisions"), LIVES, ids=lambda v: f"{v}" if isinstance(v, int) else describe(v)
)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_clocks_end_at_exactly_the_life(xp, world, decisions, dtype):
    dtype = getattr(xp, dtype)
    state = begin(xp, world, 4, dtype=dtype)
    elapsed = np.zeros(4)
    ended = np.zeros(4, int)
    for turn, action in enumerate(actions(world, world.max_decisions + 2, 4)):
        before = state
        time_before = to_numpy(world.time(state))
        state, outcome = functions(xp, world)[1](state, array(xp, action, xp.int64))
        time = to_numpy(world.time(state))
        assert np.all(time >= time_before)
        assert np.all(time <= dtype_of(time)(world.life))
        np.testing.assert_array_equal(to_numpy(outcome.truncated), time == dtype_of(time)(world.life))
        ended = np.where(to_numpy(before.finished), ended, turn + 1)
        elapsed = time
        assert not np.any(to_numpy(outcome.terminated))
    np.testing.assert_array_equal(elapsed, dtype_of(elapsed)(world.life))
    assert world.max_decisions == decisions
    assert ended.max() <= decisions
    if not world.varying_speed:
        np.testing.assert_array_equal(ended, decisions)


def dtype_of(values):
    return values.dtype.type


@pytest.mark.parametrize("world", [life[0] for life in LIVES if not life[0].in_flow], ids=describe)
def test_a_life_turns_by_curvature_times_path_up_to_its_last_sliver(world):
    # turns add up, so the heading at the end tells how long the cell has swum in all
    state = begin(np, world, 4)
    angle = world.heading_angle(state)
    remaining = np.full(4, world.life)
    for action in actions(world, world.max_decisions, 4):
        curvature, speed, interval = (
            np.asarray(values)[action] for values in (world.curvatures, world.action_speeds, world.intervals)
        )
        duration = np.minimum(interval, remaining)
        remaining = np.maximum(remaining - duration, 0)
        remaining[remaining < 1e-12] = 0
        angle = angle + curvature * speed * duration
        state, _ = world.step(state, action)
    np.testing.assert_allclose(remaining, 0)
    np.testing.assert_allclose(state.heading, np.stack([np.cos(angle), np.sin(angle)], -1), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("world", "decisions"),
    [
        (
            World(life=5 * World(**EXACT).intervals[0], **EXACT),
            (5, 5),
        ),  # whole intervals of one, or of the other
        (World(life=5 * World(**EXACT).intervals[1], **EXACT), (7, 5)),
        (World(varying_speed=True, life=1.26), (4, 3)),  # four intervals of 0.34, or three of 0.42
    ],
    ids=["exact_fast", "exact_slow", "truncated"],
)
def test_cells_with_different_clocks_end_at_different_steps(xp, world, decisions):
    state = begin(xp, world, 2)
    for turn in range(1, max(decisions) + 1):
        state, outcome = functions(xp, world)[1](state, array(xp, [0, 1], xp.int64), None)
        assert to_numpy(outcome.truncated).tolist() == [turn >= each for each in decisions]


@pytest.mark.parametrize(
    "world",
    [
        World(),
        World(n_records=8, varying_speed=True, life=7.7),
        World(n_records=3, flow="taylor_green"),
        World(field=LinearField(gradient_scale=3.0, offset=-2.0), curvatures=(1.0, 4.0)),
        World(n_records=2, field="gaussian_plume", flow="vortex"),
    ],
    ids=describe,
)
def test_rewards_telescope_to_the_change_of_the_memories_mean(xp, world):
    decisions = 25 if world.life > 25 else world.max_decisions
    states, outcomes = live(xp, world, 4, decisions)
    total = sum(to_numpy(outcome.reward) for outcome in outcomes)
    c_k, n = world.field.gradient_scale, world.n_records
    contrast = c_k * abs(1 / world.curvatures[0] - 1 / world.curvatures[-1])
    means = [to_numpy(s.memory)[..., 0].mean(axis=-1) / world.record_scale for s in (states[0], states[-1])]
    alive = ~to_numpy(states[-2].finished)
    np.testing.assert_allclose(total[alive], ((means[1] - means[0]) / contrast)[alive], rtol=0, atol=1e-11)
    # and one reward is the newest minus the oldest record over N_T c_k |1/κ₁ − 1/κ₂|
    first, newest, last = (world.field.concentration(to_numpy(states[i].position)) for i in (0, 1, -1))
    np.testing.assert_allclose(to_numpy(outcomes[-1].gain), last - first, rtol=0, atol=1e-12)
    oldest = to_numpy(states[0].memory)[:, -1, 0] / world.record_scale
    np.testing.assert_allclose(
        to_numpy(outcomes[0].reward), (newest - oldest) / (n * contrast), rtol=0, atol=1e-12
    )


BOUNDED = [
    World(),
    World(n_records=7, varying_speed=True),
    World(flow="taylor_green", sense_flow=True),
    World(flow=TaylorGreen(speed_scale=2.0, wavenumber=1.0), sense_flow=True, n_records=2),
    World(flow="vortex", sense_flow=True, field="gaussian_plume"),
    World(flow="uniform", sense_flow=True, field="diffusing_source"),
    World(flow="poiseuille", sense_flow=True, life=3.0, curvature_noise=1.0),
    World(field="radial", n_records=3, rotational_diffusion=0.5),
    World(
        flow=FunctionFlow(TaylorGreen().velocity, 0.05, 0.01, max_speed=0.1, max_spin=0.032), sense_flow=True
    ),
]


@pytest.mark.parametrize("world", BOUNDED, ids=describe)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_observations_stay_within_their_bounds(world, dtype):
    bounds = world.observation_bounds
    assert bounds.dtype == np.float32
    assert np.all(np.isfinite(bounds))
    states, outcomes = live(np, world, 200, 40, dtype=dtype, noise=world.has_noise)
    for seen in [world.observation(states[0]), *(outcome.observation for outcome in outcomes)]:
        assert seen.dtype == np.float32
        assert np.all(np.abs(seen) <= bounds)


def test_straight_towards_the_gradient_the_bound_is_reached_closely():
    # nearly straight swimmers along the gradient: the oldest of two records differs most from the mean
    world = World(n_records=2, curvatures=(1e-3, 1.1e-3), time_step=1.0, life=1e5)
    state = world.start(np.zeros((1, 2)), np.array([np.pi / 2 + 1.5]), np.ones((1, 2), int))
    largest = 0.0
    for _ in range(4):
        state, outcome = world.step(state, np.zeros(1, int))
        largest = max(largest, np.abs(outcome.observation[0, ::2]).max())
    assert largest > 0.2 * world.observation_bounds[0]


def test_without_a_known_bound_the_observation_may_be_any_float32():
    world = World(field=FunctionField(lambda r: r[..., 1], 1.0))
    assert world.observation_bounds[0] == np.finfo(np.float32).max
    assert world.observation_bounds[1] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    "world",
    [
        World(field="radial", n_records=2, start_box=((-2, 2), (-2, 2))),
        World(
            field="radial",
            curvatures=(0.2, 2.0),
            start_box=((-2, 2), (-2, 2)),
            varying_speed=True,
            n_records=9,
        ),
        World(field="radial", flow="taylor_green", start_box=((-2, 2), (-2, 2))),
        World(field=GaussianPlume(egg_position=(1.0, -1.0), egg_radius=0.3), start_box=((0, 2), (-2, 0))),
        World(
            field=DiffusingSource(egg_radius=0.5, egg_position=(1.0, -1.0)),
            flow="vortex",
            start_box=((-1, 3), (-3, 1)),
            n_records=2,
        ),
        World(field="radial", curvature_noise=0.9, n_records=2, start_box=((-2, 2), (-2, 2))),
    ],
    ids=describe,
)
def test_a_cell_has_arrived_when_its_path_not_only_its_end_comes_within_reach(xp, world):
    cells = 80
    states, outcomes = live(xp, world, cells, 3, noise=world.has_noise)
    kicks = world.curvature_noise * draw_noise(0, cells, 3)[..., 1]
    (x, y), radius = world.egg
    flow = world.flow if world.in_flow else None
    arrived = np.zeros(cells, bool)
    passed_by = 0
    for before, outcome, action, kick in zip(
        states[:-1], outcomes, actions(world, 3, cells), kicks.T, strict=True
    ):
        position, heading = to_numpy(before.position), to_numpy(before.heading)
        curvature, speed, interval = (
            np.asarray(values)[action] for values in (world.curvatures, world.action_speeds, world.intervals)
        )
        parts = np.linspace(0, 1, 400)
        along = reference(position, heading, curvature + kick, speed, interval, flow, parts=parts)[..., :2]
        distances = np.linalg.norm(along - np.array([x, y]), axis=-1)
        terminated = to_numpy(outcome.terminated)
        nearest = distances.min(axis=0)
        # a flow's path is tested at least every Δt, so the last 1e-4 of a graze may be missed
        clear = np.abs(nearest - radius) > 2e-4
        expected = (nearest <= radius) & ~arrived
        np.testing.assert_array_equal((terminated & ~arrived)[clear], expected[clear])
        passed_by += np.sum(terminated & (distances[-1] > radius))
        arrived |= terminated
        assert not np.any(to_numpy(outcome.truncated) & terminated)
    assert 3 < arrived.sum() < cells
    assert passed_by > 0


NEAR = {"field": "radial", "start_box": ((-2, 2), (-2, 2))}


@pytest.mark.parametrize(
    ("world", "decisions"),
    [
        (World(**NEAR), 12),
        (World(**NEAR, **EXACT), 12),
        (World(life=1.0, varying_speed=True), 8),
        (World(life=1.0, flow="taylor_green", varying_speed=True), 8),
        (World(flow=PoiseuilleFlow(walls=(0.0, 2.0))), 30),
    ],
    ids=lambda v: f"{v}" if isinstance(v, int) else describe(v),
)
def test_who_has_arrived_or_left_or_is_out_of_time_stays_where_it_is(xp, world, decisions):
    states, outcomes = live(xp, world, 40, decisions)
    for before, after, outcome in zip(states[:-1], states[1:], outcomes, strict=True):
        done, over = to_numpy(before.finished), to_numpy(after.finished)
        np.testing.assert_allclose(
            place_and_heading(after)[done], place_and_heading(before)[done], rtol=0, atol=1e-14
        )
        np.testing.assert_array_equal(to_numpy(after.clock)[done], to_numpy(before.clock)[done])
        np.testing.assert_array_equal(over, done | to_numpy(outcome.truncated | outcome.terminated))
        assert not np.any(to_numpy(outcome.terminated)[done])
        if world.domains:  # who leaves ends where it was last inside
            stays = np.all(to_numpy(after.position) == to_numpy(before.position), axis=-1)
            np.testing.assert_array_equal(stays, over)
    ended = to_numpy(states[-1].finished)
    assert ended.all() if world.life == 1.0 else 0 < ended.sum() < 40
    if world.life == 1.0:
        np.testing.assert_array_equal(to_numpy(outcomes[-1].gain), to_numpy(outcomes[2].gain))
        assert np.all(to_numpy(outcomes[-1].truncated))


@pytest.mark.parametrize("world", KINDS, ids=describe)
@pytest.mark.parametrize("library", ["numpy", "array_api_compat.torch"])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_cells_life_is_the_same_in_a_population_of_1_40_and_10_000(world, dtype, library):
    xp = pytest.importorskip(library)
    decisions = 6
    dtype = getattr(xp, dtype)
    starts = draw_starts(world, 10_000, 3)
    noise = draw_noise(3, 10_000, decisions)
    action = actions(world, decisions, 10_000)

    def end(rows):
        position, heading = (array(xp, part[rows], dtype) for part in starts[:2])
        state = world.start(position, heading, array(xp, starts.past[rows], xp.int64))
        for turn in range(decisions):
            kicks = array(xp, noise[rows, turn], dtype)
            state, outcome = world.step(state, array(xp, action[turn, rows], xp.int64), kicks)
        return state, outcome

    whole = end(slice(None))
    for rows in (slice(0, 1), slice(0, 40), slice(7, 8), slice(9_999, 10_000), slice(0, 10_000, 2)):
        for part, of_all in zip(end(rows), whole, strict=True):
            assert equal(present(part), [values[rows] for values in present(of_all)])


@pytest.mark.parametrize("rule", ["truncated", "exact"])
@pytest.mark.parametrize("flow", ["still", "taylor_green"])
def test_leading_axes_are_many_worlds(xp, flow, rule):
    world = World(flow=flow, sense_flow=flow != "still", varying_speed=True, interval_rule=rule)
    position, heading, past = draw_starts(world, 12, 0)
    action = actions(world, 3, 12)

    def run(shape):
        start, step = functions(xp, world)
        state = start(
            array(xp, position.reshape(*shape, 2)),
            array(xp, heading.reshape(shape)),
            array(xp, past.reshape(*shape, 4), xp.int64),
        )
        for turn in action:
            state, outcome = step(state, array(xp, turn.reshape(shape), xp.int64))
        return state, outcome

    flat, many = run((12,)), run((2, 3, 2))
    for of_flat, of_many in zip(flat, many, strict=True):
        for a, b in zip(present(of_flat), present(of_many), strict=True):
            assert b.shape[:3] == (2, 3, 2)
            np.testing.assert_allclose(
                to_numpy(b).reshape(to_numpy(a).shape), to_numpy(a), rtol=0, atol=1e-13
            )


def test_perturbations_move_nothing_else():
    quiet = World()
    loud = World(concentration_noise=1.0, curvature_noise=0.5, rotational_diffusion=0.1)
    for ours, theirs in zip(draw_starts(quiet, 9, 4), draw_starts(loud, 9, 4), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert equal(begin(np, quiet, 9), begin(np, loud, 9))
    # each channel has its own numbers: what one of them does is the same with or without the others
    noise = draw_noise(0, 9, 1)[:, 0]
    action = np.zeros(9, int)
    _, both = quiet.replace(curvature_noise=0.5, concentration_noise=1.0).step(
        begin(np, quiet, 9), action, noise
    )
    _, one = quiet.replace(curvature_noise=0.5).step(begin(np, quiet, 9), action, noise)
    np.testing.assert_array_equal(both.gain, one.gain)
    assert np.all(both.reward != one.reward)


CROWD = 20_000


def one_step(world, seed=0):
    state = world.start(np.zeros((CROWD, 2)), np.zeros(CROWD), np.zeros((CROWD, world.n_records), int))
    noise = draw_noise(seed, CROWD, 1)[:, 0]
    return state, *world.step(state, np.ones(CROWD, int), noise)


def test_concentration_noise_is_in_the_record_and_not_in_the_gain():
    quiet, loud = World(), World(concentration_noise=0.25)
    _, after, outcome = one_step(loud)
    _, still, undisturbed = one_step(quiet)
    np.testing.assert_array_equal(outcome.gain, undisturbed.gain)
    np.testing.assert_array_equal(place_and_heading(after), place_and_heading(still))
    error = (after.memory - still.memory)[:, 0, 0] / loud.record_scale
    np.testing.assert_allclose(error, 0.25 * draw_noise(0, CROWD, 1)[:, 0, 0], rtol=0, atol=1e-12)
    assert abs(error.mean()) < 4 * 0.25 / CROWD**0.5
    assert error.std() == pytest.approx(0.25, rel=0.03)
    np.testing.assert_array_equal(after.memory[:, 1:], still.memory[:, 1:])
    np.testing.assert_allclose(
        outcome.reward - undisturbed.reward, error * loud.record_scale * loud.reward_scale, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("options", [{}, EXACT], ids=str)
def test_curvature_noise_spreads_the_turn_but_is_not_seen(options):
    loud = World(curvature_noise=0.4, **options)
    _, after, _ = one_step(loud)
    turn, path = loud.heading_angle(after), loud.action_speeds[1] * loud.intervals[1]
    noise = draw_noise(0, CROWD, 1)[:, 0, 1]
    np.testing.assert_allclose(turn, (5 + 0.4 * noise) * path, rtol=0, atol=1e-12)
    assert turn.std() == pytest.approx(0.4 * path, rel=0.03)
    np.testing.assert_array_equal(after.memory[:, 0, 1], 1.0)


def test_rotational_diffusion_turns_headings_by_the_square_root_of_2_d_t():
    loud = World(rotational_diffusion=0.02)
    _, after, _ = one_step(loud)
    turn = loud.heading_angle(after)
    assert turn.mean() == pytest.approx(5 * 0.38, abs=4 * 0.13 / CROWD**0.5)
    assert turn.std() == pytest.approx((2 * 0.02 * 0.38) ** 0.5, rel=0.03)
    np.testing.assert_array_equal(after.position, one_step(World())[1].position)


@pytest.mark.parametrize("channel", ["concentration_noise", "curvature_noise", "rotational_diffusion"])
def test_a_perturbed_world_needs_noise_of_every_cell(channel):
    world = World(**{channel: 0.1})
    state = begin(np, world, 3)
    for noise in (None, np.zeros((3, 2)), np.zeros((1, 3)), np.zeros(3)):
        got = None if noise is None else noise.shape
        rule = rf"noise must be standard normal numbers \(3, 3\), .* got {re.escape(str(got))}$"
        with pytest.raises(ValueError, match=rule):
            world.step(state, np.zeros(3, int), noise)


SPREAD = {"spread": {"speed": 0.1}}
PAST = np.zeros((3, 4), int)
BAD_STARTS = [
    (
        {},
        {"position": np.zeros((3, 3))},
        r"position must be floating numbers \(\.\.\., cells, 2\), got \S*float64",
    ),
    ({}, {"position": np.zeros((3, 2), int)}, r"position must be floating numbers .* got \S*int64"),
    ({}, {"position": np.zeros(2)}, r"position must be floating numbers .* got \S*float64 \(2,\)"),
    (
        {},
        {"position": np.array([[0, 0], [np.nan, 0], [0, 0]])},
        "position must be finite, got nan, 0 for cell 1",
    ),
    ({}, {"heading": np.zeros((3, 1))}, r"heading must be \(3,\) like the cells of position, got \(3, 1\)"),
    ({}, {"heading": np.array([0, 0, np.inf])}, "heading must be finite, got inf for cell 2"),
    ({}, {"past": PAST[:, :2]}, r"past must be whole numbers \(3, 4\), got \S*int64 \(3, 2\)"),
    ({}, {"past": 0.0 * PAST}, r"past must be whole numbers \(3, 4\), got \S*float64"),
    ({}, {"past": PAST + 2}, "past must hold actions from 0 to 1, got 2, 2, 2, 2 for cell 0"),
    ({}, {"past": PAST - 1}, "past must hold actions from 0 to 1, got -1"),
    ({}, {"factors": np.ones((3, 2))}, r"factors must be \(3, 2\), and go with a world that has a spread"),
    (SPREAD, {"factors": np.ones((2, 2))}, r"factors must be \(3, 2\), .* got \(2, 2\)"),
    (SPREAD, {"factors": np.ones((3, 2)) * [1, -1]}, "factors must be positive, got 1, -1 for cell 0"),
    (SPREAD, {"factors": np.full((3, 2), np.inf)}, "factors must be positive, got inf, inf for cell 0"),
    ({}, {"noise": np.zeros((3, 3))}, r"noise must be standard normal numbers \(3, 4\), got \(3, 3\)"),
    ({}, {"medium": 3}, "medium must be a MediumState, .* got int and medium=None"),
    (
        {"field": "radial", "first_arrivals": 4},
        {},
        "first_arrivals must be at most the number of cells, 3, got 4",
    ),
]


@pytest.mark.parametrize(("options", "changed", "message"), BAD_STARTS)
def test_a_start_that_no_life_can_begin_with_is_an_error(xp, options, changed, message):
    given = {"position": np.full((3, 2), 2.0), "heading": np.zeros(3), "past": PAST} | changed
    with pytest.raises(ValueError, match=f"^{message}"):
        World(**options).start(
            **{name: array(xp, v) if hasattr(v, "shape") else v for name, v in given.items()}
        )


def test_still_water_is_never_integrated():
    class Fails(StillWater):
        def velocity(self, position):
            raise AssertionError

        spin = velocity

    live(np, World(flow=Fails()), 3, 3)


@pytest.mark.parametrize("world", KINDS, ids=describe)
def test_the_way_that_torch_compiles_is_the_way_of_all(monkeypatch, world):
    torch = pytest.importorskip("torch")
    plain = live(torch, world, 5, 8, noise=world.has_noise)
    monkeypatch.setattr("swarm._support.compiler.compiling", lambda array: True)
    monkeypatch.setattr("swarm._support.arrays.compiling", lambda array: True)
    in_pieces = live(torch, world, 5, 8, noise=world.has_noise)
    for one, other in zip(plain[0] + plain[1], in_pieces[0] + in_pieces[1], strict=True):
        for a, b in zip(present(one), present(other), strict=True):
            np.testing.assert_allclose(to_numpy(a), to_numpy(b), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("world", "tolerance"),
    [(World(), 5e-5), (World(varying_speed=True), 5e-5), (World(flow="taylor_green"), 5e-3)],
    ids=["still", "varying", "flow"],
)
def test_a_life_in_float32_stays_close_to_one_in_float64(world, tolerance):
    # benchmarks/float32_cost.py prints the numbers: 1e-6 per interval; in a flow neighbouring paths part
    single, double = (
        live(np, world, 20, world.max_decisions, dtype=dtype)[0] for dtype in (np.float32, np.float64)
    )
    error = np.abs(place_and_heading(single[-1]) - place_and_heading(double[-1])).max()
    print(f"after {world.life:g} time units: {error:.1e}")
    assert error < tolerance
    assert np.abs(place_and_heading(single[1]) - place_and_heading(double[1])).max() < 5e-6
