"""Shared worlds on the faces: what infos tell, the medium with its places, a race that ends for all."""

import numpy as np
import pytest

import swarm
from swarm.physics.motion.arc import along_arc, arc
from swarm.torchrl_env import SwarmEnv

EATING = {"medium": {"uptake": 0.05, "shape": [64, 64]}, "life": 3.0}
RACE = {"field": "radial", "first_arrivals": 2, "start_box": ((-2.5, 2.5), (-2.5, 2.5)), "life": 40.0}


def play(env, policy=None):
    """Infos of every step of an episode."""
    observations, infos = env.reset(seed=3)
    told = [infos]
    while env.agents:
        actions = {agent: int(observations[agent][0] <= observations[agent][2]) for agent in env.agents}
        observations, _, terminated, truncated, infos = env.step(actions)
        told.append(infos)
    return told, terminated, truncated


def test_infos_tell_what_each_cell_has_eaten_and_the_medium_lacks_it():
    env = swarm.parallel_env(n_swimmers=5, **EATING)
    told, *_ = play(env)
    last = {agent: info for infos in told for agent, info in infos.items()}
    eaten = np.array([info["eaten"] for info in last.values()])
    assert (eaten > 0).all()
    assert all(info["eaten"] == 0 for info in told[0].values())
    grid = env.medium
    assert grid.dims == ("x", "y")
    assert grid.shape == (64, 64)
    area = float((grid.x[1] - grid.x[0]) * (grid.y[1] - grid.y[0]))
    assert -float(grid.sum()) * area == pytest.approx(eaten.sum(), rel=1e-9)
    lowest = grid.where(grid == grid.min(), drop=True)
    nearest = np.hypot(*(env.state()[:, :2] - [float(lowest.x[0]), float(lowest.y[0])]).T).min()
    assert nearest < 1.0


def test_there_is_no_medium_where_the_world_has_none():
    env = swarm.parallel_env(n_swimmers=2)
    env.reset(seed=0)
    with pytest.raises(AttributeError, match="medium must be a parameter of the world, got medium=None"):
        _ = env.medium


def test_a_race_ends_for_all_and_infos_tell_who_has_won():
    env = swarm.parallel_env(n_swimmers=30, **RACE)
    told, terminated, truncated = play(env)
    assert all(terminated.values())
    assert not any(truncated.values())
    last = {agent: info for infos in told for agent, info in infos.items()}
    winners = [agent for agent, info in last.items() if info["won"]]
    assert len(winners) == 2
    times = sorted(info["arrival_time"] for info in last.values())
    assert sorted(last[agent]["arrival_time"] for agent in winners) == times[:2]


def test_times_of_arrival_are_found_on_the_path():
    world = swarm.World(**RACE)
    state = world.start(*swarm.draw_starts(world, 40, 1))
    action = np.zeros(40, int)
    while not np.isfinite(state.arrival_time).any():
        before = state
        state, _ = world.step(state, action)
    cell = int(np.argmin(state.arrival_time))
    parts = np.linspace(0, 1, 200_001)
    pose = before.pose._replace(position=before.position[cell], heading=before.heading[cell])
    places = along_arc(pose, arc(np.full(parts.shape, 3.0), 1.0, parts * world.intervals[0])).position
    first = parts[np.hypot(*places.T) <= 1.0][0]
    expected = world.time(before)[cell] + first * world.intervals[0]
    assert state.arrival_time[cell] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("parameters", [EATING, {"interactions": ["contact"], "life": 3.0}])
def test_all_faces_see_the_same_shared_world(parameters):
    parallel = swarm.parallel_env(n_swimmers=6, **parameters)
    vector = swarm.SpermSwarmVector(6, autoreset_mode="Disabled", **parameters)
    many = SwarmEnv(1, n_swimmers=6, dtype="float64", seed=4, **parameters)
    parallel.reset(seed=4)
    vector.reset(seed=4)
    many.restart()
    for _ in range(4):
        action = np.random.default_rng(0).integers(2, size=6)
        infos = parallel.step(dict(zip(parallel.agents, action.tolist(), strict=True)))[-1]
        info = vector.step(action)[-1]
        many.advance(many._tensor(action)[None])
        np.testing.assert_array_equal(parallel.state(), vector.state())
        np.testing.assert_allclose(many.state.position[0].numpy(), parallel.state()[:, :2], atol=1e-12)
        for name in infos["swimmer_0"]:
            np.testing.assert_array_equal([each[name] for each in infos.values()], info[name])
