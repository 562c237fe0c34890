"""Every cell is an environment of its own, and Gymnasium's conventions about ends and restarts are kept."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import swarm
from swarm.envs.gymnasium import SpermSwarmVector, SpermSwimmer
from swarm.physics.starts import draw_noise, draw_record_noise, draw_starts

ALONE = "swarm:chemoswarm/SpermSwarm-v0"
MODES = ["SameStep", "NextStep", "Disabled"]


def actions(env, decision):
    """Actions that differ from cell to cell and from decision to decision."""
    return (np.arange(env.num_envs) // 2 + decision) % env.single_action_space.n


def life_of(env, cell, episode, start):
    """The life of one cell of an episode in the bare world, from decision number `start` on.

    Yields observation, reward, whether terminated, whether truncated, gain.
    """
    world, cells, dtype = env.world, env.num_envs, env.arena.dtype
    which = {"population": "training", "episode": episode}
    starts, recorded = (draw(world, cells, 0, **which) for draw in (draw_starts, draw_record_noise))
    poses = starts.position.astype(dtype), starts.heading.astype(dtype)
    recorded = None if recorded is None else recorded.astype(dtype)
    state = world.start(*poses, starts.past, noise=recorded)
    noise = draw_noise(0, cells, 64, **which).astype(dtype)
    yield world.observation(state)[cell], 0.0, False, False, 0.0
    for decision in range(64):
        action = actions(env, start + decision)
        state, outcome = world.step(state, action, noise[:, decision] if world.has_noise else None)
        yield tuple(part[cell] for part in outcome)


WORLDS = {
    "clocks of their own": {"varying_speed": True, "life": 4.0},
    "arrivals": {"field": "radial", "start_box": ((1.2, 2.5), (-1, 1)), "life": 9.0},
    "noise in float32": {
        "rotational_diffusion": 0.05,
        "concentration_noise": 0.1,
        "varying_speed": True,
        "life": 4.0,
        "dtype": "float32",
    },
    "flow": {"flow": "taylor_green", "sense_flow": True, "life": 3.0},
}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", WORLDS)
def test_every_cell_lives_one_life_after_another_from_its_own_starts(name, mode):
    env = SpermSwarmVector(5, autoreset_mode=mode, **WORLDS[name])
    observation, _ = env.reset(seed=0)
    episodes, over = np.zeros(5, int), np.zeros(5, bool)
    lives = [life_of(env, cell, 0, 0) for cell in range(5)]
    for cell in range(5):
        np.testing.assert_array_equal(observation[cell], next(lives[cell])[0])

    def begun(cell, start):
        episodes[cell] += 1
        lives[cell] = life_of(env, cell, episodes[cell], start)
        return next(lives[cell])

    for decision in range(60):
        if mode == "Disabled" and over.any():
            observation, _ = env.reset(options={"reset_mask": over})
            for cell in np.flatnonzero(over):
                np.testing.assert_array_equal(observation[cell], begun(cell, decision)[0])
        before = over
        observation, reward, terminated, truncated, info = env.step(actions(env, decision))
        over = terminated | truncated
        for cell in range(5):
            fresh = mode == "NextStep" and before[cell]
            expected = begun(cell, decision + 1) if fresh else next(lives[cell])
            assert (reward[cell], terminated[cell], truncated[cell]) == expected[1:4]
            if over[cell] and mode == "SameStep":
                np.testing.assert_array_equal(info["final_obs"][cell], expected[0])
                assert info["final_info"]["gain"][cell] == expected[-1]
                expected = begun(cell, decision + 1)
            np.testing.assert_array_equal(observation[cell], expected[0])
            assert info["gain"][cell] == expected[-1]
    np.testing.assert_array_equal(env.arena.episode, episodes)
    assert episodes.max() > 1


def test_ends_are_told_as_gymnasium_s_own_vector_environments_tell_them():
    class Short(gymnasium.Env):
        observation_space, action_space = Box(-1, 1, (8,), np.float32), Discrete(2)

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            return np.zeros(8, np.float32), {"gain": 0.0}

        def step(self, action):
            return np.ones(8, np.float32), 1.0, False, True, {"gain": 1.0}

    theirs = SyncVectorEnv([Short] * 3, autoreset_mode=AutoresetMode.SAME_STEP)
    ours = SpermSwarmVector(3, life=0.1, autoreset_mode="SameStep")
    for env in (theirs, ours):
        env.reset(seed=0)
    their, our = (env.step(np.zeros(3, int)) for env in (theirs, ours))

    def form(part):
        if isinstance(part, dict):
            return {key: form(value) for key, value in part.items()}
        return part.dtype, part.shape, type(part[0])

    assert form(dict(enumerate(their))) == form(dict(enumerate(our)))
    np.testing.assert_array_equal(our[4]["_final_obs"], [True] * 3)


def test_it_is_registered_with_gymnasium():
    settings = {"flow": "taylor_green", "sense_flow": True, "max_episode_steps": 7}
    env = gymnasium.make_vec("chemoswarm/SpermSwarm-v0", num_envs=4, **settings)
    assert isinstance(env.unwrapped, swarm.SpermSwarmVector)
    assert env.unwrapped.max_cycles == 7
    assert env.num_envs == 4
    assert env.spec.id == "chemoswarm/SpermSwarm-v0"


def test_max_cycles_truncates_each_cell_counting_from_its_own_start():
    settings = {"field": "radial", "life": 400.0, "max_cycles": 4}
    env = SpermSwarmVector(2, autoreset_mode="SameStep", **settings)
    env.reset(seed=0, options={"position": [(1.1, 0.0), (9.0, 9.0)], "heading": [np.pi, 0.0]})
    ends = []
    for _ in range(9):
        *_, terminated, truncated, _ = env.step(np.zeros(2, int))
        ends.append((terminated.tolist(), truncated.tolist()))
    assert ends[0] == ([True, False], [False, False])
    assert ends[3][1] == [False, True]
    assert ends[4][1] == [True, False]
    assert ends[7][1] == [False, True]


def test_a_mask_restarts_only_some_cells():
    env = SpermSwarmVector(3)
    env.reset(seed=0)
    env.step(np.array([0, 1, 1]))
    before = env.state()
    observation, info = env.reset(options={"reset_mask": np.array([False, True, False])})
    after = env.state()
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    assert (after[1] != before[1]).any()
    assert info["gain"][1] == 0
    assert env.arena.episode.tolist() == [0, 1, 0]
    np.testing.assert_array_equal(observation[0], env.world.observation(env.arena.state)[0])


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_like_the_original_and_apart_from_it(duplicate):
    env = SpermSwarmVector(4, varying_speed=True, life=3.0, curvature_noise=0.1)
    env.reset(seed=0)
    env.step(actions(env, 0))
    twin = duplicate(env)
    for decision in range(70):
        ours, theirs = (each.step(actions(each, decision)) for each in (env, twin))
        for a, b in zip(ours[:4], theirs[:4], strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_cell_with_a_seed_of_its_own_lives_as_it_would_alone():
    settings = {"varying_speed": True, "life": 3.0, "concentration_noise": 0.1, "curvature_noise": 0.1}
    env = SpermSwarmVector(3, autoreset_mode="SameStep", **settings)
    env.reset(seed=9)
    for seeds, again in ((np.array([5, 2**64 - 1, 7], np.uint64), None), ([None, 8, None], None)):
        alone = [SpermSwarmVector(1, autoreset_mode="SameStep", **settings) for _ in seeds]
        observation, _ = env.reset(seed=seeds)
        given = env.arena.seeds
        for i, each in enumerate(alone):
            each.reset(seed=given[i])
            for _ in range(int(env.arena.episode[i])):
                each.reset(seed=again)
            np.testing.assert_array_equal(each.arena.state.position[0], env.arena.state.position[i])
        for decision in range(25):
            action = actions(env, decision)
            observation, reward, *_ = env.step(action)
            for i, each in enumerate(alone):
                seen, earned, *_ = each.step(action[[i]])
                np.testing.assert_array_equal(seen[0], observation[i])
                assert earned[0] == reward[i]
    assert given[1] == 8
    assert env.arena.seeds[::2] == (5, 7)


def test_spaces_are_batches_of_one_cell_s_and_metadata_declares_when_lives_begin():
    env = SpermSwarmVector(3, curvatures=(3.0, 4.0, 5.0))
    assert env.num_envs == 3
    assert env.single_action_space == Discrete(3)
    assert env.action_space == MultiDiscrete([3, 3, 3])
    assert env.observation_space.shape == (3, *env.single_observation_space.shape)
    assert np.isfinite(env.observation_space.high).all()
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    for mode in AutoresetMode:
        for given in (mode, mode.value):
            assert SpermSwarmVector(1, autoreset_mode=given).metadata["autoreset_mode"] is mode


def test_one_cell_alone_takes_a_pose_and_gymnasium_s_own_limit_truncates():
    env = gymnasium.make(ALONE, max_episode_steps=2)
    env.reset(seed=0, options={"position": [(1.0, 2.0)], "heading": [0.5]})
    np.testing.assert_allclose(env.unwrapped.state()[0, :3], [1.0, 2.0, 0.5])
    assert [env.step(0)[3] for _ in range(2)] == [False, True]


def test_torchrl_makes_one_cell_by_name():
    envs = pytest.importorskip("torchrl.envs")
    rollout = envs.GymEnv(ALONE, life=3.0).rollout(100)
    assert rollout["next", "truncated"].sum() == 1


def test_pictures_are_made_when_they_are_asked_for():
    env = SpermSwimmer(render_mode="rgb_array", life=2.0)
    env.reset(seed=0)
    env.step(0)
    assert env._viewer is None
    assert env.render().shape == (720, 960, 3)
    assert len(env._viewer.trail) == 1
