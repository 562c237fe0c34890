"""Continuous steering on every face: the same lives, spaces that say so, and errors that change nothing."""

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box

import swarm
from swarm.torchrl_env import SwarmEnv

torch = pytest.importorskip("torch")

STEERED = {"action": "continuous", "curvature_range": (-1.0, 5.0), "life": 4.0}
CELLS = 3


def test_one_cell_lives_as_swimmer_0_does():
    alone = gymnasium.make("chemoswarm/SpermSwarm-v0", **STEERED).unwrapped
    together, vector = swarm.parallel_env(1, **STEERED), swarm.SpermSwarmVector(1, **STEERED)
    vector.reset(seed=2)
    alone.reset(seed=2)
    together.reset(seed=2)
    for action in (np.array([-1.0], np.float32), 0.0, 3):
        together.step({"swimmer_0": action})
        alone.step(action)
        vector.step(np.reshape(action, 1))
    np.testing.assert_array_equal(alone.state(), together.state())
    np.testing.assert_array_equal(vector.state(), together.state())


def test_spaces_are_boxes_over_the_range():
    parallel, vector = swarm.parallel_env(CELLS, **STEERED), swarm.SpermSwarmVector(CELLS, **STEERED)
    box = Box(-1.0, 5.0, (1,), np.float32)
    assert parallel.action_space("swimmer_1") == vector.single_action_space == box
    assert vector.action_space.shape == (CELLS, 1)
    spec = SwarmEnv(2, n_swimmers=CELLS, **STEERED).full_action_spec["swimmers", "action"]
    assert spec.shape == (2, CELLS, 1)
    assert (spec.space.low.unique().item(), spec.space.high.unique().item()) == (-1, 5)
    assert swarm.parallel_env(1, action="continuous").action_space("swimmer_0") == Box(
        3.0, 5.0, (1,), np.float32
    )


def test_stable_baselines3_learns():
    pytest.importorskip("stable_baselines3", exc_type=ImportError)
    from stable_baselines3 import PPO

    from swarm.envs.stable_baselines3 import SpermSwarmVecEnv

    env = SpermSwarmVecEnv(CELLS, **STEERED)
    PPO("MlpPolicy", env, n_steps=8, batch_size=8, n_epochs=1, seed=0, device="cpu").learn(48)
    _, _, done, infos = env.step(np.full((CELLS, 1), 4.0, np.float32))
    assert len(infos) == len(done) == CELLS


def test_a_policy_of_the_observation_may_choose_curvatures():
    world = swarm.World(**STEERED)
    chosen = swarm.FromObservation(lambda seen: np.clip(3 + seen[..., 0], -1, 5))
    found = swarm.population_test(world, {"own": chosen}, cells=3, life=4)
    assert len(np.unique(found["curvature"].sel(policy="own").values[:, 1:])) > 20
    with pytest.raises(ValueError, match=r"actions must lie in -1 … 5, got 7"):
        swarm.population_test(
            world, {"own": swarm.FromObservation(lambda seen: 7 + 0 * seen[..., 0])}, cells=1
        )
    with pytest.raises(ValueError, match="actions must be curvatures, one for each cell"):
        swarm.population_test(world, {"own": swarm.FromObservation(lambda seen: np.zeros(1, int))}, cells=1)
