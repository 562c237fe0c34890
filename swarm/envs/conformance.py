"""Every check of an interface that another library offers, and our own of seeds, with warnings as errors."""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.util
import io
import os
import random
import warnings
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest import mock

import gymnasium
import numpy as np
import pettingzoo
from gymnasium.utils import env_checker, passive_env_checker
from gymnasium.wrappers import vector as wrappers

from swarm.envs import pettingzoo as face
from swarm.envs.gymnasium import SpermSwarmVector

# Warnings that a dependency forces on everyone: the start of the message, and whose it is.
EXEMPT = (
    "The old environment creation API has been deprecated",  # pettingzoo.test imports a game by its old name
    "The state contains negative numbers and is in the shape of a graphical",  # PettingZoo on states (N, 4)
    ".* recommend .* a symmetric and normalized",  # Gymnasium and Stable-Baselines3, of curvatures too
    "PettingZoo in TorchRL is tested using version == 1.24.3",  # PettingZooWrapper on any other version
    "Creating .* which inherits from WeightUpdaterBase is deprecated",  # TorchRL on a class of its own
)
SWIMMERS = 6
Settings = dict[str, Any]
SETTINGS: dict[str, Settings] = {
    "linear field": {},
    "radial field, varying speed": {"field": "radial", "varying_speed": True, "start_box": ((1, 4), (1, 4))},
    "Taylor–Green, flow sensed": {"flow": "taylor_green", "sense_flow": True, "dtype": "float32"},
    "noise": {"concentration_noise": 0.1, "curvature_noise": 0.1, "rotational_diffusion": 0.01},
    "a medium, contact": {
        "medium": {"uptake": 0.05, "shape": (64, 64), "substeps": 2},
        "interactions": ["contact"],
        "spread": {"speed": 0.1},
    },
    "a race": {"field": "radial", "first_arrivals": 2, "start_box": ((-2, 2), (-2, 2)), "binding_rate": 10.0},
    "many curvatures": {"curvatures": tuple(np.linspace(3, 5, 9)), "n_records": 2, "interval_rule": "exact"},
    "continuous, few decisions": {"action": "continuous", "curvature_range": (-1.0, 5.0), "max_cycles": 5},
    "three dimensions": {"torsions": (7.7, 5.7), "curvatures": (5.5, 7.5), "speed": 2.0, "life": 3.0},
}


class Check(NamedTuple):
    """What came of one check."""

    name: str
    passed: bool | None  # None: skipped
    detail: str  # the error or why it was skipped; empty where it passed


class _Skipped(Exception):
    """Says why a check is not possible here."""


def run_checks() -> Iterator[Check]:
    """Run all checks, one by one; what a missing library makes impossible is skipped."""
    return (run_check(name, check) for name, check in checks().items())


def checks() -> dict[str, Callable[[], object]]:
    """All checks by name; each is a call that raises where something is wrong."""
    part = functools.partial
    return {
        f"{name}, {setting}": part(check, settings)
        for setting, settings in SETTINGS.items()
        for name, check in {
            "PettingZoo parallel_api_test": _parallel_api,
            "PettingZoo api_test": _aec_api,
            "chemoswarm seed test": lambda settings: check_seeds(part(_parallel, **settings)),
        }.items()
    } | {
        "PettingZoo max_cycles_test": part(_theirs, "max_cycles_test", face),
        "PettingZoo parallel_seed_test": part(_theirs, "parallel_seed_test", _parallel),
        "PettingZoo seed_test": part(_theirs, "seed_test", part(face.env, SWIMMERS)),
        "PettingZoo state_test": _states,
        "PettingZoo render_test": _pictures,
        "PettingZoo make": _registered,
        "Gymnasium spaces": part(_in_all, _spaces),
        "Gymnasium reset and seeds": part(_in_all, _vector_resets),
        "Gymnasium returned data": _vector_returns,
        "Gymnasium wrappers, SameStep": part(_in_all, part(_vector_wrappers, "SameStep")),
        "Gymnasium wrappers, NextStep": part(_in_all, part(_vector_wrappers, "NextStep")),
        "Gymnasium make_vec": _vector_registered,
        "Gymnasium check_env": part(_in_all, _single),
        "Gymnasium SyncVectorEnv": part(_in_all, _same_as_synchronous),
        "SuperSuit black_death": part(_in_all, _black_death),
        "Stable-Baselines3 check_env": part(_in_all, _stable_baselines3),
        "TorchRL check_env_specs": part(_in_all, _torchrl_specs),
        "TorchRL PettingZooWrapper": _torchrl_wrapper,
    }


def run_check(name: str, check: Callable[[], object]) -> Check:
    """One check, its output kept quiet and its warnings turned into errors but for those in `EXEMPT`."""
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("error")
        for message in EXEMPT:
            warnings.filterwarnings("ignore", message=message)
        try:
            check()
        except _Skipped as reason:
            return Check(name, None, str(reason))
        except Exception as error:  # whatever is wrong is the result
            return Check(name, False, f"{type(error).__name__}: {error}")
    return Check(name, True, "")


def _parallel(**settings: Any) -> Any:
    return face.parallel_env(SWIMMERS, **({"life": 12.0} | settings))


def _vector(**settings: Any) -> Any:
    return SpermSwarmVector(**({"n_swimmers": SWIMMERS, "life": 12.0} | settings))


def _alone(settings: Settings) -> Any:
    own: Settings = {"life": 4.0} | settings | dict.fromkeys({"first_arrivals"} & settings.keys(), 1)
    return gymnasium.make("chemoswarm/SpermSwarm-v0", **own).unwrapped


def _in_all(check: Callable[[Settings], object]) -> None:
    for settings in SETTINGS.values():
        check(settings)


# --- PettingZoo ---


def _theirs(test: str, *given: Any, **options: Any) -> None:
    """One of PettingZoo's own tests, which are imported when they are needed."""
    getattr(importlib.import_module("pettingzoo.test"), test)(*given, **options)


def _parallel_api(settings: Settings) -> None:
    _theirs("parallel_api_test", _parallel(**settings), num_cycles=100)


def _aec_api(settings: Settings) -> None:
    for make in (face.env, face.raw_env):
        _theirs("api_test", make(SWIMMERS, **({"life": 12.0} | settings)), num_cycles=60)


def _states() -> None:
    for dtype in ("float64", "float32"):
        _theirs("state_test", face.env(SWIMMERS, dtype=dtype), face.parallel_env(dtype=dtype))


def _pictures() -> None:
    _need("pygame", "the window")
    with mock.patch.dict(os.environ, SDL_VIDEODRIVER="dummy"):  # a display that nobody sees
        _theirs("render_test", functools.partial(face.env, SWIMMERS))


def _registered() -> None:
    _need("pettingzoo.env_registry", "making by name")  # from PettingZoo 1.27 on
    for kind, base in (("parallel", pettingzoo.ParallelEnv), ("aec", pettingzoo.AECEnv)):
        env = pettingzoo.make(kind, "chemoswarm/sperm_swarm_v0", n_swimmers=2, max_cycles=3)
        env.reset(seed=0)
        assert isinstance(env, base), f"{kind} must make a {base.__name__}, got {env!r}"
        assert env.possible_agents == ["swimmer_0", "swimmer_1"]


def check_seeds(make: Callable[[], Any], steps: int = 1000) -> None:
    """Seeds decide everything: 1000 steps and a reset are bit-equal, and no global generator is touched.

    Raises AssertionError where two environments with one seed differ in anything they return, where seeds 0
    and 1 do not differ, or where the states of `random` or `numpy.random` have changed.
    """
    before = _global_generators()
    first, second, other = (_played(make(), seed, steps) for seed in (0, 0, 1))
    assert first == second, "two environments with seed 0 must do the same"
    assert first != other, "seeds 0 and 1 must not do the same"
    assert _global_generators() == before, "global generators must stay as they are"


def _global_generators() -> tuple[Any, ...]:
    return random.getstate(), _exact(np.random.get_state(legacy=False))  # noqa: NPY002


def _played(env: Any, seed: int, steps: int) -> list[tuple[Any, ...]]:
    """All that an environment returns while actions from the seed are played, episode after episode."""
    actions = env.action_space(env.possible_agents[0])
    actions.seed(seed)
    returned = [_exact(env.reset(seed=seed))]
    for _ in range(steps):
        if not env.agents:
            returned.append(_exact(env.reset()))
        returned.append(_exact(env.step({agent: actions.sample() for agent in env.agents})))
        returned.append(_exact([env.state()]))
    returned.append(_exact(env.reset()))
    return returned


def _exact(parts: Any) -> tuple[Any, ...]:
    """Nested dictionaries and arrays as something that is equal only where all bits are."""
    if isinstance(parts, dict):
        return tuple((key, _exact(part)) for key, part in parts.items())
    if isinstance(parts, (tuple, list)):
        return tuple(_exact(part) for part in parts)
    return (type(parts), parts.tobytes() if isinstance(parts, np.ndarray) else parts)


# --- Gymnasium ---


def _spaces(settings: Settings) -> None:
    env = _vector(**settings)
    passive_env_checker.check_observation_space(env.single_observation_space)
    passive_env_checker.check_action_space(env.single_action_space)
    observation, _ = env.reset(seed=0)
    for _ in range(100):
        assert observation in env.observation_space, "observations must lie in their space"
        observation = env.step(env.action_space.sample())[0]


def _vector_resets(settings: Settings) -> None:
    env = _vector(**settings)
    env.spec = SimpleNamespace(nondeterministic=False)  # so that the checks compare two runs
    env_checker.check_seed_deprecation(env)
    env_checker.check_reset_return_info_deprecation(env)
    env_checker.check_reset_return_type(env)
    env_checker.check_reset_seed_determinism(env)
    env_checker.check_reset_options(env)


def _vector_wrappers(mode: str, settings: Settings) -> None:
    """Gymnasium's own wrappers count every life once, and find its last observation."""
    counting = wrappers.RecordEpisodeStatistics(_vector(autoreset_mode=mode, **settings))
    env = wrappers.DictInfoToList(counting)
    _, infos = env.reset(seed=0)
    lives = 0
    for _ in range(100):
        *_, terminated, truncated, infos = env.step(env.action_space.sample())
        over = terminated | truncated
        lives += int(over.sum())
        assert [("episode" in info) for info in infos] == over.tolist(), "every end is an episode"
        assert all(set(info) >= {"gain"} for info in infos), "info must hold gain"
        if mode == "SameStep":
            assert [("final_obs" in info) for info in infos] == over.tolist(), "every end is observed"
    assert lives == counting.episode_count > 0, "lives must be counted once"


def _vector_returns() -> None:
    if not hasattr(env_checker, "check_returned_data_not_reused"):
        raise _Skipped("Gymnasium has this check from 1.4 on")
    env_checker.check_returned_data_not_reused(_vector(n_swimmers=1))  # which knows of one life only


def _vector_registered() -> None:
    env = gymnasium.make_vec("chemoswarm/SpermSwarm-v0", num_envs=3, field="radial")
    assert len(env.reset(seed=0)[0]) == env.num_envs == 3


def _single(settings: Settings) -> None:
    env_checker.check_env(_alone(settings), skip_render_check=True)


def _same_as_synchronous(settings: Settings) -> None:
    """Cells with seeds of their own live as single environments in Gymnasium's own vector environment do."""
    if {"medium", "first_arrivals"} & settings.keys():
        return
    made: Settings = {"num_envs": 3, "life": 3.0} | settings
    make: Any = functools.partial(gymnasium.make_vec, "chemoswarm/SpermSwarm-v0", **made)
    theirs, ours = (make(vectorization_mode=mode) for mode in ("sync", "vector_entry_point"))
    assert ours.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"]
    for seed in ([4, 9, 2], None, [None, 7, None]):
        assert np.array_equal(theirs.reset(seed=seed)[0], ours.reset(seed=seed)[0]), f"seed {seed}"
        for _ in range(25):
            action = ours.action_space.sample()
            parts = zip(theirs.step(action)[:4], ours.step(action)[:4], strict=True)
            assert all(np.array_equal(*pair) for pair in parts), "vector environments must agree"


def _black_death(settings: Settings) -> None:
    """Lives of unequal length as a vector environment, to which finished cells are zeros."""
    _need("supersuit", "black_death_v3")
    supersuit = importlib.import_module("supersuit")
    env = supersuit.pettingzoo_env_to_vec_env_v1(supersuit.black_death_v3(_parallel(**settings)))
    env.reset(seed=0)
    action = [env.action_space.sample()] * SWIMMERS
    over = [np.all(env.step(np.array(action))[2]) for _ in range(60)]
    assert any(over), "all lives must end"


def _stable_baselines3(settings: Settings) -> None:
    _need("stable_baselines3", "VecEnv")
    from stable_baselines3.common.env_checker import check_env

    check_env(_alone(settings), skip_render_check=True)


# --- TorchRL ---


def _torchrl_specs(settings: Settings) -> None:
    _need("torchrl", "the TorchRL face")
    from torchrl.envs import check_env_specs

    from swarm.envs.torchrl import SwarmEnv

    small: Settings = {"n_swimmers": 3, "life": 4.0, "seed": 0}
    check_env_specs(SwarmEnv(n_worlds=2, **(small | settings)))


def _torchrl_wrapper() -> None:
    _need("torchrl", "PettingZooWrapper")
    from torchrl.envs import PettingZooWrapper, check_env_specs

    env = PettingZooWrapper(_parallel(life=4.0), use_mask=True, done_on_any=False)
    check_env_specs(env)
    assert env.rollout(100).shape[-1] > 1, "a rollout must last"


# --- helpers ---


def _need(module: str, purpose: str) -> None:
    if importlib.util.find_spec(module) is None:
        raise _Skipped(f"{purpose} needs {module}, which is not installed")
