"""Three dimensions on every face: the same lives, states of quaternions, and errors that change nothing."""

import gymnasium
import numpy as np
import pytest

import swarm

SPACE = {"torsions": (7.7, 5.7), "curvatures": (5.5, 7.5), "speed": 2.0, "life": 1.0}
EGG = {"field": "radial", "start_box": ((1.2, 1.6), (-0.2, 0.2), (-0.2, 0.2))}
CELLS = 3


def test_lives_begin_at_the_poses_that_are_given():
    parallel, single = swarm.parallel_env(CELLS, **SPACE), gymnasium.make("chemoswarm/SpermSwarm-v0", **SPACE)
    drawn = np.random.default_rng(4).standard_normal((CELLS, 7))
    turns = drawn[:, 3:] / np.linalg.norm(drawn[:, 3:], axis=1)[:, None]
    given = {"position": drawn[:, :3], "heading": turns}
    parallel.reset(seed=1, options=given)
    np.testing.assert_allclose(parallel.state(), np.hstack(list(given.values())), rtol=1e-12)
    single.reset(seed=1, options={name: values[:1] for name, values in given.items()})
    np.testing.assert_allclose(single.unwrapped.state(), parallel.state()[:1], rtol=1e-12)


@pytest.mark.parametrize("options", [{}, EGG], ids=["", "egg"])
def test_a_swarm_in_space_has_a_picture(options):
    env = swarm.parallel_env(CELLS, render_mode="rgb_array", **SPACE | options)
    env.reset(seed=0)
    env.step(dict.fromkeys(env.agents, 1))
    assert env.render().shape == (720, 960, 3)
