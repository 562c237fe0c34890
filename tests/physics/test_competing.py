"""Competing: races, rewards for them, cells that are not alike, and cells that see each other."""

import math

import numpy as np
import pytest

from swarm.physics.crowd.medium import Medium
from swarm.physics.fields import LinearField, RadialField
from swarm.physics.perception import MemoryWithNeighbours
from swarm.physics.starts import draw_noise_and_bindings, draw_starts
from swarm.physics.world import World
from swarm.policies.strategies import Greedy
from tests.physics.test_world import begin
from tests.reference import array, to_numpy

EATING = Medium(box=((0, 10), (0, 10)), shape=(64, 64), uptake=0.0116)


def live(world, state):
    """All states and outcomes of a life of greedy cells."""
    states, outcomes = [state], []
    while not states[-1].finished.all():
        state, outcome = world.step(states[-1], Greedy().act(world, states[-1]))
        states.append(state)
        outcomes.append(outcome)
    return states, outcomes


# --- rewards ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0.0, 6.0])
def test_arrival_pays_every_winner_once_when_it_arrives(delay):
    world = World(field=RadialField(), life=300, first_arrivals=2, block_delay=delay, reward="arrival")
    states, outcomes = live(world, begin(np, world, 30))
    paid = np.array([outcome.reward for outcome in outcomes])
    won = world.won(states[-1])
    assert won.sum() >= 2
    np.testing.assert_array_equal(paid.sum(axis=0), won)
    for cell in np.flatnonzero(won):
        (turn,) = np.flatnonzero(paid[:, cell])
        times = [world.time(states[i])[cell] for i in (turn, turn + 1)]
        assert times[0] < states[-1].arrival_time[cell] <= times[1]


def test_eaten_pays_what_was_eaten_as_the_mean_concentration_of_records():
    world = World(medium=EATING, life=8, reward="eaten", start_box=((3, 7), (3, 7)))
    states, outcomes = live(world, begin(np, world, 4))
    paid = np.sum([outcome.reward for outcome in outcomes], axis=0)
    scale = world.mean_curvature / world.field.gradient_scale / (EATING.uptake * world.intervals[0])
    np.testing.assert_allclose(paid, states[-1].medium.eaten * scale, rtol=1e-12)
    first = outcomes[0].reward / (0.5 * (states[0].memory + states[1].memory)[:, 0, 0])
    np.testing.assert_allclose(first, 1, atol=0.15)


# --- sensors ------------------------------------------------------------------------------------------------


def test_neighbours_are_seen_in_the_cells_own_frame_nearest_first(xp):
    world = World(sensor=MemoryWithNeighbours(k=2, range=2.0))
    position = [[1, 1], [1, 1.5], [0, 1], [4, 4], [4, 2.5]]
    angle = [math.pi / 2, 0, math.pi, 0, 0]
    past = array(xp, np.zeros((5, 4), int))
    seen = to_numpy(
        world.start(array(xp, np.array(position, float)), array(xp, np.array(angle)), past).memory
    )
    # cell 0 heads up: cell 1 is half a unit ahead and heads to its right, cell 2 one unit to its left
    close, far = 1 - 0.5 / 2, 1 - 1 / 2
    np.testing.assert_allclose(seen[0, 0, 2:6], close * np.array([1, 0, 0, -1]), atol=1e-12)
    np.testing.assert_allclose(seen[0, 0, 6:], far * np.array([0, 1, 0, 1]), atol=1e-12)
    # cell 3 sees cell 4 alone, at its right
    np.testing.assert_allclose(seen[3, 0, 2:], [0, -0.25, 0.25, 0, 0, 0, 0, 0], atol=1e-12)
    assert (seen[:, 1:, 2:] == 0).all()  # the past was swum alone


def test_who_has_finished_is_not_seen_and_leading_axes_are_worlds(xp):
    world = World(sensor=MemoryWithNeighbours(k=1, range=3.0))
    position = np.array([[[1.0, 1], [2, 1], [9, 9]], [[5, 5], [5, 6], [5, 8]]])
    state = world.start(array(xp, position), array(xp, np.zeros((2, 3))), array(xp, np.zeros((2, 3, 4), int)))
    over = np.zeros((2, 3), bool)
    over[1, 1] = True
    after, _ = world.step(state._replace(finished=array(xp, over)), array(xp, np.zeros((2, 3), int)))
    seen = to_numpy(after.memory)[..., 0, 2:]
    apart = to_numpy(after.position)[1, 2] - to_numpy(after.position)[1, 0]
    expected = 1 - math.hypot(*apart) / 3
    np.testing.assert_allclose(np.hypot(*seen[1, 0, :2]), max(expected, 0), atol=1e-12)
    assert (seen[0, 2] == 0).all()
    assert (seen[0, 0] != 0).any()


def test_cells_in_one_place_or_alone_see_finite_numbers(xp):
    world = World(sensor=MemoryWithNeighbours(k=3, range=1.0))
    for cells in (1, 3):
        place = np.full((cells, 2), 5.0)
        state = world.start(*(array(xp, part) for part in (place, place[:, 0], np.zeros((cells, 4), int))))
        seen = to_numpy(state.memory)[:, 0, 2:]
        np.testing.assert_allclose(seen[:, :4], np.tile([0, 0, cells > 1, 0], (cells, 1)), atol=1e-12)


def test_in_a_medium_that_wraps_the_nearest_image_is_seen():
    medium = Medium(box=((0, 10), (0, 10)), shape=(64, 64), leaving="wrap")
    world = World(medium=medium, sensor=MemoryWithNeighbours(k=1, range=1.0))
    state = world.start(np.array([[0.2, 5.0], [9.8, 5.0]]), np.zeros(2), np.zeros((2, 4), int))
    np.testing.assert_allclose(state.memory[:, 0, 2:4], [[-0.6, 0], [0.6, 0]], atol=1e-12)


def test_traits_are_the_cells_own_factors_less_one(xp):
    world = World(spread={"speed": 0.1, "curvature": 0.05}, sensor="memory_with_traits")
    starts = draw_starts(world, 200, 3)
    state = begin(xp, world, 200, seed=3)
    for row in range(4):
        np.testing.assert_allclose(to_numpy(state.memory)[:, row, 2:], starts.factors - 1, atol=1e-15)
    assert (np.abs(to_numpy(world.observation(state))) <= world.observation_bounds).all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:`torch.jit:DeprecationWarning")  # torch's compiler uses it itself
def test_torch_compiles_what_neighbours_are_seen_in_one_piece():
    torch = pytest.importorskip("torch")
    from array_api_compat import torch as xp

    world = World(sensor=MemoryWithNeighbours(k=2, range=3.0))
    state = begin(xp, world, 8)
    action = torch.arange(8) % 2
    compiled = torch.compile(world.step, fullgraph=True, dynamic=False, backend="aot_eager")
    (expected, _), (after, _) = world.step(state, action), compiled(state, action)
    torch.testing.assert_close(after.memory, expected.memory)


# --- races --------------------------------------------------------------------------------------------------


def test_the_first_of_n_comes_when_the_survival_of_one_to_the_nth_has_it():
    n, worlds = 4, 10_000
    world = World(field=RadialField(), life=40, first_arrivals=1, start_box=((-3, 3), (-3, 3)))
    one = draw_starts(world, worlds * (n + 1), 1)
    first, others = (
        [part[rows].reshape(worlds, -1, *part.shape[1:]) for part in one]
        for rows in (slice(None, worlds), slice(worlds, None))
    )
    racing = world.start(*others)
    single = world.start(*first)
    racing, single = (live(world, state)[0][-1] for state in (racing, single))
    fastest, lonely = racing.arrival_time.min(axis=-1), single.arrival_time[..., 0]
    for time in np.linspace(1, 15, 8):
        lone, law = np.mean(lonely > time), np.mean(lonely > time) ** n
        error = np.sqrt((law * (1 - law) + (n * lone ** (n - 1)) ** 2 * lone * (1 - lone)) / worlds)
        assert abs(np.mean(fastest > time) - law) < 3 * error
    assert 0.1 < np.mean(lonely > 5) ** n < 0.9


@pytest.mark.parametrize(("delay", "wanted", "winners"), [(0.0, 2, 2), (1.5, 2, 2), (1.7, 2, 3), (0.0, 5, 5)])
def test_a_race_ends_for_all_when_enough_have_arrived_and_who_comes_within_the_delay_wins(
    delay, wanted, winners
):
    world = World(field=RadialField(), life=40, first_arrivals=wanted, block_delay=delay)
    angle, away = np.linspace(0, 6, 5), np.array([0.1, 0.3, 0.6, 0.9, 4.0])  # from the egg
    position = (1 + away)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    states, outcomes = live(world, world.start(position, angle, np.zeros((5, 4), int)))
    last = states[-1]
    alone = world.replace(first_arrivals=5, block_delay=0.0)
    times = live(alone, states[0])[0][-1].arrival_time  # 1.3, 2.9, 4.5, 8.6, 39.0
    assert (np.diff(times) > 0).all()
    closes = times[wanted - 1] + delay
    np.testing.assert_array_equal(world.won(last), times <= closes)
    assert world.won(last).sum() == winners
    assert (np.sum([outcome.terminated for outcome in outcomes], axis=0) == 1).all()  # for all the end
    assert not np.any([outcome.truncated for outcome in outcomes])
    ends = world.time(last).max()
    assert ends - world.intervals[0] < closes <= ends
    arrived = np.isfinite(last.arrival_time)
    np.testing.assert_array_equal(last.arrival_time[arrived], times[arrived])


# --- cells by chance ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [0.3, 30.0])  # about 10 and 1000 bindings
def test_cells_that_count_bindings_sense_the_mean_on_their_way_with_poissons_variance(rate):
    world = World(field=LinearField(1.0, 100.0), binding_rate=rate, flow="still")
    cells = 20_000
    place, past = np.full((cells, 2), 5.0), np.zeros((cells, 4), int)
    state = world.start(place, np.full(cells, 1.0), past)
    noise = draw_noise_and_bindings(7, cells, 1)[:, 0]
    after, _ = world.step(state, past[:, 0], noise)
    sensed = after.memory[:, 0, 0] / world.record_scale
    time = np.linspace(0, world.intervals[0], 201)
    mean = np.trapezoid(105 + (np.cos(1.0) - np.cos(1.0 + 3 * time)) / 3, time) / time[-1]
    variance = mean / (rate * time[-1])
    assert abs(sensed.mean() - mean) < 4 * np.sqrt(variance / cells)
    assert abs(sensed.var() / variance - 1) < 4 * np.sqrt(2.2 / cells)


def test_a_cells_factors_depend_on_no_other_cell_and_change_no_interval():
    world = World(spread={"speed": 0.1, "curvature": 0.2})
    few, many = draw_starts(world, 3, 1), draw_starts(world, 50, 1)
    np.testing.assert_array_equal(few.factors, many.factors[:3])
    alike = World()
    assert (world.intervals, world.max_decisions) == (alike.intervals, alike.max_decisions)
    states = live(world, world.start(*many))[0]
    for state in states[:: len(states) // 5]:
        assert len(np.unique(world.time(state))) == 1
    swum = np.hypot(*(states[1].position - states[0].position).T)
    assert len(np.unique(np.round(swum, 6))) == 50
