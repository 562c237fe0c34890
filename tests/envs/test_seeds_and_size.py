"""What all faces share: which seeds they take, and that they hold many cells."""

import time

import numpy as np
import pytest

import swarm
from swarm import sperm_swarm_v0
from swarm.envs.gymnasium import SpermSwarmVector
from swarm.torchrl_env import SwarmEnv

SHORT = {"n_swimmers": 3, "life": 2.0}
FACES = {
    "PettingZoo": lambda seed: sperm_swarm_v0.parallel_env(**SHORT).reset(seed=seed)[0]["swimmer_2"],
    "Gymnasium": lambda seed: SpermSwarmVector(**SHORT).reset(seed=seed)[0],
    "TorchRL": lambda seed: np.asarray(SwarmEnv(seed=seed, **SHORT).reset()["swimmers", "observation"]),
    "population": lambda seed: (
        swarm.population_test(swarm.World(), {"greedy": swarm.Greedy()}, cells=2, life=2.0, seed=seed)[
            "gain"
        ].values
    ),
}


@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize("seed", [np.int64(5), np.uint8(7), np.int32(0), np.uint64(2**64 - 1)])
def test_numpy_s_whole_numbers_are_seeds_on_every_face(face, seed):
    assert np.array_equal(FACES[face](seed), FACES[face](int(seed)))


@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize("seed", [2**64, 10**20, -1])
def test_seeds_that_no_result_can_store_are_refused_before_the_work(face, seed):
    with pytest.raises(ValueError, match="seed must"):
        FACES[face](seed)


@pytest.mark.parametrize(
    "parameters", [{}, {"flow": "taylor_green", "sense_flow": True}, {"field": "radial"}]
)
def test_a_hundred_thousand_swimmers_are_there_at_once(parameters):
    began = time.perf_counter()
    env = sperm_swarm_v0.parallel_env(n_swimmers=100_000, **parameters)
    observations, _ = env.reset(seed=0)
    assert time.perf_counter() - began < 3.0
    assert len(observations) == len(env.agents) == 100_000
    last = env.possible_agents[-1]
    assert env.observation_space(last) is env.observation_space(last)
    assert env.observation_space(last).contains(observations[last])


def test_dictionaries_of_spaces_hold_the_very_spaces_of_every_agent():
    env = sperm_swarm_v0.parallel_env(n_swimmers=3)
    first = env.action_space("swimmer_1")
    assert list(env.observation_spaces) == list(env.action_spaces) == env.possible_agents
    assert env.action_spaces["swimmer_1"] is first
    assert env.observation_spaces["swimmer_2"] is env.observation_space("swimmer_2")
    for space in (env.observation_space, env.action_space):
        with pytest.raises(KeyError, match="swimmer_3"):
            space("swimmer_3")


@pytest.mark.parametrize("given", [("position", "heading"), ("position",), ("heading",)])
def test_cells_that_are_begun_again_begin_at_their_poses(given):
    env, plain = (SpermSwarmVector(4, life=2.0, autoreset_mode="Disabled") for _ in range(2))
    poses = {"position": np.arange(8.0).reshape(4, 2), "heading": np.linspace(-1.0, 1.0, 4)}
    poses = {name: poses[name] for name in given}
    cells = np.array([True, False, True, False])
    for each in (env, plain):
        each.reset(seed=1)
    before = env.state()
    env.reset(options={"reset_mask": cells, **poses})
    plain.reset(options={"reset_mask": cells})
    after, usual = env.state(), plain.state()
    for name, columns in (("position", slice(0, 2)), ("heading", slice(2, 3))):
        expected = poses[name].reshape(4, -1) if name in given else usual[:, columns]
        np.testing.assert_allclose(after[cells, columns], expected[cells], atol=1e-12)
    np.testing.assert_array_equal(after[~cells], before[~cells])
    for wrong in ({"position": np.zeros((2, 2))}, {"heading": [np.nan] * 4}, {"position": "here"}):
        with pytest.raises((TypeError, ValueError), match="options"):
            env.reset(options={"reset_mask": cells, **wrong})
    np.testing.assert_array_equal(env.state(), after)
