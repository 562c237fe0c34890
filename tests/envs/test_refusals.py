"""What is wrong is told in one line by every face, before anything has changed."""

import pickle

import gymnasium
import numpy as np
import pytest
import torch
from tensordict import TensorDict

import swarm
from swarm.torchrl_env import SwarmEnv

ALONE, MASK = "swarm:chemoswarm/SpermSwarm-v0", np.array([True, False, False])
STEERED = {"action": "continuous", "curvature_range": (-1.0, 5.0)}
SPACE = {"torsions": (7.7, 5.7), "curvatures": (5.5, 7.5), "speed": 2.0}
RACE = {"field": "radial", "first_arrivals": 2, "start_box": ((-2.5, 2.5), (-2.5, 2.5))}


def parallel(**settings):
    env = swarm.parallel_env(3, **settings)
    env.reset(seed=0)
    env.step(dict.fromkeys(env.agents, 4 if env.world.is_continuous else 0))
    return env


def vector(**settings):
    env = swarm.SpermSwarmVector(3, **settings)
    env.reset(seed=0)
    return env


def single(**settings):
    env = gymnasium.make(ALONE, **settings).unwrapped
    env.reset(seed=0)
    return env


def many(**settings):
    env = SwarmEnv(1, n_swimmers=3, seed=0, **settings)
    env.reset()
    return env


def lives(env):
    """What an arena's cells are, as bytes."""
    arena = env.arena
    return pickle.dumps((env.state(), arena.state, arena.episode, arena.decision, arena.seeds))


def held(env):
    """All that an environment is, as bytes."""
    if isinstance(env, SwarmEnv):
        return pickle.dumps([each.numpy() for each in env.state_dict_of_env().values()])
    return pickle.dumps((env.__getstate__(), env.state()))


def together(env, **wrong):
    env.step(dict.fromkeys(env.agents, 4 if env.world.is_continuous else 0) | wrong)


def tensors(env, action):
    env.step(TensorDict({"swimmers": {"action": torch.as_tensor(action)[None]}}, batch_size=1))


WHOLE = "must be a whole number from 0 to 1, got "
CURVED = "must be a curvature from -1 to 5, got "
ACTIONS = [
    (parallel, {}, {"swimmer_1": 2}, ValueError, f"the action of swimmer_1 {WHOLE}2"),
    (parallel, {}, {"swimmer_1": -1}, ValueError, f"swimmer_1 {WHOLE}-1"),
    (parallel, {}, {"swimmer_1": 2**70}, ValueError, f"swimmer_1 {WHOLE}{2**70}"),
    (parallel, {}, {"swimmer_2": 256}, ValueError, f"swimmer_2 {WHOLE}256"),
    (parallel, {}, {"swimmer_1": 1.0}, TypeError, rf"swimmer_1 {WHOLE}1\.0"),
    (parallel, {}, {"swimmer_0": float("nan")}, TypeError, f"swimmer_0 {WHOLE}nan"),
    (parallel, {}, {"swimmer_0": np.array([1])}, TypeError, rf"swimmer_0 {WHOLE}array\(\[1\]\)"),
    (parallel, {}, {"swimmer_0": None}, TypeError, f"swimmer_0 {WHOLE}None"),
    (parallel, {}, {"swimmer_3": 0}, ValueError, "for swimmer_0 to swimmer_2, got one for 'swimmer_3'"),
    (parallel, STEERED, {"swimmer_1": 5.1}, ValueError, f"swimmer_1 {CURVED}5.1"),
    (parallel, STEERED, {"swimmer_1": float("nan")}, ValueError, f"{CURVED}nan"),
    (parallel, STEERED, {"swimmer_1": None}, TypeError, f"{CURVED}None"),
    (parallel, STEERED, {"swimmer_1": "3"}, TypeError, f"{CURVED}'3'"),
    (parallel, STEERED, {"swimmer_1": np.zeros(2)}, TypeError, f"{CURVED}array"),
    (vector, {}, [0, 2, 0], ValueError, r"whole numbers from 0 to 1 of shape \(3,\), got 2 for swimmer_1"),
    (vector, {}, [0, 0, -1], ValueError, "got -1 for swimmer_2"),
    (vector, {}, [0.0, 1.0, 0.0], TypeError, "got float64"),
    (vector, {}, [True, False, True], TypeError, "got bool"),
    (vector, {}, [0, 1], ValueError, r"got shape \(2,\)"),
    (vector, {}, [[0, 1, 0]], ValueError, r"got shape \(1, 3\)"),
    (vector, STEERED, [[4.0], [9.0], [4.0]], ValueError, "curvatures from -1 to 5 .*, got 9.0 for swimmer_1"),
    (vector, STEERED, [[4.0, 1.0]], ValueError, r"got shape \(1, 2\)"),
    (vector, STEERED, [True, False, True], TypeError, "curvatures from -1 to 5 .*, got bool"),
    *((single, {}, wrong, ValueError, f"action {WHOLE}{wrong}") for wrong in (2, -1)),
    *((single, {}, wrong, TypeError, f"action {WHOLE}") for wrong in (0.5, None, [0])),
    (many, {}, [0, 2, 0], ValueError, r"whole numbers from 0 to 1 of shape \(1, 3\), got 2 for swimmer_1"),
    (many, {}, [0, 0, -1], ValueError, "got -1 for swimmer_2"),
    (many, {}, [0.0, 0.0, 0.0], TypeError, "got torch.float32"),
    (many, STEERED, [[1], [1], [1]], TypeError, r"-1 to 5 of shape \(1, 3\), got torch.int64"),
    (many, STEERED, [[6.0], [1.0], [1.0]], ValueError, "got 6.0 for swimmer_0"),
]


@pytest.mark.parametrize(("make", "settings", "action", "error", "message"), ACTIONS)
def test_what_is_no_action_is_told_and_changes_nothing(make, settings, action, error, message):
    env = make(**settings)
    before = held(env)
    step = tensors if make is many else lambda env, action: env.step(action)
    with pytest.raises(error, match=message):
        together(env, **action) if make is parallel else step(env, action)
    assert held(env) == before


@pytest.mark.parametrize(
    ("actions", "error", "message"),
    [
        ({}, ValueError, "got none for swimmer_0, swimmer_1, swimmer_2"),
        ({"swimmer_0": 0, "swimmer_2": 1}, ValueError, "for every agent in `agents`, got none for swimmer_1"),
        ([0, 1, 0], TypeError, r"actions must be a dictionary from agents to actions, got \[0, 1, 0\]"),
    ],
)
def test_actions_for_others_than_the_agents_are_told_and_change_nothing(actions, error, message):
    env = parallel()
    before = held(env)
    with pytest.raises(error, match=message):
        env.step(actions)
    assert held(env) == before


SHAPE = r"must be finite numbers of shape \("
BOOL = r"\['reset_mask'\] must be a bool array of shape \(3,\)"
OPTIONS = [
    (parallel, {}, {"position": np.zeros((2, 2))}, ValueError, rf"{SHAPE}3, 2\), got shape \(2, 2\)"),
    (parallel, {}, {"heading": np.zeros((3, 1))}, ValueError, rf"{SHAPE}3,\), got shape \(3, 1\)"),
    (parallel, {}, {"heading": [0.0, np.nan, 1.0]}, ValueError, r"\['heading'\] .*, got nan for swimmer_1"),
    (parallel, {}, {"position": "here"}, TypeError, r"\['position'\] must be .*, got 'here'"),
    (parallel, {}, {"position": [[1, 2], [3]]}, TypeError, rf"\['position'\] {SHAPE}3, 2\)"),
    (parallel, {}, {"heading": [True, False, True]}, TypeError, r"\['heading'\] must be finite numbers"),
    (parallel, SPACE, {"position": np.zeros((3, 2))}, ValueError, rf"{SHAPE}3, 3\), got shape \(3, 2\)"),
    (parallel, SPACE, {"heading": np.zeros(3)}, ValueError, rf"{SHAPE}3, 4\), got shape \(3,\)"),
    (parallel, SPACE, {"heading": np.full((3, 4), 0.6)}, ValueError, "unit quaternion .* for cell 0"),
    (vector, {}, {"reset_mask": MASK.tolist()}, ValueError, BOOL),
    (vector, {}, {"reset_mask": np.ones(3, int)}, ValueError, BOOL),
    (vector, {}, {"reset_mask": np.ones(2, bool)}, ValueError, BOOL),
    (vector, {}, {"reset_mask": np.zeros(3, bool)}, ValueError, "must choose at least one cell"),
    (vector, {}, {"reset_mask": MASK, "heading": [np.nan] * 3}, ValueError, "got nan for swimmer_0"),
    (vector, RACE, {"reset_mask": MASK}, ValueError, "all cells where none can begin before .* 1 of 3"),
    (vector, {}, 3, TypeError, "options must be a dictionary or None, got 3"),
]


@pytest.mark.parametrize(("make", "settings", "options", "error", "message"), OPTIONS)
def test_wrong_options_are_told_and_change_nothing(make, settings, options, error, message):
    env = make(**settings)
    before = held(env)
    with pytest.raises(error, match=message):
        env.reset(options=options)
    assert held(env) == before


@pytest.mark.parametrize(
    ("make", "seed", "error", "message"),
    [
        (parallel, -1, ValueError, "seed must"),
        (parallel, 1.5, TypeError, "seed must"),
        (vector, [3, 4], ValueError, "seed must be one number or a list of 3, got 2"),
        (vector, np.arange(4), ValueError, "seed must be one number or a list of 3, got 4"),
        (vector, [1, 2, -1], ValueError, "seed must"),
        (vector, [1, 2, "a"], TypeError, "seed must"),
    ],
)
def test_a_wrong_seed_is_told_and_changes_nothing(make, seed, error, message):
    env = make()
    before = held(env)
    with pytest.raises(error, match=message):
        env.reset(seed=seed)
    with pytest.raises(ValueError, match=r"seed must be None with options\['reset_mask'\], got 1"):
        vector().reset(seed=1, options={"reset_mask": MASK})
    assert held(env) == before


@pytest.mark.parametrize(
    ("make", "wrong", "error", "message"),
    [
        (parallel, {"render_mode": "rgb"}, ValueError, "render_mode .*, got 'rgb'; did you mean 'rgb_array'"),
        (parallel, {"dtype": "float16"}, ValueError, "dtype .* float64, got 'float16'; did you mean"),
        (parallel, {"max_cycles": 0}, ValueError, "max_cycles must be a whole number of at least 1, got 0"),
        (parallel, {"field": "lineer"}, ValueError, "field must be one of .* did you mean 'linear'"),
        (vector, {"autoreset_mode": "samestep"}, ValueError, "autoreset_mode .* mean 'SameStep'"),
        (vector, {"n_record": 4}, TypeError, "parameter must be one of .* did you mean 'n_records'"),
        (vector, {"world": swarm.World(), "life": 3.0}, TypeError, r"given alone, got \['life'\] besides"),
        (vector, {"world": "linear"}, TypeError, "world must be a World, got 'linear'"),
        (single, {"n_record": 3}, TypeError, "mean 'n_records'.* keyword argument 'n_record'"),
        (swarm.parallel_env, {"n_swimmers": 0}, ValueError, "n_swimmers must be .* of at least 1, got 0"),
        (SwarmEnv, {"seed": 3, "seeds": [1, 2]}, ValueError, r"seed must be left out .* 3 beside \[1, 2\]"),
        (SwarmEnv, {"n_record": 4}, TypeError, "did you mean 'n_records'"),
        (SwarmEnv, {"n_worlds": 0}, ValueError, "n_worlds must be a whole number of at least 1, got 0"),
        (SwarmEnv, {"max_cycles": 0}, ValueError, "max_cycles"),
        (SwarmEnv, {"n_worlds": 3, "seeds": [1, 2]}, ValueError, "a multiple .*, got 3 worlds and 2 seeds"),
        (SwarmEnv, {"seeds": 3}, TypeError, "seeds must be whole numbers in a list, got 3"),
        (SwarmEnv, {"device": "gpu"}, ValueError, "that torch has here, got 'gpu': Expected one of"),
        (SwarmEnv, {"seed": -1}, ValueError, "seed must not be negative"),
    ],
)
def test_wrong_parameters_are_told(make, wrong, error, message):
    with pytest.raises(error, match=message):
        make(**wrong)


@pytest.mark.parametrize(
    "make", [swarm.parallel_env, swarm.SpermSwarmVector, lambda: gymnasium.make(ALONE).unwrapped, SwarmEnv]
)
def test_nothing_is_possible_before_the_first_reset(make):
    env = make()
    nothing = {} if make is swarm.parallel_env else [0] * 40
    calls = [lambda: env.step(nothing), env.render, lambda: env.state()]
    if make is SwarmEnv:
        calls = [lambda: env.advance(torch.zeros(1, 40, dtype=torch.int64)), env.render, env.gain]
    elif make is swarm.SpermSwarmVector:
        calls.append(lambda: env.reset(options={"reset_mask": np.ones(40, bool)}))
    for call in calls:
        with pytest.raises(RuntimeError, match=r"reset must be called first|reset\(\) must come first"):
            call()


@pytest.mark.parametrize("make", [vector, single])
def test_a_life_that_is_over_must_be_reset(make):
    env = make(life=0.1, **({"autoreset_mode": "Disabled"} if make is vector else {}))
    action = [0, 0, 0] if make is vector else np.int64(1)
    env.step(action)
    before = held(env)
    with pytest.raises(RuntimeError, match=r"step: the li[fv].* over; call reset"):
        env.step(action)
    assert held(env) == before


class Field:
    """A field that is not a number above a ceiling."""

    gradient_scale, ceiling = 1.0, np.inf

    def concentration(self, position):
        return np.where(position[..., 1] > self.ceiling, np.nan, position[..., 1])


def test_a_field_that_gives_nan_names_the_cell_and_changes_nothing():
    field = Field()
    env = swarm.parallel_env(3, field=field)
    env.reset(seed=0, options={"position": [(0.0, 0.0), (3.0, 4.99), (0.0, 0.0)], "heading": [np.pi / 2] * 3})
    field.ceiling = 5.0
    before = lives(env)
    where = r"finite .* got concentration nan for swimmer_1 at \(2\.\d+, 5\.\d+\)"
    with pytest.raises(ValueError, match=where):
        env.step(dict.fromkeys(env.agents, 0))
    assert lives(env) == before
    with pytest.raises(ValueError, match="for cell 2"):
        env.reset(options={"position": [(0.0, 0.0), (0.0, 0.0), (0.0, 7.0)]})
    assert lives(env) == before


def test_a_restart_that_fails_leaves_the_lives_as_they_were():
    env = swarm.SpermSwarmVector(2, field=Field(), life=0.1, autoreset_mode="SameStep")
    env.reset(seed=0, options={"position": np.full((2, 2), -50.0)})
    env.world.field.ceiling = -10.0
    before = lives(env)
    with pytest.raises(ValueError, match="finite"):  # the world goes on, but no next life can begin
        env.step([0, 0])
    assert lives(env) == before


def test_huge_numbers_that_are_finite_are_no_error():
    env = swarm.parallel_env(2)
    env.reset(seed=0, options={"position": np.full((2, 2), 1e200)})
    env.step(dict.fromkeys(env.agents, 0))
    assert np.isfinite(env.state()).all()


@pytest.mark.parametrize("make", [swarm.parallel_env, swarm.SpermSwarmVector, SwarmEnv])
def test_more_arrivals_than_cells_are_refused_when_a_face_is_made(make):
    with pytest.raises(ValueError, match=r"^first_arrivals must be at most the number of cells, 3, got 4$"):
        make(n_swimmers=3, **RACE | {"first_arrivals": 4})
