"""Shared worlds on the faces: what infos tell, the medium with its places, a race that ends for all."""

import numpy as np
import pytest
import torch

import swarm
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
    with pytest.raises(RuntimeError, match="reset must be called first"):
        _ = env.medium
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


@pytest.mark.parametrize(
    ("parameters", "error"), [({}, 1e-6), ({"flow": {"type": "taylor_green", "wavenumber": 1.0}}, 0.002)]
)
def test_times_of_arrival_are_found_on_the_path(parameters, error):
    world = swarm.World(**RACE | parameters | {"first_arrivals": 25})
    state, found = world.start(*swarm.draw_starts(world, 200, 1)), 0
    parts = np.linspace(0, 1, 20_001)
    for decision in range(8):
        action = np.full(200, decision % 2)
        before, (state, _) = state, world.step(state, action)
        for cell in np.flatnonzero(np.isfinite(state.arrival_time) & ~before.finished)[:3]:
            pose = (np.repeat(each[cell : cell + 1], len(parts), axis=0) for each in before.pose)
            curvature, length = world.curvatures[decision % 2], world.intervals[0]
            places = swarm.swim(*pose, curvature, 1.0, parts * length, flow=world.flow).position
            first = parts[np.hypot(*places.T) <= 1.0][0] * length
            assert state.arrival_time[cell] == pytest.approx(
                world.time(before)[cell] + first, abs=error + 2e-5
            )
            found += 1
    assert found > 5


def test_who_comes_later_in_the_interval_in_which_the_race_ends_has_not_won():
    env = swarm.parallel_env(
        n_swimmers=3, field="radial", first_arrivals=1, curvatures=(1e-3, 2e-3), time_step=0.5, n_records=2,
        start_box=((-3, 3), (-3, 3)),
    )  # fmt: skip
    starts = {"position": [[1.2, 0], [1.4, 0], [3, 0]], "heading": [np.pi] * 3}
    env.reset(seed=0, options=starts)
    _, _, terminated, _, infos = env.step(dict.fromkeys(env.agents, 0))
    assert [info["arrival_time"] for info in infos.values()] == pytest.approx([0.2, 0.4, 2.0], abs=1e-4)
    assert [info["won"] for info in infos.values()] == [True, False, False]
    assert all(terminated.values())


def test_who_has_finished_does_nothing_to_the_others():
    """Two runs that differ in what a dead cell is told to do, and one without it after it has died."""
    parameters = {
        "medium": {"uptake": 0.1, "box": ((-4, 4), (-4, 4))},
        "interactions": ["contact"],
        "life": 6.0,
    }
    env = SwarmEnv(
        2, n_swimmers=3, seed=0, dtype="float64", field="radial", start_box=((-4, 4), (-4, 4)), **parameters
    )
    env.restart()
    position = torch.tensor([[[1.05, 0.0], [-2.5, 0.0], [0.0, 2.5]]]).repeat(2, 1, 1)
    env.place(
        position, torch.tensor([[np.pi, 0.0, 0.0]]).repeat(2, 1), torch.zeros(2, 3, 4, dtype=torch.int64)
    )
    gains = []
    for decision in range(12):
        action = torch.tensor([[0, 0, 0], [decision % 2, 0, 0]])
        result = env.advance(action)
        gains.append(env.gain()[:, 0])
    assert result.valid.tolist() == [[False, True, True]] * 2
    assert torch.equal(env.state.position[0], env.state.position[1])
    assert torch.equal(env.medium[0], env.medium[1])
    assert torch.equal(gains[0], gains[-1])
    assert (env.state.medium.eaten[:, 1] > 5 * env.state.medium.eaten[:, 0]).all()


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_the_cells_of_a_race_begin_together_and_who_has_finished_waits(mode):
    env = swarm.SpermSwarmVector(30, autoreset_mode=mode, **RACE | {"life": 12.0, "first_arrivals": 5})
    observation, info = env.reset(seed=3)
    waited, races = False, []
    for _ in range(70):
        before = info["waiting"]
        observation, reward, terminated, truncated, info = env.step(
            (observation[:, 0] <= observation[:, 2]).astype(int)
        )
        assert not reward[before].any()
        done = terminated | truncated
        waited |= bool(info["waiting"].any())
        if done.any():
            assert done.all()
            races.append(info["final_info"] if mode == "SameStep" else info)
            assert not info["waiting"].any()
            assert races[-1]["won"].dtype == bool
            np.testing.assert_array_equal(terminated[races[-1]["won"]], True)
    assert waited
    assert len(races) == 2
    assert any(race["won"].sum() == 5 for race in races)


def test_a_cell_that_begins_again_joins_the_medium_as_it_is():
    env = swarm.SpermSwarmVector(
        4,
        autoreset_mode="Disabled",
        medium={"uptake": 0.5, "box": ((-3, 13), (-3, 13))},
        field={"type": "linear", "offset": 9.0},
    )
    env.reset(seed=1)
    for _ in range(6):
        _, _, _, _, info = env.step(np.zeros(4, int))
    before, place = env.medium, env.state()[1, :2]
    first = np.array([True, False, False, False])
    options = {"position": np.tile(place, (4, 1)), "heading": np.zeros(4), "reset_mask": first}
    _, fresh = env.reset(options=options)
    np.testing.assert_array_equal(env.medium, before)
    assert fresh["eaten"].tolist() == [0.0, *info["eaten"][1:]]
    assert fresh["gain"].tolist() == [0.0, *info["gain"][1:]]
    state, world = env.arena.state, env.world
    record = state.memory[0, 0, 0] / world.record_scale
    assert state.start_concentration[0] == pytest.approx(record)
    assert record < world.field.concentration(place) - 0.1
    env.step(np.zeros(4, int))
    balance = float(world.medium.balance(env.arena.state.medium))
    assert abs(balance) < 1e-12 * env.arena.state.medium.eaten.sum()
    env.reset(options={"reset_mask": np.ones(4, bool)})
    assert not env.medium.any()


COMPILED = {
    "medium": {"medium": {"uptake": 0.05, "shape": [64, 64], "substeps": 2}},
    "race": {**RACE, "first_arrivals": 3, "block_delay": 0.5},
    "race in a flow that changes": {**RACE, "flow": "oscillating_taylor_green", "first_arrivals": 3},
    "binding": {"binding_rate": 10.0},
    "contact and spread": {"interactions": ["contact"], "spread": {"speed": 0.1, "curvature": 0.1}},
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:`torch.jit:DeprecationWarning")  # torch's compiler uses it itself
@pytest.mark.parametrize("parameters", COMPILED.values(), ids=COMPILED)
def test_shared_worlds_compile_without_a_warning(parameters, capfd):
    plain, fast = (
        SwarmEnv(2, n_swimmers=8, seed=0, dtype="float64", compile_step=step, **{"life": 4.0} | parameters)
        for step in (False, True)
    )
    plain.restart(), fast.restart()
    for decision in range(12):
        action = torch.randint(2, (2, 8), generator=torch.Generator().manual_seed(decision))
        for one, other in zip(plain.advance(action), fast.advance(action), strict=True):
            assert torch.allclose(one.double(), other.double(), atol=1e-6)
    held, other = (env.state.named("") for env in (plain, fast))
    for name, array in held.items():
        assert torch.allclose(array.double(), other[name].double(), atol=1e-9), name
    assert "going on without" not in capfd.readouterr().err


@pytest.mark.parametrize("make", [swarm.parallel_env, lambda n_swimmers: SwarmEnv(n_swimmers=n_swimmers)])
def test_there_is_no_medium_where_the_world_has_none(make):
    env = make(n_swimmers=2)
    env.reset()
    with pytest.raises(AttributeError, match="medium must be a parameter of the world, got medium=None"):
        _ = env.medium
