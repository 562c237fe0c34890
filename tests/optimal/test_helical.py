"""The limit in space: held against all sequences, a value iteration of its own, and play."""

import functools
import itertools

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.ndimage import map_coordinates, spline_filter
from scipy.spatial.transform import Rotation

from swarm.optimal import helical
from swarm.optimal.helical import HelicalTables
from swarm.optimal.physical_limit import Optimal, bound, limit, limit_details
from swarm.optimal.problem import problem_of
from swarm.physics.fields import LinearField
from swarm.physics.motion.arc import Pose
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.strategies import Greedy, Random, Swinging
from swarm.population.contest import population_test

WORLDS = {
    "as it is": {},
    "equal signs": {"torsions": (5.7, 7.7)},
    "two records, cut short": {"n_records": 2, "life": 1.27},
    "negative torsions": {"torsions": (-7.7, -5.7), "speed": 1.3},
    "planar and straight": {"curvatures": (0.5, 6.0), "torsions": (0.0, 3.0)},
    "three actions": {"curvatures": (5.0, 6.0, 7.0), "torsions": (7.0, 4.0, 5.0)},
    "varying speed": {"varying_speed": True, "life": 0.75},
    "a cut interval alone": {"life": 0.05},
}


def screws(world, time):
    """Displacement (3,) and rotation (3, 3) of each action: the exponential of Frenet and Serret's motion."""
    for curvature, torsion, speed in zip(world.curvatures, world.torsions, world.action_speeds, strict=True):
        turning = [[0, -curvature, 0, 1], [curvature, 0, -torsion, 0], [0, torsion, 0, 0], [0, 0, 0, 0]]
        moved = expm(speed * time * np.array(turning))
        yield moved[:3, 3], moved[:3, :3]


@functools.cache
def ends(world, left, missing):
    """Where (sequences, 3) all sequences of actions lead, in the cell's frame, with `left` ticks to live."""
    if left <= 0:
        return np.zeros((1, 3))
    found = []
    for action, ticks in enumerate(world.interval_ticks):
        time = ticks * world.tick if left > ticks else left * world.tick - missing
        displacement, rotation = list(screws(world, time))[action]
        found.append(displacement + ends(world, left - ticks, missing) @ rotation.T)
    return np.concatenate(found)


def seen(starts):
    """The upward unit vector (cells, 3) in the cells' frames."""
    return Rotation.from_quat(starts.heading, scalar_first=True).as_matrix()[:, 2]


def best_of_all(world, starts):
    missing = world.life_ticks * world.tick - world.life
    return (seen(starts) @ ends(world, world.life_ticks, missing).T).max(axis=1)


def value_iteration(world, starts, n, length=4):
    """The mean limit: spheres around the binormal, `length` decisions at once, splines by SciPy."""
    angle, around = np.meshgrid((np.arange(n) + 0.5) * np.pi / n, np.arange(2 * n) * np.pi / n, indexing="ij")
    sphere = np.stack(
        [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], axis=-1
    ).reshape(-1, 3)

    def steps(direction):
        x, y, z = direction.T
        return np.stack([np.arccos(np.clip(z, -1, 1)) * n / np.pi - 0.5, np.arctan2(y, x) * n / np.pi])

    def read(value, places):
        table = value.reshape(n, 2 * n)
        torus = np.concatenate([table, np.roll(table[::-1], n, axis=1)])
        return map_coordinates(
            spline_filter(torus, mode="grid-wrap"), places, mode="grid-wrap", prefilter=False
        )

    one = list(screws(world, world.intervals[0]))
    moves = []
    for sequence in itertools.product(range(len(one)), repeat=length):
        place, frame = np.zeros(3), np.eye(3)
        for action in sequence:
            place, frame = place + frame @ one[action][0], frame @ one[action][1]
        moves.append((sphere @ place, steps(sphere @ frame)))
    value = np.zeros(len(sphere))
    assert world.max_decisions * world.intervals[0] == pytest.approx(world.life)
    assert world.max_decisions % length == 0
    for _ in range(world.max_decisions // length):
        value = np.max([gain + read(value, places) for gain, places in moves], axis=0)
    return world.field.gradient_scale * read(value, steps(seen(starts))).mean()


@pytest.mark.parametrize("name", WORLDS)
def test_the_bound_of_every_start_is_the_best_of_all_sequences(coarse, name):
    world = World.in_space(**{"life": 0.7} | WORLDS[name])
    starts = draw_starts(world, 300, 1)
    exact = best_of_all(world, starts)
    assert bound(world, starts) == pytest.approx(exact, abs=0.03)  # on a coarse sphere
    assert limit_details(world, starts).value == pytest.approx(exact.mean(), abs=1e-3)


def test_the_limit_agrees_with_a_value_iteration(coarse):
    world = World.in_space(life=8.0, field=LinearField(gradient_scale=2.5))
    starts = draw_starts(world, 200, 0)
    details = limit_details(world, starts)
    assert details.value == pytest.approx(value_iteration(world, starts, 32), rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("torsions", "expected"), [((7.7, 5.7), 64.12), ((5.7, 7.7), 22.26)])
def test_long_lives_agree_with_a_value_iteration_too(torsions, expected):
    world = World.in_space(life=40.0, torsions=torsions)
    starts = draw_starts(world, 2000, 0)
    details = limit_details(world, starts)
    assert details.value == pytest.approx(value_iteration(world, starts, 72), rel=1e-3)
    assert details.error < 2e-3 * details.value
    assert details.value == pytest.approx(expected, rel=0.05)  # uniform over rotations


@pytest.mark.parametrize("options", [{}, {"varying_speed": True}, WORLDS["three actions"]], ids=str)
def test_playing_the_optimal_policy_attains_the_limit_and_no_other_exceeds_it(coarse, options):
    world = World.in_space(**{"life": 4.0} | options)
    policies = {"optimal": Optimal(world), "swinging": Swinging(), "random": Random()}
    found = population_test(world, policies, cells=30, life=world.life)
    mean = found["gain"].mean("cell").to_series()
    assert mean["optimal"] == pytest.approx(found.attrs["limit"], rel=0.01)
    assert mean.max() <= found.attrs["limit"] * (1 + 2e-3)
    assert mean.drop("optimal").max() < 0.5 * mean["optimal"]
    every = bound(world, draw_starts(world, 30, 0))
    assert (found["gain"].values <= every + 0.05).all()


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"n_records": 8}, {"torsions": (5.7, 7.7)}], ids=str)
def test_long_lives_attain_the_limit_to_a_thousandth(options):
    world = World.in_space(**options)
    policies = {"optimal": Optimal(world.replace(life=40.0)), "greedy": Greedy()}
    found = population_test(world, policies, cells=100, life=40, record=False)
    mean = found["gain"].mean("cell").to_series()
    assert mean["optimal"] == pytest.approx(found.attrs["limit"], rel=1.5e-3)
    assert mean["greedy"] < mean["optimal"] <= found.attrs["limit"] * (1 + 1e-3)


def test_the_bound_does_not_depend_on_place_and_on_turns_about_the_gradient(coarse):
    world = World.in_space(life=1.0)
    starts = draw_starts(world, 20, 0)
    turn = Rotation.from_rotvec([0, 0, 1.1]) * Rotation.from_quat(starts.heading, scalar_first=True)
    turned = starts._replace(position=starts.position + 7, heading=turn.as_quat(scalar_first=True))
    assert bound(world, turned) == pytest.approx(bound(world, starts), abs=1e-9)
    assert bound(world, starts).std() > 0.1


def test_a_cell_whose_axis_is_upright_can_do_little_better_than_go_on(coarse):
    torsions = (-6.0, -9.0)
    world = World.in_space(life=10.0, torsions=torsions)
    climbs = np.abs(torsions) / np.hypot(world.curvatures, torsions)
    best, climb = np.argmax(climbs), climbs.max()
    axis = [torsions[best], 0, world.curvatures[best]]
    upright, _ = Rotation.align_vectors([[0, 0, -1]], [axis])
    starts = draw_starts(world, 1, 0)._replace(heading=upright.as_quat(scalar_first=True)[None])
    assert limit(world, starts) == pytest.approx(world.speed * climb * world.life, rel=5e-3)


def test_where_there_is_no_room_for_all_times_tables_are_read_between_them(monkeypatch):
    world = World.in_space(life=4.0, varying_speed=True)
    problem, starts = problem_of(world), draw_starts(world, 50, 0)
    pose, left = Pose(starts.position, starts.heading), np.linspace(0, problem.life_ticks, 50).astype(int)
    whole = HelicalTables.compute(problem, 12)
    monkeypatch.setattr(helical, "KEPT_NUMBERS", whole.splines.size // 4)
    thin = HelicalTables.compute(problem, 12)
    assert len(thin.splines) < 0.27 * len(whole.splines)
    assert thin.ahead(pose, left) == pytest.approx(whole.ahead(pose, left), abs=0.05)
