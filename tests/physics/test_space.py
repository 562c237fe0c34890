"""Three dimensions: helices against closed forms and an adaptive integrator, and lives in space."""

import functools

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest

import swarm
from benchmarks.exact_space import (
    FLOWS,
    LAWS,
    PAIRS,
    matrix,
    place_and_frame,
    reference,
    rotations,
)
from swarm.physics.flows import ABCFlow, FunctionFlow, ShearAroundSphere
from swarm.physics.motion import helix
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.collocation import TOLERANCE
from swarm.physics.motion.helical import HelicalCollocation
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from tests.physics.test_world import actions, functions, live
from tests.reference import array, to_numpy

CELLS = len(PAIRS)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_law_of_space_is_kept(law):
    assert 0 <= law.error() <= law.bound


def test_frames_turn_as_matrices_do(xp):
    places = array(xp, np.random.default_rng(1).uniform(0, 10, (CELLS, 3)))
    first, second = array(xp, rotations(CELLS)), array(xp, rotations(CELLS, 2))
    for found, expected in zip(helix.frame(first), np.moveaxis(matrix(first), -2, 0), strict=True):
        np.testing.assert_allclose(to_numpy(found), expected, rtol=0, atol=1e-15)
    both = matrix(helix.product(first, second))
    np.testing.assert_allclose(both, matrix(second) @ matrix(first), rtol=0, atol=1e-14)
    there = helix.rotated(first, places)
    expected = np.einsum("cij,ci->cj", matrix(first), to_numpy(places))
    np.testing.assert_allclose(to_numpy(there), expected, rtol=0, atol=1e-13)
    back = helix.rotated(helix.conjugate(first), there)
    np.testing.assert_allclose(to_numpy(back), to_numpy(places), rtol=0, atol=1e-13)


def test_frames_stay_of_unit_length_in_float32(xp):
    pose = Pose(array(xp, np.zeros((CELLS, 3)), xp.float32), array(xp, rotations(CELLS), xp.float32))
    ones = array(xp, np.ones(CELLS), xp.float32)
    step = helix.helix(5 * ones, 7 * ones, 0.2 * ones)
    for _ in range(50):
        pose = helix.along_helix(pose, step)
    assert pose.position.dtype == pose.heading.dtype == xp.float32
    np.testing.assert_allclose(np.linalg.norm(to_numpy(pose.heading), axis=-1), 1, rtol=0, atol=3e-7)


@pytest.mark.parametrize(("pair", "turn"), [((5.5, 7.7), 1.5), ((7.5, -1.0), 9.0), ((0.0, 0.0), 0.4)])
def test_the_closest_approach_is_that_of_a_densely_sampled_helix(xp, pair, turn):
    curvature, torsion = (np.full(100, each) for each in pair)
    length = np.full(100, turn / max(np.hypot(*pair), 1.0))
    radius = max(length[0], 0.2)
    pose = Pose(np.random.default_rng(2).normal(0, radius, (100, 3)), rotations(100, 3))
    point, cells = (0.1, -0.2, 0.05), int(np.ceil(turn / helix.CELL))
    given = (
        Pose(*(array(xp, each) for each in pose)),
        *(array(xp, each) for each in (curvature, torsion, length)),
    )
    closest = to_numpy(helix.closest_approach(*given, point, cells))
    parts = np.linspace(0, 1, 401)[:, None] * length
    path = helix.along_helix(pose, helix.helix(curvature, torsion, parts)).position
    sampled = np.linalg.norm(path - np.array(point), axis=-1).min(axis=0)
    step = length[0] / 400
    assert np.all(closest <= sampled * (1 + 1e-9))
    assert np.all(closest >= sampled - step / 2)
    assert np.all(closest >= np.sqrt(np.maximum(sampled**2 - 1.1 * (step / 2) ** 2, 0)) - 2 * step**2)


# --- flows --------------------------------------------------------------------------------------------------


def near(flow, cells=16):
    """Places of cells, around a sphere near it."""
    rng = np.random.default_rng(4)
    if not isinstance(flow, ShearAroundSphere):
        return rng.uniform(0, 20, (cells, 3))
    away = rng.normal(size=(cells, 3))
    distance = flow.radius * rng.uniform(1.01, 3, (cells, 1))
    return np.array(flow.centre) + away / np.linalg.norm(away, axis=-1, keepdims=True) * distance


def test_sweeps_nodes_and_substeps_of_a_strong_flow_converge():
    flow, pose = ABCFlow((3.0, 2.0, 1.0), 2.0), Pose(near(None, 8), rotations(8, 5))
    ones = np.ones(len(pose.position))
    arcs, times = (5.5 * ones, 7.7 * ones), (ones, 0.3 * ones)
    expected = reference(pose, 5.5, 7.7, *times, flow)
    errors = []
    for substeps in (2, 4, 8):
        scheme = HelicalCollocation(3, 8, substeps)
        after, _ = scheme.swim(pose, scheme.motions(arcs, *times), *times, scheme.weights, flow)
        errors.append(np.abs(place_and_frame(after) - expected).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    print(f"errors {errors}, orders {orders}")
    np.testing.assert_allclose(orders[-1], 6, rtol=0, atol=0.5)  # twice the nodes


@pytest.mark.parametrize("name", [name for name, flow in FLOWS.items() if type(flow) is not FunctionFlow])
def test_the_vorticity_is_the_curl_of_a_velocity_without_divergence(xp, name):
    flow, place = FLOWS[name], near(FLOWS[name])
    plain = FunctionFlow(flow.velocity, flow.speed_scale, max(flow.spin_scale, flow.speed_scale))
    scale = max(flow.spin_scale, 1e-3)
    found = to_numpy(flow.vorticity(array(xp, place)))
    np.testing.assert_allclose(found, plain.vorticity(place), rtol=0, atol=1e-7 * scale)
    step = 1e-4 * np.eye(3)
    slopes = [(flow.velocity(place + e) - flow.velocity(place - e))[..., i] for i, e in enumerate(step)]
    np.testing.assert_allclose(sum(slopes) / 2e-4, 0, atol=1e-6 * scale)
    assert np.linalg.norm(found, axis=-1).max() <= 2 * getattr(flow, "max_spin", flow.spin_scale) * (
        1 + 1e-12
    )


def test_abc_flow_is_as_fast_as_it_says():
    flow = ABCFlow((1.0, 1.0, 1.0), 2.0)
    place = np.random.default_rng(0).uniform(0, flow.period, (100_000, 3))
    squares = np.sum(flow.velocity(place) ** 2, axis=-1)
    assert np.sqrt(squares.mean()) == pytest.approx(flow.speed_scale, rel=0.01)
    assert 0.98 * flow.max_speed < np.sqrt(squares.max()) <= flow.max_speed
    np.testing.assert_allclose(flow.velocity(place + flow.period), flow.velocity(place), atol=1e-12)


@pytest.mark.parametrize("rotates", [True, False])
def test_water_sticks_to_a_sphere_and_shears_far_from_it(rotates):
    flow = ShearAroundSphere(2.0, 4.0, radius=1.5, centre=(1.0, 2.0, 3.0), rotates=rotates)
    away = rotations(50)[:, :3]
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    turning = np.cross([0.0, 0.5 * flow.rate if rotates else 0.0, 0.0], 1.5 * away)
    np.testing.assert_allclose(flow.velocity(np.array(flow.centre) + 1.5 * away), turning, rtol=0, atol=1e-14)
    far = 1e6 * away
    shear = np.stack([flow.rate * far[:, 2], 0 * far[:, 0], 0 * far[:, 0]], axis=-1)
    np.testing.assert_allclose(flow.velocity(np.array(flow.centre) + far), shear, rtol=0, atol=1e-5)
    # Stokes: the vorticity is harmonic
    place, step = np.array(flow.centre) + 2 * away, 1e-3 * np.eye(3)
    around = sum(flow.vorticity(place + e) + flow.vorticity(place - e) for e in step)
    np.testing.assert_allclose((around - 6 * flow.vorticity(place)) / 1e-6, 0, atol=2e-4)
    assert not flow.inside(np.array(flow.centre) + 1.49 * away).any()


# --- lives --------------------------------------------------------------------------------------------------

SPACE = World.in_space(life=3.0)


WORLDS = {
    "default": SPACE,
    "three_actions": World.in_space(curvatures=(4, 5, 6), torsions=(1.0, -2.0, 0.0), n_records=2),
    "varying_speed": World.in_space(varying_speed=True, interval_rule="exact", n_records=8),
    "abc": World.in_space(flow=ABCFlow((0.3, 0.2, 0.1), 1.0)),
    "sphere": World.in_space(flow="shear_around_sphere", field="radial", start_box=((-1.5, 1.5),) * 3),
}


@functools.cache
def references(name):
    """What the reference makes of each decision (decisions, cells, 12), from where NumPy's cells were."""
    world = WORLDS[name]
    flow, options = (
        world.flow if world.in_flow else None,
        (world.curvatures, world.torsions, world.action_speeds),
    )
    (states, _), chosen = live(np, world, 6, 3), actions(world, 3, 6)
    found = []
    for before, after, action in zip(states, states[1:], chosen, strict=False):
        given = (np.asarray(values)[action] for values in (*options, world.intervals))
        expected = reference(before.pose, *given, flow)
        expected[after.finished] = place_and_frame(before)[after.finished]  # it came into the sphere
        found.append(expected)
    return found


@pytest.mark.parametrize("name", WORLDS)
def test_lives_are_those_of_the_reference(xp, name):
    world = WORLDS[name]
    (states, _), chosen = live(xp, world, 6, 3), actions(world, 3, 6)
    tolerance = TOLERANCE if world.in_flow else 2e-11
    for after, expected, action in zip(states[1:], references(name), chosen, strict=False):
        np.testing.assert_allclose(place_and_frame(after), expected, rtol=0, atol=tolerance)
        np.testing.assert_allclose(to_numpy(world.torsion(after)), np.asarray(world.torsions)[action])


@pytest.mark.parametrize("name", ["default", "varying_speed", "abc"])
def test_swimming_the_past_forward_leads_back_to_the_start(xp, name):
    world = WORLDS[name]
    position, heading, past = draw_starts(world, 5, 1)
    start, step = functions(xp, world)
    records = to_numpy(start(array(xp, position), array(xp, heading), array(xp, past, xp.int64)).memory)
    here, tolerance = Pose(position, heading), 1e-5 if world.in_flow else 1e-11
    for i in range(world.n_records):
        sensed = world.field.concentration(here.position) * world.record_scale
        np.testing.assert_allclose(records[:, i, 0], sensed, rtol=0, atol=10 * tolerance)
        options = world.curvatures, world.torsions, world.action_speeds, world.intervals
        curvature, torsion, speed, interval = (np.asarray(values)[past[:, i]] for values in options)
        if world.in_flow:
            here = world.swimmer.swim_back(here, (curvature, torsion), speed, interval)
        else:
            here = helix.along_helix(here, helix.helix(curvature, torsion, -speed * interval))
    back = start(*(array(xp, each) for each in here), array(xp, past, xp.int64))
    for i in reversed(range(world.n_records)):
        back, _ = step(back, array(xp, past[:, i], xp.int64))
    np.testing.assert_allclose(to_numpy(back.position), position, rtol=0, atol=tolerance)
    np.testing.assert_allclose(matrix(back.heading), matrix(heading), rtol=0, atol=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["default", "abc", "sphere"])
def test_torchs_compiler_follows_a_decision(name):
    torch = pytest.importorskip("torch")
    world = WORLDS[name]
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
    expected = reference(state.pose, kappa, world.torsions[1], 2.0, interval)
    np.testing.assert_allclose(place_and_frame(after), expected, rtol=0, atol=2e-11)


def test_an_egg_is_reached_on_the_way():
    world = World.in_space(field="radial", start_box=((-1.2, 1.2),) * 3, n_records=2)
    starts = draw_starts(world, 400, 3)
    assert np.linalg.norm(starts.position, axis=-1).min() > 1
    state = world.start(*starts)
    after, outcome = world.step(state, np.zeros(400, int))
    parts = np.linspace(0, world.intervals[0], 500)[:, None] * np.ones(400)
    arcs = np.full(400, world.curvatures[0]), np.full(400, world.torsions[0])
    path = helix.along_helix(state.pose, helix.helix(*arcs, 2.0 * parts)).position
    reached = (np.linalg.norm(path, axis=-1) <= 1).any(axis=0)
    assert reached.sum() > 5
    np.testing.assert_array_equal(outcome.terminated, reached)
    np.testing.assert_array_equal(after.finished, reached)


@pytest.mark.parametrize("name", ["released_source", "releasing_source"])
def test_what_an_egg_releases_diffuses_in_space(name):
    egg = {"dimensions": 3, "egg_position": (1.0, 2.0, 3.0), "diffusivity": 0.05, "age": 8.0}
    field = World.in_space(field={"type": name, **egg}, start_box=((-2, 4),) * 3, life=4.0).field
    away, step = rotations(20)[:, :3], 1e-3
    place = np.array([1.0, 2.0, 3.0]) + 1.5 * away / np.linalg.norm(away, axis=-1, keepdims=True)
    around = sum(
        field.at(2.0).concentration(place + way * step * axis) for axis in np.eye(3) for way in (-1, 1)
    )
    curvature = (around - 6 * field.at(2.0).concentration(place)) / step**2
    rate = (field.at(2.001).concentration(place) - field.at(1.999).concentration(place)) / 0.002
    np.testing.assert_allclose(rate, 0.05 * curvature, rtol=0, atol=1e-5 * np.abs(rate).max() + 1e-8)


def test_flow_is_sensed_in_space(xp):
    world = World.in_space(flow=ABCFlow((0.3, 0.2, 0.1), 1.0), sense_flow=True)
    assert world.sensor.names[2:] == ("flow_x", "flow_y", "flow_z", "spin_x", "spin_y", "spin_z")
    (state, *_), _ = live(xp, world, 6, 1)
    scales = np.repeat([world.flow.speed_scale, 2 * world.flow.spin_scale], 3)
    place = to_numpy(state.position)
    found = np.concatenate([world.flow.velocity(place), world.flow.vorticity(place)], axis=-1) / scales
    np.testing.assert_allclose(to_numpy(state.memory)[:, 0, 2:], found, rtol=0, atol=1e-14)
    observed = to_numpy(world.observation(state))
    assert (np.abs(observed) <= world.observation_bounds).all()


def test_the_axis_turns_as_the_formula_says_for_torsions_of_any_sign():
    signs = {(-7.7, -5.7): -1, (-4.0, -9.0): 1, (7.7, -5.7): -1, (5.5, -5.7): 1, (-5.7, 6.5): 1}
    worlds = [World.in_space(torsions=torsions) for torsions in signs]
    assert [each.response_sign for each in worlds] == list(signs.values())
    found = swarm.population_test(worlds[-1], {"adaptive": swarm.AdaptiveSteering()}, cells=12, life=20.0)
    assert found["gain"].mean() > 0


def test_who_senses_more_stretches_its_path_to_climb():
    defaults, coiled, flat = World.in_space(), World.in_space(torsions=(4.0, 9.0)), World(torsions=(0.0, 0.0))
    assert [each.response_sign for each in (defaults, coiled, flat, World())] == [-1, 1, 1, 1]
    for world, at_largest in ((defaults, 0), (coiled, 1)):
        state = world.start(*draw_starts(world, 50, 0))
        concentrations = state.memory[..., 0]
        action = swarm.Greedy().act(world, state)
        assert (action[concentrations.argmax(axis=-1) == 0] == at_largest).all()
        assert (action[concentrations.argmin(axis=-1) == 0] == 1 - at_largest).all()
    policies = {"adaptive": swarm.AdaptiveSteering(), "greedy": swarm.Greedy()}
    gain = swarm.population_test(defaults, policies, cells=8, life=12.0, limit=False)["gain"].mean("cell")
    assert gain.sel(policy="adaptive") > 8  # of the field's unit; 14.5


RISING = {"still": 0.0, "shear": 0.0, "abc": 0.17, "shear_around_sphere": 0.05}  # u_z at most


@hypothesis.given(
    st.lists(st.floats(-12.0, 12.0), min_size=2, max_size=4),
    st.floats(0.2, 5.0),
    st.floats(0.5, 3.0),
    st.integers(2, 9),
    st.sampled_from(sorted(RISING)),
    st.sampled_from([0.0, 0.4]),
)
@hypothesis.settings(max_examples=12)
def test_what_must_hold_in_space(torsions, curvature, speed, n_records, flow, noise):
    given = {"curvatures": curvature + 0.7 * np.arange(len(torsions)), "torsions": torsions, "speed": speed}
    world = World(**given, n_records=n_records, flow=flow, curvature_noise=noise, interval_rule="exact")
    state, rng, before = world.start(*draw_starts(world, 4, 0)), np.random.default_rng(0), np.zeros(4)
    for _ in range(4):
        action = rng.integers(world.n_actions, size=4)
        state, outcome = world.step(state, action, rng.standard_normal((4, 3)))
        time = world.time(state)
        assert all(np.isfinite(part).all() for part in (*outcome[:2], state.position))
        np.testing.assert_allclose(np.linalg.norm(state.heading, axis=-1), 1, rtol=0, atol=1e-14)
        assert (np.abs(outcome.gain) <= (speed + RISING[flow]) * time * (1 + 1e-12)).all()
        assert ((time > before) | state.finished).all()
        before = time


def test_a_population_is_tested_and_kept_in_space(tmp_path, monkeypatch):
    from swarm.population.results import load_population, save_population, world_of

    monkeypatch.setattr("swarm.optimal.physical_limit.SPHERES", (4, 6, 8))
    policies = {"greedy": swarm.Greedy(), "random": swarm.Random(), "swinging": swarm.Swinging()}
    results = swarm.population_test(SPACE, policies, cells=4, life=1.0)
    assert results["heading"].dims == ("policy", "cell", "decision", "quaternion")
    assert list(results["axis"].values) == ["x", "y", "z"]
    rise = results["position"].sel(axis="z").isel(decision=-1) - results["start_position"].sel(axis="z")
    np.testing.assert_allclose(results["gain"], rise, atol=1e-5)
    assert (results["gain"].mean("cell") < results.attrs["limit"]).all()
    save_population(results, tmp_path / "population.nc")
    kept = load_population(tmp_path / "population.nc")
    assert world_of(kept) == SPACE.replace(life=1.0)
    assert kept.identical(results)


@pytest.mark.parametrize(
    ("make", "parameters", "message"),
    [
        (World, {"start_box": ((0, 1),) * 3}, "start_box must have 2 sides in the plane"),
        (
            World,
            {"field": {"type": "gaussian_plume", "egg_position": (1, 2, 3)}},
            "egg_position must be 2 numbers",
        ),
        (World, {"flow": "abc"}, r"flow must have spin\(position\) in the plane .*got ABCFlow"),
        (
            World,
            {"flow": {"type": "uniform", "current": (1, 2, 3)}},
            "flow must be one in the plane .*UniformFlow",
        ),
        (
            World,
            {"flow": "taylor_green", "sensor": "memory_with_flow_in_space"},
            "sensor must be one in the plane",
        ),
        (
            World.in_space,
            {"torsions": (1.0,)},
            r"torsions must be a number for each of the 2 curvatures, got \(1\.0,\)",
        ),
        (
            World.in_space,
            {"torsions": None},
            "torsions must be a number for each of curvatures in space, got None",
        ),
        (World.in_space, {"torsions": 3}, "torsions must be a number for each of curvatures, got 3"),
        (World.in_space, {"torsions": (1.0, float("nan"))}, "torsions must be a finite number, got nan"),
        (World.in_space, {"medium": {}}, "medium must be None in space"),
        (World.in_space, {"interactions": ["contact"]}, r"interactions must be \(\) in space"),
        (World.in_space, {"action": "continuous"}, "action must be 'discrete' in space .*got 'continuous'"),
        (
            World.in_space,
            {"first_arrivals": 1, "field": "radial"},
            "first_arrivals must be None in space .*got 1",
        ),
        (World.in_space, {"spread": {"speed": 0.1}}, "spread must be None in space"),
        (
            World.in_space,
            {"rotational_diffusion": 0.1},
            r"rotational_diffusion must be 0\.0 in space .*got 0\.1",
        ),
        (
            World.in_space,
            {"sensor": "memory_with_neighbours"},
            "sensor must be one in space .*got MemoryWithNeighbours",
        ),
        (
            World.in_space,
            {"flow": "taylor_green"},
            r"flow must have vorticity\(position\) in space .*got TaylorGreen",
        ),
        (World.in_space, {"field": "released_source"}, r"field must be one in space .*got ReleasedSource"),
        (World.in_space, {"start_box": ((0, 1), (0, 1))}, "start_box must have 3 sides in space"),
        (
            World.in_space,
            {"sense_flow": True},
            "sense_flow must go with a flow with speed_scale and spin_scale above 0",
        ),
        (
            World.in_space,
            {"sensor": "memory_with_flow", "flow": "abc"},
            r"sensor must be one in space .*got MemoryWithFlow\(",
        ),
        (
            World.in_space,
            {"flow": FunctionFlow(lambda r: r[..., :2], 1, 1)},
            r"flow.velocity must be .*got \(1, 2\)",
        ),
        (World.in_space, {"flow": ABCFlow((2e3, 0, 0), 1e3)}, "flow must vary slowly enough to be followed"),
    ],
)
def test_what_is_not_in_the_plane_or_in_space_is_an_error(make, parameters, message):
    with pytest.raises((TypeError, ValueError), match=message):
        make(**parameters)


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
