"""Stable-Baselines3's VecEnv over one shared world tells every end as its algorithms read it."""

import numpy as np
import pytest

import swarm

pytest.importorskip("stable_baselines3", exc_type=ImportError)
from stable_baselines3.common.vec_env import VecMonitor

from swarm.envs.stable_baselines3 import SpermSwarmVecEnv

WORLDS = {
    "clocks of their own": {"varying_speed": True, "life": 3.0},
    "an egg": {"field": "radial", "start_box": ((1.2, 2.5), (-1, 1)), "life": 4.0},
    "in space": {"torsions": (7.7, 5.7), "curvatures": (5.5, 7.5), "speed": 2.0, "life": 1.0},
    "few decisions": {"max_cycles": 3, "medium": {"uptake": 0.05, "shape": (64, 64)}},
}


@pytest.mark.parametrize("name", WORLDS)
def test_it_lives_the_lives_of_the_vector_environment_and_keeps_what_they_ended_with(name):
    env = SpermSwarmVecEnv(4, **WORLDS[name])
    twin = swarm.SpermSwarmVector(4, autoreset_mode="SameStep", **WORLDS[name])
    env.seed(7)
    np.testing.assert_array_equal(env.reset(), twin.reset(seed=7)[0])
    assert [info["gain"] for info in env.reset_infos] == [0.0] * 4
    ends = 0
    for decision in range(30):
        action = (np.arange(4) + decision) % 2
        observation, reward, done, infos = env.step(action)
        expected, earned, terminated, truncated, told = twin.step(action)
        np.testing.assert_array_equal(observation, expected)
        np.testing.assert_array_equal(reward, earned.astype(np.float32))
        np.testing.assert_array_equal(done, terminated | truncated)
        for i, info in enumerate(infos):
            gains = told["final_info"]["gain"] if done[i] else told["gain"]
            assert info["gain"] == gains[i]
            assert ("terminal_observation" in info) == ("TimeLimit.truncated" in info) == done[i]
            if done[i]:
                np.testing.assert_array_equal(info["terminal_observation"], told["final_obs"][i])
                assert info["TimeLimit.truncated"] == (truncated[i] and not terminated[i])
                assert env.reset_infos[i]["gain"] == 0.0
                ends += 1
    assert ends > 4


def test_it_has_the_shared_worlds_attributes_poses_and_picture():
    env = VecMonitor(SpermSwarmVecEnv(3, life=2.0, render_mode="rgb_array"))
    env.set_options({"position": np.ones((3, 2)), "heading": np.zeros(3)})
    env.reset()
    np.testing.assert_array_equal(env.env_method("state", indices=[1])[0][:, :2], np.ones((3, 2)))
    assert env.get_attr("world") == [swarm.World(life=2.0)] * 3
    env.set_attr("max_cycles", 2)
    assert env.get_attr("max_cycles", [0, 2]) == [2, 2]
    assert env.render().shape == (720, 960, 3)
    assert env.env_is_wrapped(VecMonitor, 1) == [False]
    env.step(np.ones(3, int))
    *_, done, infos = env.step(np.ones(3, int))
    assert done.all()
    assert {info["episode"]["l"] for info in infos} == {2}
    env.close()
