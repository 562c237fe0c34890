"""Three dimensions: helices against closed forms and an adaptive integrator, and lives in space."""

import functools

import numpy as np
import pytest

import swarm
from swarm.physics.motion import arc, helix
from swarm.physics.motion.arc import Pose
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from tests.physics.test_world import functions
from tests.reference import (
    array,
    matrix,
    place_and_frame,
    reference_in_space,
    rotations,
    to_numpy,
)

CELLS = 12
PAIRS = [(5.5, 7.7), (7.5, -5.7), (-4.0, 3.0), (3.0, 0.0), (0.0, 4.0), (1e-9, 1e-9), (0.0, 0.0)]


@pytest.fixture
def poses(xp):
    """Poses of some cells."""
    places = np.random.default_rng(1).uniform(0, 10, (CELLS, 3))
    return Pose(array(xp, places), array(xp, rotations(CELLS)))


def along(xp, poses, curvature, torsion, speed, duration):
    numbers = (array(xp, np.full(CELLS, float(each))) for each in (curvature, torsion, speed, duration))
    return helix.along_helix(poses, helix.helix(*numbers))


@pytest.mark.parametrize("duration", [0.08, 1.7, -0.3])
@pytest.mark.parametrize(("curvature", "torsion"), PAIRS)
def test_in_still_water_the_pose_is_exact(xp, poses, curvature, torsion, duration):
    after = place_and_frame(along(xp, poses, curvature, torsion, 2.0, duration))
    start = Pose(*map(to_numpy, poses))
    expected = reference_in_space(start, curvature, torsion, 2.0, duration)
    np.testing.assert_allclose(after, expected, rtol=0, atol=2e-11)


def test_a_full_turn_is_a_pitch_along_the_darboux_axis_and_no_rotation(xp, poses):
    curvature, torsion, speed = 3.0, 2.0, 1.5
    w = np.hypot(curvature, torsion)
    after = along(xp, poses, curvature, torsion, speed, 2 * np.pi / (speed * w))
    t, n, b = np.moveaxis(matrix(poses.heading), -2, 0)
    axis = (torsion * t + curvature * b) / w
    pitch = 2 * np.pi * torsion / w**2
    np.testing.assert_allclose(to_numpy(after.position - poses.position), pitch * axis, rtol=0, atol=1e-14)
    np.testing.assert_allclose(matrix(after.heading), matrix(poses.heading), rtol=0, atol=1e-14)
    # half a turn leads round the axis, at the distance κ/w² on the normal, to the other side
    half = to_numpy(
        along(xp, poses, curvature, torsion, speed, np.pi / (speed * w)).position - poses.position
    )
    expected = 0.5 * pitch * axis + 2 * curvature / w**2 * n
    np.testing.assert_allclose(half, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("curvature", [5.0, -3.0, 1e-6, 0.0])
@pytest.mark.parametrize("length", [0.08, 3.0, -0.5])
def test_without_torsion_it_is_the_arc_of_the_plane(xp, curvature, length):
    kappa, zero, one = (array(xp, [each]) for each in (curvature, 0.0, 1.0))
    screw = helix.helix(kappa, zero, one, length * one)
    (x, ahead), (y, aside) = map(to_numpy, arc.arc(kappa, one, length * one))
    expected = [[x[0], y[0], 0.0]]
    np.testing.assert_allclose(to_numpy(screw.displacement), expected, rtol=0, atol=1e-15)
    heading = to_numpy(helix.tangent(screw.rotation))
    np.testing.assert_allclose(heading, [[ahead[0], aside[0], 0.0]], rtol=0, atol=1e-15)


def test_frames_turn_as_matrices_do(xp, poses):
    first, second = poses.heading, array(xp, rotations(CELLS, 2))
    for found, expected in zip(helix.frame(first), np.moveaxis(matrix(first), -2, 0), strict=True):
        np.testing.assert_allclose(to_numpy(found), expected, rtol=0, atol=1e-15)
    both = matrix(helix.product(first, second))
    np.testing.assert_allclose(both, matrix(second) @ matrix(first), rtol=0, atol=1e-14)
    there = helix.rotated(first, poses.position)
    expected = np.einsum("cij,ci->cj", matrix(first), to_numpy(poses.position))
    np.testing.assert_allclose(to_numpy(there), expected, rtol=0, atol=1e-13)
    back = helix.rotated(helix.conjugate(first), there)
    np.testing.assert_allclose(to_numpy(back), to_numpy(poses.position), rtol=0, atol=1e-13)
    turn = helix.turned_about(helix.tangent(first), array(xp, np.full(CELLS, 0.3)))
    turned = helix.rotated(turn, helix.frame(first)[1])
    cosine = np.sum(to_numpy(turned) * to_numpy(helix.frame(first)[1]), axis=-1)
    np.testing.assert_allclose(cosine, np.cos(0.3), rtol=0, atol=1e-14)


def test_frames_stay_of_unit_length_in_float32(xp):
    pose = Pose(array(xp, np.zeros((CELLS, 3)), xp.float32), array(xp, rotations(CELLS), xp.float32))
    ones = array(xp, np.ones(CELLS), xp.float32)
    step = helix.helix(5 * ones, 7 * ones, ones, 0.2 * ones)
    for _ in range(200):
        pose = helix.along_helix(pose, step)
    assert pose.position.dtype == pose.heading.dtype == xp.float32
    np.testing.assert_allclose(np.linalg.norm(to_numpy(pose.heading), axis=-1), 1, rtol=0, atol=3e-7)


@pytest.mark.parametrize("turn", [0.4, 1.5, 9.0])
@pytest.mark.parametrize("pair", [(5.5, 7.7), (7.5, -1.0), (0.5, 20.0), (0.0, 0.0)])
def test_the_closest_approach_is_that_of_a_densely_sampled_helix(xp, pair, turn):
    curvature, torsion = (np.full(400, each) for each in pair)
    length = np.full(400, turn / max(np.hypot(*pair), 1.0))
    radius = max(length[0], 0.2)
    pose = Pose(np.random.default_rng(2).normal(0, radius, (400, 3)), rotations(400, 3))
    point, cells = (0.1, -0.2, 0.05), int(np.ceil(turn / helix.CELL))
    given = (
        Pose(*(array(xp, each) for each in pose)),
        *(array(xp, each) for each in (curvature, torsion, length)),
    )
    closest = to_numpy(helix.closest_approach(*given, point, cells))
    parts = np.linspace(0, 1, 1001)[:, None] * length
    path = helix.along(pose, helix.screw(curvature, torsion, parts)).position
    sampled = np.linalg.norm(path - np.array(point), axis=-1).min(axis=0)
    step = length[0] / 1000
    assert np.all(closest <= sampled * (1 + 1e-9))
    assert np.all(closest >= sampled - step / 2)
    assert np.all(closest >= np.sqrt(np.maximum(sampled**2 - 1.1 * (step / 2) ** 2, 0)) - 2 * step**2)


SPACE = World.in_space(life=3.0)


def lived(xp, world, decisions, dtype=None):
    """States of a few cells under random actions, and the actions."""
    position, heading, past = draw_starts(world, 6, 0)
    start, step = functions(xp, world)
    dtype = dtype or xp.float64
    state = start(array(xp, position, dtype), array(xp, heading, dtype), array(xp, past, xp.int64))
    chosen, states = np.random.default_rng(0).integers(world.n_actions, size=(decisions, 6)), [state]
    for action in chosen:
        states.append(step(states[-1], array(xp, action, xp.int64))[0])
    return states, chosen


WORLDS = {
    "default": SPACE,
    "three_actions": World.in_space(curvatures=(4, 5, 6), torsions=(1.0, -2.0, 0.0), n_records=2),
    "varying_speed": World.in_space(varying_speed=True, interval_rule="exact", n_records=8),
}


@pytest.mark.parametrize("name", WORLDS)
def test_lives_in_still_water_are_those_of_the_reference(xp, name):
    world = WORLDS[name]
    states, chosen = lived(xp, world, 4)
    for before, after, action in zip(states, states[1:], chosen, strict=False):
        options = world.curvatures, world.torsions, world.action_speeds, world.intervals
        given = (np.asarray(values)[action] for values in options)
        expected = reference_in_space(Pose(*map(to_numpy, before[:2])), *given)
        np.testing.assert_allclose(place_and_frame(after), expected, rtol=0, atol=2e-11)
        np.testing.assert_allclose(to_numpy(world.torsion(after)), np.asarray(world.torsions)[action])


@pytest.mark.parametrize("name", WORLDS)
def test_swimming_the_past_forward_leads_back_to_the_start(xp, name):
    world = WORLDS[name]
    position, heading, past = draw_starts(world, 5, 1)
    start, step = functions(xp, world)
    records = to_numpy(start(array(xp, position), array(xp, heading), array(xp, past, xp.int64)).memory)
    here = Pose(position, heading)
    for i in range(world.n_records):
        sensed = world.field.concentration(here.position) * world.record_scale
        np.testing.assert_allclose(records[:, i, 0], sensed, rtol=0, atol=1e-11)
        options = world.curvatures, world.torsions, world.action_speeds, world.intervals
        curvature, torsion, speed, interval = (np.asarray(values)[past[:, i]] for values in options)
        here = helix.along_helix(here, helix.helix(curvature, torsion, speed, -interval))
    back = start(*(array(xp, each) for each in here), array(xp, past, xp.int64))
    for i in reversed(range(world.n_records)):
        back, _ = step(back, array(xp, past[:, i], xp.int64))
    np.testing.assert_allclose(to_numpy(back.position), position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(matrix(back.heading), matrix(heading), rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("field", ["linear", "radial"])
def test_torchs_compiler_follows_a_decision(field):
    torch = pytest.importorskip("torch")
    world = World.in_space(field=field, start_box=((-2, 2),) * 3)
    starts = [torch.from_numpy(each) for each in draw_starts(world, 8, 0)]
    state = world.start(*starts)
    compiled = torch.compile(world.step, fullgraph=True, backend="eager")
    action = starts[2][:, 0]
    plain = world.step(state, action)[1]  # fills the tables that the compiled code takes as given
    for found, expected in zip(compiled(state, action)[1], plain, strict=True):
        torch.testing.assert_close(found, expected)


def test_starts_are_uniform_over_rotations_and_the_same_for_every_memory():
    position, heading, _ = draw_starts(SPACE, 20_000, 0)
    np.testing.assert_allclose(np.linalg.norm(heading, axis=-1), 1, rtol=0, atol=1e-15)
    rows = matrix(heading)
    np.testing.assert_allclose(rows.mean(axis=0), 0, atol=0.02)  # five standard deviations of a mean
    np.testing.assert_allclose((rows**2).mean(axis=0), 1 / 3, atol=0.011)
    np.testing.assert_allclose(position.mean(axis=0), 5, atol=0.11)
    few = draw_starts(SPACE.replace(n_records=8), 7, 0)
    assert np.array_equal(few.position, position[:7])
    assert np.array_equal(few.heading, heading[:7])


def test_the_centre_moves_along_the_axis_of_the_helix():
    world = World.in_space(curvatures=(4.0, 5.0), torsions=(2.0, 2.0))
    begun, _ = world.step(world.start(*draw_starts(world, 5, 0)), np.zeros(5, int))
    ended = functools.reduce(lambda now, _: world.step(now, np.zeros(5, int))[0], range(40), begun)
    t, _, b = helix.frame(begun.heading)
    drift = world.speed * 2.0 / 20 * (2.0 * t + 4.0 * b) * 40 * world.intervals[0]
    np.testing.assert_allclose(world.centre(ended) - world.centre(begun), drift, rtol=0, atol=1e-12)
    np.testing.assert_allclose(world.direction(begun), t)
    assert world.orientation(begun) is begun.heading


def test_noise_of_the_curvature_leaves_the_torsion():
    world = World.in_space(curvature_noise=0.5, binding_rate=3.0)
    state = world.start(*draw_starts(world, 6, 0))
    noise = np.random.default_rng(0).random((6, 4))
    after, _ = world.step(state, np.ones(6, int), noise)
    kappa, interval = world.curvatures[1] + 0.5 * noise[:, 1], world.intervals[1]
    expected = reference_in_space(state.pose, kappa, world.torsions[1], 2.0, interval)
    np.testing.assert_allclose(place_and_frame(after), expected, rtol=0, atol=2e-11)


def test_an_egg_is_reached_on_the_way():
    world = World.in_space(field="radial", start_box=((-1.2, 1.2),) * 3, n_records=2)
    starts = draw_starts(world, 400, 3)
    assert np.linalg.norm(starts.position, axis=-1).min() > 1
    state = world.start(*starts)
    after, outcome = world.step(state, np.zeros(400, int))
    parts = np.linspace(0, world.intervals[0], 500)[:, None] * np.ones(400)
    arcs = np.full(400, world.curvatures[0]), np.full(400, world.torsions[0])
    path = helix.along(state.pose, helix.screw(*arcs, 2.0 * parts)).position
    reached = (np.linalg.norm(path, axis=-1) <= 1).any(axis=0)
    assert reached.sum() > 5
    np.testing.assert_array_equal(outcome.terminated, reached)
    np.testing.assert_array_equal(after.finished, reached)


def test_a_population_is_tested_and_kept_in_space(tmp_path):
    from swarm.population.results import load_population, save_population, world_of

    policies = {"greedy": swarm.Greedy(), "random": swarm.Random(), "swinging": swarm.Swinging()}
    results = swarm.population_test(SPACE, policies, cells=4, life=1.0)
    assert results["heading"].dims == ("policy", "cell", "decision", "quaternion")
    assert list(results["axis"].values) == ["x", "y", "z"]
    rise = results["position"].sel(axis="z").isel(decision=-1) - results["start_position"].sel(axis="z")
    np.testing.assert_allclose(results["gain"], rise, atol=1e-5)
    assert "limit" not in results.attrs
    save_population(results, tmp_path / "population.nc")
    kept = load_population(tmp_path / "population.nc")
    assert world_of(kept) == SPACE.replace(life=1.0)
    assert kept.identical(results)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"torsions": (1.0,)}, r"torsions must be a number for each of the 2 curvatures, got \(1\.0,\)"),
        ({"torsions": 3}, "torsions must be a number for each of curvatures, got 3"),
        ({"torsions": (1.0, float("nan"))}, "torsions must be a finite number, got nan"),
        ({"medium": {}}, "medium must be None in space"),
        ({"interactions": ["contact"]}, r"interactions must be \(\) in space"),
        ({"action": "continuous"}, "action must be 'discrete' in space .*got 'continuous'"),
        ({"spread": {"speed": 0.1}}, "spread must be None in space"),
        ({"rotational_diffusion": 0.1}, r"rotational_diffusion must be 0\.0 in space .*got 0\.1"),
        ({"sensor": "memory_with_neighbours"}, "sensor must be one that there is in space"),
        ({"flow": "taylor_green"}, r"flow must have vorticity\(position\) in space .*got TaylorGreen"),
        ({"field": "released_source"}, r"field must be one in space .*got ReleasedSource"),
        ({"start_box": ((0, 1), (0, 1))}, "start_box must have 3 sides in space"),
    ],
)
def test_what_is_not_in_space_is_an_error(parameters, message):
    with pytest.raises((TypeError, ValueError), match=message):
        World.in_space(**parameters)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"start_box": ((0, 1),) * 3}, "start_box must have 2 sides in the plane"),
        ({"field": {"type": "gaussian_plume", "egg_position": (1, 2, 3)}}, "egg_position must be 2 numbers"),
    ],
)
def test_what_is_not_in_the_plane_is_an_error(parameters, message):
    with pytest.raises(ValueError, match=message):
        World(**parameters)


@pytest.mark.parametrize(
    ("position", "heading", "message"),
    [
        (np.zeros((2, 2)), rotations(2), r"position must be floating numbers \(\.\.\., cells, 3\)"),
        (np.zeros((2, 3)), np.zeros(2), r"heading must be \(2, 4\) like the cells"),
        (np.zeros((2, 3)), 1.001 * rotations(2), "heading must be a unit quaternion .*for cell 0"),
        (np.zeros((2, 3)), rotations(2) * [[1], [np.nan]], "heading must be a unit quaternion .*for cell 1"),
    ],
)
def test_a_start_in_space_is_a_place_and_a_frame(position, heading, message):
    with pytest.raises(ValueError, match=message):
        SPACE.start(position, heading, np.zeros((2, 4), int))
