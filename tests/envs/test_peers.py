"""Other libraries' own tests and wrappers: what works with their environments works with ours.

`make peers` installs the libraries and runs all of it; without them a part is skipped.
"""

import importlib
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers as single
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector
from pettingzoo.utils import conversions, wrappers

from swarm import sperm_swarm_v0
from swarm.envs.conformance import SETTINGS
from swarm.envs.gymnasium import SpermSwarmVector

pytestmark = [
    pytest.mark.slow,
    pytest.mark.conformance,
    pytest.mark.filterwarnings("ignore"),  # theirs; `swarm check` turns ours into errors
]
SWIMMERS = 5
MODES = [mode.value for mode in AutoresetMode]


def came_of(use, *given):
    """What came of a use: None where it worked, else the type of the error."""
    try:
        use(*given)
    except Exception as error:
        return type(error)
    return None


class Face:
    """The environment in one setting, as PettingZoo's tests take a module."""

    def __init__(self, name):
        self.settings = {"n_swimmers": SWIMMERS, "life": 6.0} | SETTINGS[name]

    def __getattr__(self, kind):
        make = getattr(sperm_swarm_v0, kind)
        return lambda **further: make(**(self.settings | further))


@pytest.fixture(params=SETTINGS)
def face(request):
    return Face(request.param)


class TestPettingZoo:
    """What its suite asks of each of its own environments and their parameters."""

    def test_seeds_states_and_cycles(self, face):
        tests = importlib.import_module("pettingzoo.test")
        for kind in ("env", "raw_env"):
            tests.seed_test(getattr(face, kind), 100)
        tests.parallel_seed_test(face.parallel_env, 100)
        tests.state_test(face.env(), face.parallel_env())
        if not {"medium", "first_arrivals"} & face.settings.keys():  # 1000 cycles, and none may end early
            tests.max_cycles_test(face)

    def test_pictures(self, face, monkeypatch):
        monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
        pytest.importorskip("pygame")
        importlib.import_module("pettingzoo.test").render_test(face.env)

    def test_wrappers_unwrap_to_what_they_wrap(self, face, monkeypatch):
        monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
        pytest.importorskip("pygame")
        env = face.env(render_mode="human")
        base = env.unwrapped
        env.reset(seed=0)
        for wrapper in ("AssertOutOfBounds", "Base", "CaptureStdout", "OrderEnforcing"):
            env = getattr(wrappers, f"{wrapper}Wrapper")(env)
        env = wrappers.TerminateIllegalWrapper(env, 1.0)
        env = conversions.parallel_to_aec(conversions.aec_to_parallel(env))
        assert conversions.turn_based_aec_to_parallel(env).unwrapped is base

    def test_episodes_follow_one_another_and_copies_do_the_same(self, face):
        env = wrappers.MultiEpisodeParallelEnv(face.parallel_env(), num_episodes=3)
        twin = pickle.loads(pickle.dumps(face.env()))
        original = face.env()
        for each in (env, original, twin):
            each.reset(seed=42)
        steps, chosen = 0, original.action_space("swimmer_0")
        while env.agents:
            env.step({agent: chosen.sample() for agent in env.agents})
            steps += 1
        assert steps > 6
        for agent, other in zip(original.agent_iter(40), twin.agent_iter(40), strict=True):
            observation, *further, _ = original.last()
            expected, *others, _ = twin.last()
            np.testing.assert_array_equal(observation, expected)
            assert (agent, further) == (other, others)
            action = chosen.sample()
            for each in (original, twin):
                each.step(None if any(further[1:]) else action)


class Wrapped:
    """Gymnasium's vector wrappers around vector environments of ours and of its own."""

    ways = {
        "ArrayConversion": lambda env: vector.ArrayConversion(env, np, np),
        "ClipReward": lambda env: vector.ClipReward(env, -1, 1),
        "DtypeObservation": lambda env: vector.DtypeObservation(env, np.float64),
        "FilterObservation": lambda env: vector.FilterObservation(env, []),
        "RecordVideo": lambda env: vector.RecordVideo(env, "videos", video_length=3),
        "RescaleAction": lambda env: vector.RescaleAction(env, np.float32(-1), np.float32(1)),
        "RescaleObservation": lambda env: vector.RescaleObservation(env, np.float32(-1), np.float32(1)),
        "ReshapeObservation": lambda env: vector.ReshapeObservation(env, (2, -1)),
        "ResizeObservation": lambda env: vector.ResizeObservation(env, (2, 2)),
        "TransformAction": lambda env: vector.TransformAction(env, lambda action: 1 - action),
        "TransformObservation": lambda env: vector.TransformObservation(env, lambda seen: seen / 2),
        "TransformReward": lambda env: vector.TransformReward(env, lambda reward: reward / 2),
        "VectorizeTransformAction": lambda env: vector.VectorizeTransformAction(
            env, single.TransformAction, func=lambda action: 1 - action, action_space=env.single_action_space
        ),
        "VectorizeTransformObservation": lambda env: vector.VectorizeTransformObservation(
            env, single.TransformObservation, func=lambda seen: seen, observation_space=None
        ),
        "VectorizeTransformReward": lambda env: vector.VectorizeTransformReward(
            env, single.TransformReward, func=lambda reward: reward / 2
        ),
    }
    names = sorted(set(vector.__all__))

    @staticmethod
    def use(make, name, mode):
        """A few lives under a wrapper."""
        drawn = name in ("RecordVideo", "HumanRendering")
        env = make(mode, "rgb_array" if drawn else None)
        env = Wrapped.ways.get(name, getattr(vector, name))(env)
        env.reset(seed=0)
        for _ in range(20):
            action = np.ones(env.num_envs, np.int64)
            if name == "NumpyToTorch":
                action = importlib.import_module("torch").from_numpy(action)
            *_, terminated, truncated, _ = env.step(action)
            over = np.asarray(terminated) | np.asarray(truncated)
            if mode == "Disabled" and over.any():
                env.reset(options={"reset_mask": over})
        env.close()

    @staticmethod
    def theirs(mode, render_mode):
        given = {"vectorization_mode": "sync", "vector_kwargs": {"autoreset_mode": AutoresetMode(mode)}}
        return gymnasium.make_vec("CartPole-v1", 3, render_mode=render_mode, max_episode_steps=8, **given)


@pytest.fixture
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.mark.slow
@pytest.mark.usefixtures("_elsewhere")
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", Wrapped.names)
def test_a_vector_wrapper_works_where_it_works_with_gymnasium_s_own(name, mode):
    if (error := came_of(Wrapped.use, Wrapped.theirs, name, mode)) is not None:
        pytest.skip(f"{name}, {mode}: {error.__name__} with Gymnasium's CartPole, too")
    settings = SETTINGS.items() if name not in ("RecordVideo", "HumanRendering") else [("", {})]
    for setting, parameters in settings:

        def ours(mode, render_mode, parameters=parameters):
            given = {"life": 4.0} | parameters
            return SpermSwarmVector(3, autoreset_mode=mode, render_mode=render_mode, **given)

        together = mode == "Disabled" and "first_arrivals" in parameters  # no reset cell by cell
        assert together or came_of(Wrapped.use, ours, name, mode) is None, setting


@pytest.mark.usefixtures("_elsewhere")
def test_the_default_mode_is_that_with_which_most_wrappers_work():
    def make(mode, render_mode):
        return SpermSwarmVector(3, life=4.0, autoreset_mode=mode, render_mode=render_mode)

    def working(mode):
        return {name for name in Wrapped.names if came_of(Wrapped.use, make, name, mode) is None}

    most, same, disabled = (working(mode) for mode in ("NextStep", "SameStep", "Disabled"))
    assert SpermSwarmVector(1).autoreset_mode is AutoresetMode.NEXT_STEP
    assert most >= same | disabled
    assert len(most - same) >= 7
    assert "NormalizeObservation" in most - disabled


SUPERSUIT = {
    "action_lambda_v1": (lambda action, space: action, lambda space: space),
    "agent_indicator_v0": (),
    "black_death_v3": (),
    "clip_actions_v0": (),
    "clip_reward_v0": (),
    "color_reduction_v0": (),
    "delay_observations_v0": (3,),
    "dtype_v0": (np.float64,),
    "flatten_v0": (),
    "frame_skip_v0": (3,),
    "frame_stack_v1": (),
    "frame_stack_v2": (),
    "max_observation_v0": (3,),
    "nan_noop_v0": (0,),
    "nan_random_v0": (),
    "nan_zeros_v0": (),
    "normalize_obs_v0": (),
    "observation_lambda_v0": (lambda seen, space: seen / 2, lambda space: space),
    "pad_action_space_v0": (),
    "pad_observations_v0": (),
    "reshape_v0": (),
    "resize_v1": (2, 2),
    "reward_lambda_v0": (lambda reward: reward / 10,),
    "scale_actions_v0": (1.0,),
    "sticky_actions_v0": (0.5,),
}
# It adds numbers up to the largest bound and says that they are within the smallest: right only for bounds
# that are all equal, as after `normalize_obs_v0`, or infinite.
WRONG_ELSEWHERE = {("agent_indicator_v0", "env")}


def under_supersuit(make, name, kind):
    """Its wrapper under PettingZoo's test, and together with others as one vector environment."""
    supersuit, tests = importlib.import_module("supersuit"), importlib.import_module("pettingzoo.test")
    env = make()
    if (name, kind) in WRONG_ELSEWHERE:
        env = supersuit.normalize_obs_v0(env)
    given = SUPERSUIT[name]
    if name == "reshape_v0":
        given = ((*env.observation_space(env.possible_agents[0]).shape, 1),)
    env = getattr(supersuit, name)(env, *given)
    (tests.api_test if kind == "env" else tests.parallel_api_test)(env, num_cycles=40)
    if kind == "parallel_env":  # lives of unequal length as one vector environment
        env = make()
        env = env if name == "black_death_v3" else getattr(supersuit, name)(env, *given)
        env = supersuit.pettingzoo_env_to_vec_env_v1(supersuit.black_death_v3(env))
        env = supersuit.concat_vec_envs_v1(env, 2, num_cpus=0, base_class="gymnasium")
        env.reset(seed=0)
        for _ in range(40):
            env.step(np.stack([env.action_space.sample() for _ in range(env.num_envs)]))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["env", "parallel_env"])
@pytest.mark.parametrize("name", SUPERSUIT)
def test_a_wrapper_works_where_it_works_with_a_peer(face, name, kind):
    pytest.importorskip("supersuit")
    spread = pytest.importorskip("mpe2.simple_spread_v3")
    ours = came_of(under_supersuit, getattr(face, kind), name, kind)
    if ours is not None:
        assert came_of(under_supersuit, getattr(spread, kind), name, kind) is ours
        pytest.skip(f"{name}, {kind}: {ours.__name__} with MPE2, too")


class TestStableBaselines3:
    def test_it_learns_from_lives_of_unequal_length(self, face):
        sb3, supersuit = pytest.importorskip("stable_baselines3"), pytest.importorskip("supersuit")
        env = supersuit.pettingzoo_env_to_vec_env_v1(supersuit.black_death_v3(face.parallel_env()))
        env = supersuit.concat_vec_envs_v1(env, 2, num_cpus=0, base_class="stable_baselines3")
        sb3.PPO("MlpPolicy", env, n_steps=16, batch_size=32, n_epochs=1, device="cpu").learn(400)

    def test_its_algorithms_take_the_name(self):
        sb3 = pytest.importorskip("stable_baselines3")
        name = "swarm:chemoswarm/SpermSwarm-v0"
        sb3.PPO("MlpPolicy", name, n_steps=16, batch_size=16, n_epochs=1, device="cpu").learn(20)

    def test_it_learns_by_name_and_in_one_shared_world(self, face):
        sb3 = pytest.importorskip("stable_baselines3")
        from stable_baselines3.common.env_util import make_vec_env
        from stable_baselines3.common.evaluation import evaluate_policy
        from stable_baselines3.common.vec_env import VecMonitor

        from swarm.envs.stable_baselines3 import SpermSwarmVecEnv

        name, settings = "swarm:chemoswarm/SpermSwarm-v0", dict(face.settings)
        cells = VecMonitor(SpermSwarmVecEnv(**settings))
        del settings["n_swimmers"]
        if "first_arrivals" in settings:
            settings["first_arrivals"] = 1
        small = {"n_steps": 16, "batch_size": 16, "n_epochs": 1, "device": "cpu", "seed": 0}
        for env in (cells, make_vec_env(name, n_envs=2, env_kwargs=settings)):
            model = sb3.PPO("MlpPolicy", env, **small).learn(100)
            assert np.isfinite(evaluate_policy(model, env, n_eval_episodes=4)).all()
