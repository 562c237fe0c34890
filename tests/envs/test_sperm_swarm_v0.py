"""The PettingZoo face keeps its contract; what is wrong is told and changes nothing."""

import copy
import inspect
import pickle

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from pettingzoo.utils import aec_to_parallel, wrappers

import swarm
from swarm import sperm_swarm_v0
from swarm.envs.pettingzoo import parallel_env

PATHS = {
    "still water": {},
    "Taylor–Green, flow sensed": {"flow": "taylor_green", "sense_flow": True},
    "varying speed": {"varying_speed": True, "life": 6.01},
    "radial": {"field": "radial", "start_box": ((1.2, 3), (-1, 1))},
    "exact intervals": {"interval_rule": "exact", "varying_speed": True},
    "three curvatures": {"curvatures": (3.0, 4.0, 5.0), "n_records": 2},
    "float32": {"dtype": "float32"},
    "noise": {"concentration_noise": 0.1, "curvature_noise": 0.2, "rotational_diffusion": 0.01},
}


@pytest.fixture(params=PATHS)
def env(request):
    """A small swarm that lives for a few decisions, in every kind of world."""
    return parallel_env(5, **({"life": 6.0} | PATHS[request.param]))


def constant(env, action=0):
    return dict.fromkeys(env.agents, action)


def play(env, *, seed=0, steps=10**6):
    """Random actions; yields what every step returns."""
    generator = np.random.default_rng(seed)
    for _ in range(steps):
        if not env.agents:
            return
        top = env.world.n_actions
        yield env.step({agent: int(generator.integers(top)) for agent in env.agents})


def snapshot(env):
    """All that an environment is, as bytes."""
    return pickle.dumps((env.agents, env.state(), env.__getstate__()))


def test_the_arguments_are_those_that_were_promised():
    assert swarm.parallel_env is sperm_swarm_v0.parallel_env
    promised = {
        "n_swimmers": 40,
        "n_records": 4,
        "field": "linear",
        "flow": "still",
        "sense_flow": False,
        "varying_speed": False,
        "life": 80.0,
        "start_box": None,
        "max_cycles": None,
        "render_mode": None,
        "curvatures": (3.0, 5.0),
        "speed": 1.0,
        "speeds": (1.1, 0.9),
        "time_step": 0.02,
        "interval_rule": "truncated",
        "dtype": "float64",
        "concentration_noise": 0.0,
        "curvature_noise": 0.0,
        "rotational_diffusion": 0.0,
        "curvature_diffusion": 0.0,
        "sensor": None,
        "reward": "own",
        "interactions": (),
        "medium": None,
        "first_arrivals": None,
        "block_delay": 0.0,
        "binding_rate": None,
        "spread": None,
        "units": None,
        "action": "discrete",
        "curvature_range": None,
        "torsions": None,
    }
    for make in (sperm_swarm_v0.parallel_env, sperm_swarm_v0.env, sperm_swarm_v0.raw_env):
        parameters = inspect.signature(make).parameters
        assert {name: item.default for name, item in parameters.items()} == promised
        assert list(parameters) == list(promised)


def test_agents_are_named_swimmers_and_have_a_space_each(env):
    env.reset(seed=0)
    assert env.agents == env.possible_agents == [f"swimmer_{i}" for i in range(5)]
    for agent in env.agents:
        assert env.observation_space(agent) is env.observation_space(agent)
        assert env.action_space(agent) == Discrete(env.world.n_actions)
        assert env.observation_space(agent).shape == (env.world.observation_size,)
    assert env.action_space("swimmer_0") is not env.action_space("swimmer_1")  # each is seeded by itself


def test_spaces_are_finite_and_what_is_told_are_numbers(env):
    _, infos = env.reset(seed=0)
    assert infos == {agent: {"gain": 0.0} for agent in env.possible_agents}
    spaces = [env.state_space, env.observation_space("swimmer_0")]
    assert all(isinstance(space, Box) for space in spaces)
    assert all(np.isfinite(space.low).all() and np.isfinite(space.high).all() for space in spaces)
    for seen, rewards, *_, told in play(env):
        assert all(observation.dtype == np.float32 for observation in seen.values())
        assert all(type(reward) is float and np.isfinite(reward) for reward in rewards.values())
        assert all(set(info) == {"gain"} and type(info["gain"]) is float for info in told.values())


def test_state_is_where_swimmers_are_how_they_head_and_what_they_did():
    env = parallel_env(2, dtype="float64")
    poses = {"position": [(1.0, 2.0), (-30.0, 4.0)], "heading": [0.5, -3.0]}
    env.reset(seed=0, options=poses)
    np.testing.assert_allclose(env.state()[:, :2], poses["position"])
    np.testing.assert_allclose(env.state()[:, 2], poses["heading"])
    env.step({"swimmer_0": 0, "swimmer_1": 1})
    state = env.state()
    assert state.shape == (2, 4)
    np.testing.assert_array_equal(state[:, 3], [3.0, 5.0])
    np.testing.assert_allclose(state[:, 2], [0.5 + 3 * 0.38, -3.0 + 5 * 0.38])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_state_has_the_dtype_that_was_chosen(dtype):
    env = parallel_env(2, dtype=dtype, flow="taylor_green", rotational_diffusion=0.1)
    env.reset(seed=0)
    for _ in play(env, steps=5):
        assert env.state().dtype == env.state_space.dtype == dtype
        assert all(part.dtype == dtype for part in env.arena.state[:3])


def test_max_cycles_truncates_too_and_whichever_comes_first():
    for life, max_cycles, expected in ((80.0, 7, 7), (1.0, 7, 3), (1.0, 3, 3)):
        env = parallel_env(3, life=life, max_cycles=max_cycles)
        for _ in range(2):
            env.reset(seed=0)
            steps = list(play(env))
            assert len(steps) == expected
            assert not env.agents
            assert steps[-1][3] == dict.fromkeys(env.possible_agents, True)
            assert not any(steps[-1][2].values())


def test_swimmers_with_clocks_of_their_own_leave_one_after_another():
    env = parallel_env(2, varying_speed=True, life=3.5)
    env.reset(seed=0)
    leaving = []
    while env.agents:
        before = env.agents[:]
        outputs = env.step({agent: int(agent[-1]) for agent in env.agents})
        for output in outputs:
            assert list(output) == before
        leaving.append([agent for agent in before if agent not in env.agents])
        for agent in before:
            assert (agent in env.agents) == (not outputs[2][agent] and not outputs[3][agent])
    # intervals of 0.42 end a life of 3.5 with the ninth, those of 0.34 with the eleventh
    assert leaving[8] == ["swimmer_1"]
    assert leaving[10] == ["swimmer_0"]


def test_the_finished_stay_where_they_are_and_in_the_state():
    env = parallel_env(2, varying_speed=True, life=3.5)
    env.reset(seed=0)
    while len(env.agents) == 2:
        env.step({agent: int(agent[-1]) for agent in env.agents})
    rested, before = env.state()[1], snapshot(env)
    assert rested[3] == 5.0
    with pytest.raises(ValueError, match="got none for swimmer_0"):
        env.step({"swimmer_1": 0})
    assert snapshot(env) == before
    env.step({"swimmer_0": 0})
    np.testing.assert_array_equal(env.state()[1], rested)
    env.step({"swimmer_0": 0, "swimmer_1": "whatever"})  # wrappers send them; nobody reads them
    np.testing.assert_array_equal(env.state()[1], rested)


@pytest.mark.parametrize("max_cycles", [None, 1])
def test_reaching_the_egg_is_a_termination_and_no_truncation(max_cycles):
    env = parallel_env(2, field="radial", life=400.0, max_cycles=max_cycles)
    env.reset(seed=0, options={"position": [(1.1, 0.0), (9.0, 9.0)], "heading": [np.pi, 0.0]})
    _, _, terminations, truncations, _ = env.step(constant(env))
    assert terminations == {"swimmer_0": True, "swimmer_1": False}
    assert truncations == {"swimmer_0": False, "swimmer_1": max_cycles == 1}
    assert env.agents == ([] if max_cycles else ["swimmer_1"])


def test_a_seed_begins_a_stream_of_episodes():
    env, other = parallel_env(3), parallel_env(3)
    env.reset(seed=7)
    first = env.state()
    env.reset()
    second = env.state()
    env.step(constant(env))
    env.reset()
    third = env.state()
    assert len(np.unique(np.stack([first, second, third])[:, 0, 0])) == 3
    for expected in (first, second, third):
        other.reset(seed=7) if expected is first else other.reset()
        np.testing.assert_array_equal(other.state(), expected)
    env.reset(seed=7)
    np.testing.assert_array_equal(env.state(), first)


def test_without_a_seed_every_environment_begins_elsewhere():
    first, second = parallel_env(1), parallel_env(1)
    first.reset()
    second.reset()
    assert not np.array_equal(first.state(), second.state())


def test_one_pose_option_leaves_the_other_to_the_seed_and_unknown_ones_are_ignored():
    env = parallel_env(3)
    env.reset(seed=0)
    drawn = env.state()
    env.reset(seed=0, options={"heading": [0.0, 1.0, 2.0], "options": 1, "positions": "everywhere"})
    np.testing.assert_array_equal(env.state()[:, :2], drawn[:, :2])
    np.testing.assert_allclose(env.state()[:, 2], [0.0, 1.0, 2.0])


def begun(**settings):
    env = parallel_env(3, **settings)
    env.reset(seed=0)
    env.step(constant(env))
    return env


@pytest.mark.parametrize("kind", [int, np.int64, np.int32, np.uint8, np.array])
def test_whole_numbers_of_any_kind_are_actions(kind):
    env, plain = begun(), begun()
    env.step({agent: kind(1) for agent in env.agents})
    plain.step(constant(plain, 1))
    np.testing.assert_array_equal(env.state(), plain.state())


def test_more_curvatures_than_a_byte_holds_can_be_chosen_from():
    env = parallel_env(1, curvatures=tuple(np.linspace(3, 5, 301)))
    env.reset(seed=0)
    env.step({"swimmer_0": 300})
    assert env.state()[0, 3] == 5.0
    with pytest.raises(ValueError, match="swimmer_0 must be a whole number from 0 to 300, got 301"):
        env.step({"swimmer_0": 301})


@pytest.mark.parametrize("actions", [{}, {"swimmer_0": 1}, {"swimmer_0": "whatever", "swimmer_1": None}])
def test_a_step_after_the_end_returns_five_empty_dictionaries_and_changes_nothing(actions):
    env = parallel_env(2, max_cycles=1)
    env.reset(seed=0)
    env.step(constant(env))
    before = snapshot(env)
    assert env.step(actions) == ({}, {}, {}, {}, {})
    with pytest.raises(ValueError, match="for swimmer_0 to swimmer_1, got one for 'swimmer_2'"):
        env.step({"swimmer_2": 0})
    assert snapshot(env) == before


def test_an_agent_has_a_row_and_others_are_refused():
    env = parallel_env(3)
    env.reset(seed=0)
    assert [env.agent_index(agent) for agent in env.possible_agents] == [0, 1, 2]
    assert sperm_swarm_v0.env(3).agent_index("swimmer_2") == 2
    for wrong in ("swimmer_3", "cell_0", 1):
        with pytest.raises(ValueError, match="agent must be one of swimmer_0 to swimmer_2, got "):
            env.agent_index(wrong)


def test_the_generator_for_wrappers_follows_the_seed_and_decides_nothing():
    env, plain = parallel_env(2), parallel_env(2)
    assert env.np_random.random() != plain.np_random.random()
    for each in (env, plain):
        each.reset(seed=3)
    drawn = env.np_random.random()
    assert drawn == plain.np_random.random()
    env.reset()  # without a seed it goes on
    assert env.np_random.random() != drawn
    plain.reset()
    np.testing.assert_array_equal(env.state(), plain.state())
    env.reset(seed=3)
    assert env.np_random.random() == drawn


# What MPE2 1.1.1 offers the users of an environment, the agents in turns, and its own physics and drawing.
MPE2 = {
    *("action_space", "action_spaces", "agents", "close", "max_cycles", "max_num_agents", "metadata"),
    *("np_random", "num_agents", "observation_space", "observation_spaces", "possible_agents", "render"),
    *("render_mode", "reset", "state", "state_space", "step", "steps", "unwrapped", "world"),
}
IN_TURNS = {"agent_iter", "agent_selection", "infos", "last", "observe", "rewards", "terminations"}
IN_TURNS |= {"truncations"}
ITS_OWN = {
    *("advance_curriculum", "aec_env", "benchmark_data", "continuous_actions", "current_actions", "draw"),
    *("curriculum_stage", "dynamic_rescaling", "enable_render", "game_font", "height", "local_ratio"),
    *("max_size", "original_cam_range", "renderOn", "scenario", "screen", "set_curriculum_stage", "viewer"),
    "width",
}


def attributes(env):
    while env is not None:
        yield from (name for name in dir(env) if not name.startswith("_") and name != "env")
        env = vars(env).get("env", vars(env).get("aec_env"))


@pytest.mark.parametrize("kind", ["parallel_env", "env", "raw_env"])
def test_whatever_attribute_mpe2_offers_is_there_without_a_warning(kind):
    env = getattr(sperm_swarm_v0, kind)(3)
    env.reset(seed=0)
    for name in MPE2 | (set() if kind == "parallel_env" else IN_TURNS):
        assert hasattr(env, name), name
    spread = pytest.importorskip("mpe2.simple_spread_v3")
    theirs = getattr(spread, kind)()
    theirs.reset(seed=0)
    assert set(attributes(theirs)) <= MPE2 | IN_TURNS | ITS_OWN


@pytest.mark.parametrize("make", [sperm_swarm_v0.env, sperm_swarm_v0.raw_env])
@pytest.mark.parametrize("name", PATHS)
def test_agents_that_act_in_turn_live_the_same_lives(make, name):
    settings = {"life": 6.0} | PATHS[name]
    turns, together = make(4, **settings), parallel_env(4, **settings)
    turns.reset(seed=2)
    observations, _ = together.reset(seed=2)
    returned = (observations, *(dict.fromkeys(together.agents, value) for value in (0, False, False)))
    generator = np.random.default_rng(0)
    while together.agents:
        action = {agent: int(generator.integers(together.world.n_actions)) for agent in together.agents}
        for agent in together.agents:
            assert turns.agent_selection == agent
            observation, reward, terminated, truncated, _ = turns.last()
            np.testing.assert_array_equal(observation, returned[0][agent])
            assert (reward, terminated, truncated) == tuple(part[agent] for part in returned[1:4])
            turns.step(action[agent])
        returned = together.step(action)
        while turns.agents and (
            turns.terminations[turns.agent_selection] or turns.truncations[turns.agent_selection]
        ):
            agent = turns.agent_selection
            assert returned[2][agent] or returned[3][agent]
            turns.step(None)
        np.testing.assert_array_equal(turns.state(), together.state())
    assert not turns.agents


def test_raw_env_becomes_the_parallel_environment_again():
    assert isinstance(aec_to_parallel(sperm_swarm_v0.raw_env(3)), sperm_swarm_v0.SpermSwarm)


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_like_the_original_and_apart_from_it(env, duplicate):
    env.reset(seed=0)
    for _ in play(env, steps=3):
        pass
    twin = duplicate(env)
    ours = [(outputs[0], outputs[1]) for outputs in play(env, seed=1)]
    theirs = [(outputs[0], outputs[1]) for outputs in play(twin, seed=1)]
    assert len(ours) == len(theirs) > 0
    for (observations, rewards), (others, other_rewards) in zip(ours, theirs, strict=True):
        assert rewards == other_rewards
        for agent, observation in observations.items():
            np.testing.assert_array_equal(observation, others[agent])
    env.reset()
    twin.reset()
    np.testing.assert_array_equal(env.state(), twin.state())


def test_an_environment_can_be_copied_before_its_first_reset():
    env = pickle.loads(pickle.dumps(parallel_env(2)))
    env.reset(seed=0)
    assert env.agents == ["swimmer_0", "swimmer_1"]


def test_returned_arrays_belong_to_the_caller():
    env, plain = parallel_env(2), parallel_env(2)
    observations, _ = env.reset(seed=0)
    plain.reset(seed=0)
    observations["swimmer_0"][:] = 0
    env.state()[:] = 0
    for _ in range(3):
        observations = env.step(constant(env))[0]
        expected = plain.step(constant(plain))[0]
        np.testing.assert_array_equal(observations["swimmer_1"], expected["swimmer_1"])
        observations["swimmer_0"][:] = 7
    np.testing.assert_array_equal(env.state(), plain.state())


def test_what_a_wrapper_adds_to_one_environment_s_metadata_no_other_has():
    wrappers.CaptureStdoutWrapper(sperm_swarm_v0.raw_env(2, render_mode="human"))
    assert parallel_env(2).metadata["render_modes"] == ["human", "rgb_array"]
    with pytest.raises(ValueError, match="render_mode must be one of human, rgb_array, got 'ansi'"):
        parallel_env(2, render_mode="ansi")
