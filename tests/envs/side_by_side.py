"""Three faces of one world side by side."""

import numpy as np
import torch

import swarm
from swarm.torchrl_env import SwarmEnv


def side_by_side(cells, settings, actions):
    """Lives of the same seed on the PettingZoo, the Gymnasium and the TorchRL face, which are held to agree:
    yields the first at the start and after each of the `actions` (cells, ...).
    """
    parallel = swarm.parallel_env(cells, **settings)
    vector = swarm.SpermSwarmVector(cells, autoreset_mode="Disabled", **settings)
    torchrl = SwarmEnv(1, n_swimmers=cells, dtype="float64", return_state=True, **settings)
    parallel.reset(seed=5)
    vector.reset(seed=5)
    torchrl.set_seed(5)
    held = torchrl.reset()
    np.testing.assert_allclose(held["state"][0], parallel.state(), rtol=1e-6)
    yield parallel
    for chosen in actions:
        seen, reward, *_ = parallel.step({f"swimmer_{i}": each for i, each in enumerate(chosen)})
        others, earned, *_ = vector.step(chosen)
        held["swimmers", "action"] = torch.from_numpy(chosen)[None]
        held = torchrl.step(held)["next"]
        np.testing.assert_array_equal(np.stack(list(seen.values())), others)
        np.testing.assert_array_equal(np.array(list(reward.values())), earned)
        np.testing.assert_allclose(held["swimmers", "observation"][0], others, atol=1e-6)
        np.testing.assert_array_equal(parallel.state(), vector.state())
        np.testing.assert_allclose(held["state"][0], parallel.state(), rtol=1e-5, atol=1e-6)
        assert parallel.state() in parallel.state_space
        yield parallel
