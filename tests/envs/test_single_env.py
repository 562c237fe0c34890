"""One cell is an ordinary Gymnasium environment and lives the life of a swarm's first."""

import gymnasium
import numpy as np
import pytest

import swarm
from swarm.envs.single import SpermSwimmer

NAME = "swarm:chemoswarm/SpermSwarm-v0"


@pytest.mark.parametrize(
    "settings",
    [
        {"life": 3.0},
        {"field": "radial", "start_box": ((1.2, 2.5), (-1, 1)), "life": 9.0, "dtype": "float32"},
        {"medium": {"uptake": 0.05, "shape": (64, 64)}, "life": 3.0, "max_cycles": 4},
        {"field": "radial", "first_arrivals": 1, "curvature_noise": 0.1, "concentration_noise": 0.1},
    ],
)
def test_it_lives_the_life_of_the_only_swimmer_of_the_other_face(settings):
    env, swimmers = gymnasium.make(NAME, **settings), swarm.parallel_env(1, **settings)
    for seed in (3, None):
        observation, info = env.reset(seed=seed)
        observations, infos = swimmers.reset(seed=seed)
        np.testing.assert_array_equal(observation, observations["swimmer_0"])
        assert info == infos["swimmer_0"]
        while swimmers.agents:
            action = int(swimmers.state()[0, 0] * 7) % 2
            expected = [part["swimmer_0"] for part in swimmers.step({"swimmer_0": action})]
            returned = env.step(action)
            np.testing.assert_array_equal(returned[0], expected[0])
            assert list(returned[1:]) == expected[1:]
            np.testing.assert_array_equal(env.unwrapped.state(), swimmers.state())
        assert expected[2] or expected[3]


def test_a_pose_may_be_given_and_gymnasium_s_own_limit_truncates():
    env = gymnasium.make(NAME, max_episode_steps=2)
    env.reset(seed=0, options={"position": [(1.0, 2.0)], "heading": [0.5]})
    np.testing.assert_allclose(env.unwrapped.state()[0, :3], [1.0, 2.0, 0.5])
    assert [env.step(0)[3] for _ in range(2)] == [False, True]


def test_what_cannot_be_is_told_and_changes_nothing():
    env = SpermSwimmer(life=0.1)
    for call in (lambda: env.step(0), env.state, env.render):
        with pytest.raises(RuntimeError, match="reset must be called first"):
            call()
    env.reset(seed=0)
    before = env.state()
    for wrong in (2, -1, 0.5, None, [0]):
        with pytest.raises(ValueError, match="action must be a whole number from 0 to 1, got "):
            env.step(wrong)
    np.testing.assert_array_equal(env.state(), before)
    env.step(np.int64(1))
    with pytest.raises(RuntimeError, match="step: the life is over; call reset"):
        env.step(0)
    with pytest.raises(TypeError, match=r"did you mean 'n_records'.* keyword argument 'n_record'"):
        gymnasium.make(NAME, n_record=3)


def test_torchrl_makes_it_by_name():
    envs = pytest.importorskip("torchrl.envs")
    rollout = envs.GymEnv(NAME, life=3.0).rollout(100)
    assert rollout["next", "truncated"].sum() == 1


def test_pictures_are_made_when_they_are_asked_for():
    env = SpermSwimmer(render_mode="rgb_array", life=2.0)
    env.reset(seed=0)
    env.step(0)
    assert env._viewer is None
    assert env.render().shape == (720, 960, 3)
    assert len(env._viewer.trail) == 1
