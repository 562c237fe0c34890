"""Three dimensions on every face: the same lives, states of quaternions, and errors that change nothing."""

import gymnasium
import numpy as np
import pytest

import swarm
from tests.envs.side_by_side import side_by_side

torch = pytest.importorskip("torch")

SPACE = {"torsions": (7.7, 5.7), "curvatures": (5.5, 7.5), "speed": 2.0, "life": 1.0}
EGG = {"field": "radial", "start_box": ((1.2, 1.6), (-0.2, 0.2), (-0.2, 0.2)), "life": 2.0}
CELLS = 3


def posed(cells=CELLS):
    """Places and unit quaternions."""
    drawn = np.random.default_rng(4).standard_normal((cells, 7))
    return {"position": drawn[:, :3], "heading": drawn[:, 3:] / np.linalg.norm(drawn[:, 3:], axis=1)[:, None]}


@pytest.mark.parametrize("options", [{}, EGG, {"n_records": 2, "interval_rule": "exact"}], ids=str)
def test_all_faces_live_the_same_lives(options):
    actions = [np.random.default_rng(decision).integers(2, size=CELLS) for decision in range(4)]
    path = []
    for parallel in side_by_side(CELLS, SPACE | options, actions):
        path.append(parallel.state())
        assert path[-1].shape == (CELLS, 7)
    steps = np.linalg.norm(np.diff(np.array(path)[..., :3], axis=0), axis=-1)
    assert (steps <= 2.0 * parallel.world.intervals[0] + 1e-12).all()
    assert steps.min() > 0.05
    np.testing.assert_allclose(np.linalg.norm(np.array(path)[..., 3:], axis=-1), 1)


def test_lives_begin_at_the_poses_that_are_given():
    parallel, single = swarm.parallel_env(CELLS, **SPACE), gymnasium.make("chemoswarm/SpermSwarm-v0", **SPACE)
    given = posed()
    parallel.reset(seed=1, options=given)
    np.testing.assert_allclose(parallel.state(), np.hstack(list(given.values())), rtol=1e-12)
    single.reset(seed=1, options={name: values[:1] for name, values in given.items()})
    np.testing.assert_allclose(single.unwrapped.state(), parallel.state()[:1], rtol=1e-12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"position": np.zeros((CELLS, 2))},
            r"options\['position'\] must be .* \(3, 3\), got shape \(3, 2\)",
        ),
        ({"heading": np.zeros(CELLS)}, r"options\['heading'\] must be .* \(3, 4\), got shape \(3,\)"),
        ({"heading": np.full((CELLS, 4), 0.6)}, r"heading must be a unit quaternion .*, got 0.* for cell 0"),
        ({"heading": np.zeros((CELLS, 4))}, r"heading must be a unit quaternion .*, got 0.* for cell 0"),
    ],
)
def test_poses_of_other_kinds_are_refused_and_nothing_changes(options, message):
    env = swarm.parallel_env(CELLS, **SPACE)
    env.reset(seed=0)
    env.step(dict.fromkeys(env.agents, 1))
    before = env.state()
    with pytest.raises(ValueError, match=message):
        env.reset(seed=1, options=options)
    np.testing.assert_array_equal(env.state(), before)


def test_stable_baselines3_takes_it():
    pytest.importorskip("stable_baselines3", exc_type=ImportError)
    from swarm.envs.stable_baselines3 import SpermSwarmVecEnv

    env = SpermSwarmVecEnv(CELLS, **SPACE)
    twin = swarm.SpermSwarmVector(CELLS, autoreset_mode="SameStep", **SPACE)
    env.seed(7)
    np.testing.assert_array_equal(env.reset(), twin.reset(seed=7)[0])
    for _ in range(15):  # beyond an end
        np.testing.assert_array_equal(env.step(np.ones(CELLS, int))[0], twin.step(np.ones(CELLS, int))[0])


@pytest.mark.parametrize("options", [{}, EGG], ids=["", "egg"])
def test_a_swarm_in_space_has_a_picture(options):
    env = swarm.parallel_env(CELLS, render_mode="rgb_array", **SPACE | options)
    env.reset(seed=0)
    env.step(dict.fromkeys(env.agents, 1))
    assert env.render().shape == (720, 960, 3)
