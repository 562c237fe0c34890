"""Every cell is an environment of its own, and Gymnasium's conventions about ends and restarts are kept."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics

import swarm
from swarm.envs.gymnasium import SpermSwarmVector
from swarm.physics.starts import draw_noise, draw_starts

MODES = ["SameStep", "NextStep", "Disabled"]


def actions(env, decision):
    """Actions that differ from cell to cell and from decision to decision."""
    return (np.arange(env.num_envs) // 2 + decision) % env.single_action_space.n


def played(world, cells, episode, cell, dtype, start):
    """The life of one cell of the given episode, stepped in the bare world from decision number `start`.

    Yields observation, reward, whether terminated, whether truncated, gain.
    """
    starts = draw_starts(world, cells, 0, population="training", episode=episode)
    state = world.start(starts.position.astype(dtype), starts.heading.astype(dtype), starts.past)
    noise = draw_noise(0, cells, 64, population="training", episode=episode).astype(dtype)
    yield world.observation(state)[cell], 0.0, False, False, 0.0
    for decision in range(64):
        action = (np.arange(cells) // 2 + start + decision) % world.n_actions
        state, outcome = world.step(state, action, noise[:, decision] if world.has_noise else None)
        yield tuple(part[cell] for part in outcome)
        if state.finished[cell]:
            return


WORLDS = {
    "clocks of their own": {"varying_speed": True, "life": 4.0},
    "arrivals": {"field": "radial", "start_box": ((1.2, 2.5), (-1, 1)), "life": 9.0},
    "noise in float32": {
        "rotational_diffusion": 0.05,
        "varying_speed": True,
        "life": 4.0,
        "dtype": "float32",
    },
    "flow": {"flow": "taylor_green", "sense_flow": True, "life": 3.0},
}


@pytest.mark.parametrize("name", WORLDS)
def test_every_cell_lives_one_life_after_another_from_its_own_starts(name):
    env = SpermSwarmVector(5, autoreset_mode="SameStep", **WORLDS[name])
    observation, _ = env.reset(seed=0)
    episodes = np.zeros(5, int)
    lives = [played(env.world, 5, 0, cell, env.arena.dtype, 0) for cell in range(5)]
    for cell in range(5):
        np.testing.assert_array_equal(observation[cell], next(lives[cell])[0])
    for decision in range(60):
        observation, reward, terminated, truncated, info = env.step(actions(env, decision))
        for cell in range(5):
            expected, earned, arrived, over, gain = next(lives[cell])
            assert (reward[cell], terminated[cell], truncated[cell]) == (earned, arrived, over)
            if arrived or over:
                np.testing.assert_array_equal(info["final_obs"][cell], expected)
                assert info["final_info"]["gain"][cell] == gain
                episodes[cell] += 1
                lives[cell] = played(env.world, 5, episodes[cell], cell, env.arena.dtype, decision + 1)
                expected, *_, gain = next(lives[cell])
            np.testing.assert_array_equal(observation[cell], expected)
            assert info["gain"][cell] == gain
    np.testing.assert_array_equal(env.arena.episode, episodes)
    assert episodes.max() > 1


@pytest.mark.parametrize("name", WORLDS)
def test_the_modes_differ_only_in_when_lives_begin(name):
    def lives(mode):
        env = SpermSwarmVector(4, autoreset_mode=mode, **WORLDS[name])
        observation, _ = env.reset(seed=0)
        found, count = {}, np.zeros(4, int)
        over = np.zeros(4, bool)
        for cell in range(4):
            found[cell, 0] = [observation[cell].tolist()]
        for _ in range(60):
            action = np.array([len(found[cell, count[cell]]) % 2 for cell in range(4)])
            if mode == "Disabled" and over.any():
                observation, _ = env.reset(options={"reset_mask": over})
                for cell in np.flatnonzero(over):
                    count[cell] += 1
                    found[cell, count[cell]] = [observation[cell].tolist()]
                over = np.zeros(4, bool)
                continue
            waiting = over
            observation, reward, terminated, truncated, info = env.step(action)
            over = terminated | truncated
            for cell in range(4):
                if mode == "NextStep" and waiting[cell]:
                    assert not over[cell]
                    assert reward[cell] == 0
                    count[cell] += 1
                    found[cell, count[cell]] = [observation[cell].tolist()]
                    continue
                ended = over[cell] and mode == "SameStep"
                last = info["final_obs"][cell] if ended else observation[cell]
                found[cell, count[cell]].append([reward[cell], *last.tolist()])
                if ended:
                    count[cell] += 1
                    found[cell, count[cell]] = [observation[cell].tolist()]
        return found

    same, following, disabled = (lives(mode) for mode in MODES)
    compared = 0
    for life in set(same) & set(following) & set(disabled):
        shortest = min(len(found[life]) for found in (same, following, disabled))
        assert same[life][:shortest] == following[life][:shortest] == disabled[life][:shortest]
        compared += 1
    assert compared > 4


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


def test_spaces_are_batches_of_one_cell_s():
    env = SpermSwarmVector(3, curvatures=(3.0, 4.0, 5.0))
    assert env.num_envs == 3
    assert env.single_action_space == Discrete(3)
    assert env.action_space == MultiDiscrete([3, 3, 3])
    assert env.observation_space.shape == (3, *env.single_observation_space.shape)
    assert np.isfinite(env.observation_space.high).all()


def test_metadata_declares_when_lives_begin():
    for mode in MODES:
        assert SpermSwarmVector(1, autoreset_mode=mode).metadata["autoreset_mode"] is AutoresetMode(mode)
    assert SpermSwarmVector(1).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    given = AutoresetMode.SAME_STEP
    assert SpermSwarmVector(1, autoreset_mode=given).autoreset_mode is given


def test_it_is_registered_with_gymnasium():
    settings = {"flow": "taylor_green", "sense_flow": True, "max_episode_steps": 7}
    env = gymnasium.make_vec("chemoswarm/SpermSwarm-v0", num_envs=4, **settings)
    assert isinstance(env.unwrapped, swarm.SpermSwarmVector)
    assert env.unwrapped.max_cycles == 7
    assert env.num_envs == 4
    assert env.spec.id == "chemoswarm/SpermSwarm-v0"


def test_it_starts_where_the_pettingzoo_face_starts():
    world = swarm.World(n_records=3)
    vector, parallel = SpermSwarmVector(4, world=world), swarm.parallel_env(4, n_records=3)
    assert vector.world is world
    for seed in (3, None):
        observation, _ = vector.reset(seed=seed)
        observations, _ = parallel.reset(seed=seed)
        np.testing.assert_array_equal(observation, np.stack(list(observations.values())))
        np.testing.assert_array_equal(vector.state(), parallel.state())


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


@pytest.mark.skipif(gymnasium.__version__ < "1.4", reason="before, its statistics of vectors miss steps")
def test_gymnasium_s_statistics_add_up_the_rewards_of_lives():
    for mode in ("SameStep", "NextStep"):
        env = DictInfoToList(
            RecordEpisodeStatistics(SpermSwarmVector(3, varying_speed=True, life=4.0, autoreset_mode=mode))
        )
        env.reset(seed=0)
        total, lengths, waiting = np.zeros(3), np.zeros(3, int), np.zeros(3, bool)
        seen = 0
        for decision in range(40):
            _, reward, terminated, truncated, infos = env.step(actions(env, decision))
            total, lengths = total + reward, lengths + ~waiting
            over = terminated | truncated
            for cell in np.flatnonzero(over):
                assert infos[cell]["episode"]["r"] == pytest.approx(total[cell])
                assert infos[cell]["episode"]["l"] == lengths[cell]
                total[cell] = lengths[cell] = 0
                seen += 1
            waiting = over if mode == "NextStep" else waiting
        assert seen > 6


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


def snapshot(env):
    return pickle.dumps(env.__getstate__())


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ([0, 2, 0], ValueError, r"actions must be 3 whole numbers from 0 to 1, got 2 for swimmer_1"),
        ([0, 0, -1], ValueError, "got -1 for swimmer_2"),
        ([0.0, 1.0, 0.0], TypeError, "actions must be 3 whole numbers from 0 to 1, got float64"),
        ([True, False, True], TypeError, "actions must be 3 whole numbers from 0 to 1, got bool"),
        ([0, 1], ValueError, r"got shape \(2,\)"),
        ([[0, 1, 0]], ValueError, r"got shape \(1, 3\)"),
    ],
)
def test_bad_actions_are_told_and_change_nothing(wrong, error, message):
    env = SpermSwarmVector(3)
    env.reset(seed=0)
    before = snapshot(env)
    with pytest.raises(error, match=message):
        env.step(wrong)
    assert snapshot(env) == before


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"reset_mask": [True, False, False]}, ValueError, r"must be a bool array of shape \(3,\)"),
        ({"reset_mask": np.ones(3, int)}, ValueError, r"must be a bool array of shape \(3,\)"),
        ({"reset_mask": np.ones(2, bool)}, ValueError, r"must be a bool array of shape \(3,\)"),
        ({"reset_mask": np.zeros(3, bool)}, ValueError, "must choose at least one cell"),
        ({"position": np.zeros((3, 3))}, ValueError, r"shape \(3, 2\)"),
        (3, TypeError, "options must be a dictionary or None, got 3"),
    ],
)
def test_bad_options_are_told_and_change_nothing(options, error, message):
    env = SpermSwarmVector(3)
    env.reset(seed=0)
    before = snapshot(env)
    with pytest.raises(error, match=message):
        env.reset(options=options)
    assert snapshot(env) == before


@pytest.mark.parametrize("seed", [[3, 4], [3, 4, 5, 6], np.arange(2)])
def test_seeds_must_be_as_many_as_cells(seed):
    env = SpermSwarmVector(3)
    env.reset(seed=0)
    before = snapshot(env)
    with pytest.raises(ValueError, match=f"seed must be one number or a list of 3, got {len(seed)}"):
        env.reset(seed=seed)
    for wrong, error in (([1, 2, -1], ValueError), ([1, 2, "a"], TypeError), ([1, 2.5, 3], TypeError)):
        with pytest.raises(error, match="seed must"):
            env.reset(seed=wrong)
    assert snapshot(env) == before


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


def test_a_seed_for_some_cells_only_is_an_error():
    env = SpermSwarmVector(2)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"seed must be None with options\['reset_mask'\], got 1"):
        env.reset(seed=1, options={"reset_mask": np.array([True, False])})


def test_nothing_is_possible_before_the_first_reset():
    env = SpermSwarmVector(2)
    mask = {"reset_mask": np.ones(2, bool)}
    for call in (lambda: env.step([0, 0]), env.state, env.render, lambda: env.reset(options=mask)):
        with pytest.raises(RuntimeError, match="reset must be called first"):
            call()


def test_without_autoreset_the_finished_must_be_reset():
    env = SpermSwarmVector(2, life=0.1, autoreset_mode="Disabled")
    env.reset(seed=0)
    env.step([0, 0])
    before = snapshot(env)
    with pytest.raises(RuntimeError, match="the lives of swimmer_0, swimmer_1 are over; call reset"):
        env.step([0, 0])
    assert snapshot(env) == before


def test_a_restart_that_fails_leaves_the_lives_as_they_were():
    class Field:
        gradient_scale, broken = 1.0, False

        def concentration(self, position):
            return np.where(self.broken & (position[..., 0] < 10), np.nan, position[..., 1])

    env = SpermSwarmVector(2, field=Field(), life=0.1, autoreset_mode="SameStep")
    env.reset(seed=0, options={"position": np.full((2, 2), 50.0)})
    env.world.field.broken = True
    state, seed = env.state(), env.arena.decision.copy()
    with pytest.raises(ValueError, match="finite"):  # the world goes on, but no next life can begin
        env.step([0, 0])
    np.testing.assert_array_equal(env.state(), state)
    np.testing.assert_array_equal(env.arena.decision, seed)


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ({"autoreset_mode": "samestep"}, ValueError, "autoreset_mode must be .* did you mean 'SameStep'"),
        ({"n_record": 4}, TypeError, "parameter must be one of .* did you mean 'n_records'"),
        ({"world": swarm.World(), "life": 3.0}, TypeError, r"must be given alone, got \['life'\] besides"),
        ({"world": "linear"}, TypeError, "world must be a World, got 'linear'"),
        ({"n_swimmers": 0}, ValueError, "n_swimmers must be"),
    ],
)
def test_wrong_parameters_are_told(wrong, error, message):
    with pytest.raises(error, match=message):
        SpermSwarmVector(**wrong)
