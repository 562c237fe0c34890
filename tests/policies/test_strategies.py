"""Strategies: what they choose, on any array library and with any leading axes."""

import numpy as np
import pytest
from array_api_compat import array_namespace

from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.policy import Policy
from swarm.policies.strategies import FromObservation, Greedy, Random, Swinging
from swarm.population.contest import population_test
from tests.reference import array, to_numpy

THREE = (3.0, 4.0, 5.0)


def state_with(xp, world, concentrations, last_action):
    """A state whose records hold these concentrations (cells, N_T), newest first, after these actions."""
    cells = len(concentrations)
    start = draw_starts(world, cells, 0)
    past = np.zeros((cells, world.n_records), int)
    past[:, 0] = last_action
    state = world.start(array(xp, start.position), array(xp, start.heading), array(xp, past))
    memory = np.array(to_numpy(state.memory))
    memory[..., 0] = concentrations
    return state._replace(memory=array(xp, memory))


@pytest.mark.parametrize("curvatures", [(3.0, 5.0), THREE])
def test_greedy_turns_most_at_the_largest_record_least_at_the_smallest_and_else_as_before(xp, curvatures):
    world = World(curvatures=curvatures)
    top = world.n_actions - 1
    largest, smallest, between, equal = [9, 1, 2, 3], [0, 1, 2, 3], [2, 1, 2, 3], [7, 7, 7, 7]
    for before in range(world.n_actions):
        records = np.array([largest, smallest, between, equal, [5, 5, 2, 3], [1, 1, 2, 3]], float)
        state = state_with(xp, world, records, [before] * 6)
        assert to_numpy(Greedy().act(world, state)).tolist() == [top, 0, before, top, top, 0]


@pytest.mark.parametrize("n_records", [2, 5, 8])
@pytest.mark.parametrize("rule", ["truncated", "exact"])
@pytest.mark.parametrize("options", [{}, {"curvatures": THREE, "varying_speed": True}], ids=str)
def test_swinging_switches_every_half_cycle_whatever_the_clock(n_records, rule, options):
    world = World(n_records=n_records, life=30.0, interval_rule=rule, **options)
    state = world.start(*draw_starts(world, 3, 0))
    decision = 0
    while not state.finished.all():
        action = Swinging().act(world, state)
        expected = (2 * decision // n_records) % 2 * (world.n_actions - 1)
        assert (action == expected).all()
        state, _ = world.step(state, action)
        decision += 1
    assert decision > 4 * n_records


def test_swinging_in_the_middle_of_a_life_asks_the_clock_alone(xp):
    world = World(varying_speed=True)  # 17 ticks with the first action, 21 with the second
    state = state_with(xp, world, np.zeros((5, 4)), [0] * 5)
    state = state._replace(clock=array(xp, np.array([0, 33, 34, 75, 76]), xp.int32))
    assert to_numpy(Swinging().act(world, state)).tolist() == [0, 0, 1, 1, 0]


def test_random_takes_each_action_with_equal_chance(xp):
    world = World(curvatures=THREE)
    uniform = np.random.default_rng(0).random(30_000)
    action = to_numpy(Random().act(world, None, array(xp, uniform)))
    assert np.allclose(np.bincount(action, minlength=3) / len(action), 1 / 3, atol=0.01)
    assert (action == np.floor(uniform * 3)).all()
    almost_one = array(xp, np.array([1 - 1e-9]), xp.float32)
    assert to_numpy(almost_one) == 1  # rounded up, but it stays in range
    assert to_numpy(Random().act(world, None, almost_one)).tolist() == [2]
    with pytest.raises(ValueError, match="uniform must be given"):
        Random().act(world, None, None)


@pytest.mark.parametrize("strategy", [Greedy(), Swinging()], ids=str)
@pytest.mark.parametrize(
    "options", [{}, {"varying_speed": True}, {"interval_rule": "exact", "varying_speed": True}], ids=str
)
def test_leading_axes_and_the_library_change_nothing(xp, strategy, options):
    world = World(**options)
    position, heading, past = draw_starts(world, 6, 0)
    flat = world.start(position, heading, past)
    folded = world.start(
        array(xp, position.reshape(2, 3, 2)),
        array(xp, heading.reshape(2, 3)),
        array(xp, past.reshape(2, 3, -1)),
    )
    for _ in range(9):
        action = strategy.act(world, flat)
        many = strategy.act(world, folded)
        assert many.shape == (2, 3)
        assert (to_numpy(many).ravel() == action).all()
        flat, _ = world.step(flat, action)
        folded, _ = world.step(folded, many)


def above_the_mean(observation):
    return array_namespace(observation).astype(observation[..., 0] > 0, array_namespace(observation).int32)


def test_a_function_of_the_observation_steers_as_a_policy_written_out_does(xp):
    world = World()
    state = state_with(xp, world, np.array([[9.0, 1, 2, 3], [0, 1, 2, 3]]), [0, 1])
    policy = FromObservation(above_the_mean)
    assert all(isinstance(each, Policy) for each in (policy, Greedy(), Swinging(), Random()))
    action = policy.act(world, state)
    assert to_numpy(action).tolist() == [1, 0]
    assert action.dtype == xp.int32
    assert type(action) is type(state.memory)
    folded = world.start(
        *(array(xp, zeros) for zeros in (np.zeros((2, 3, 2)), np.zeros((2, 3)), np.zeros((2, 3, 4), int)))
    )
    assert policy.act(world, folded).shape == (2, 3)


@pytest.mark.parametrize("kind", [list, np.asarray])
def test_a_function_may_return_lists_and_numpy_arrays(xp, kind):
    world = World()
    state = state_with(xp, world, np.zeros((3, 4)), [0, 0, 0])
    action = FromObservation(lambda seen: kind([0, 1, 1])).act(world, state)
    assert type(action) is type(state.memory)
    assert to_numpy(action).tolist() == [0, 1, 1]


@pytest.mark.parametrize("options", [{}, {"interval_rule": "exact", "varying_speed": True}])
@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ([0, 1], r"one for each cell \(3,\), got int64 of shape \(2,\)"),
        ([[0, 1, 1]], r"one for each cell \(3,\), got int64 of shape \(1, 3\)"),
        ([0.0, 1.0, 0.0], "actions must be whole numbers, .* got float64"),
        ([True, False, True], "actions must be whole numbers, .* got bool"),
        (None, "actions must be whole numbers, .* got object"),
        ([0, 2, 1], r"actions must lie in 0 … 1, got 2"),
        ([-1, 0, 1], r"actions must lie in 0 … 1, got -1"),
    ],
)
def test_a_function_that_returns_no_actions_is_told(chosen, message, options):
    policy, world = FromObservation(lambda observation: chosen), World(**options)
    with pytest.raises(ValueError, match=message):
        population_test(world, {"wrong": policy}, cells=3, life=2, limit=False)
    with pytest.raises(TypeError, match="function must map observations to actions, got 3"):
        FromObservation(3)
