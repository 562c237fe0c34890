"""Faces of NumPy and of TorchRL live the same lives of the same seed, in every kind of world."""

import gymnasium
import numpy as np
import pytest
import torch

import swarm
from swarm.envs.torchrl import GROUP, worlds
from swarm.physics.starts import NOISE_BLOCK
from swarm.torchrl_env import SwarmEnv

NOISE = {"concentration_noise": 0.1, "curvature_noise": 0.1, "rotational_diffusion": 0.01}
NEAR_EGG = {"field": "radial", "start_box": ((-1.6, 1.6), (-1.6, 1.6)), "life": 12.0}
EATING = {"medium": {"uptake": 0.05, "shape": (64, 64)}, "life": 2.0}
STEERED = {"action": "continuous", "curvature_range": (-1.0, 5.0), "life": 3.0}
SPACE = {"torsions": (7.7, 5.7), "curvatures": (5.5, 7.5), "speed": 2.0, "life": 1.0}
WORLDS = {
    "still water": {},
    "two records": {"n_records": 2},
    "vortices, felt": {"flow": "taylor_green", "sense_flow": True},
    "varying speed": {"varying_speed": True},
    "varying speed, exact intervals": {"varying_speed": True, "interval_rule": "exact"},
    "noise in vortices": NOISE | {"flow": "taylor_green", "varying_speed": True},
    "more than a block of noise": NOISE | {"life": 0.38 * (NOISE_BLOCK + 4), "n_swimmers": 2},
    "around an egg": NEAR_EGG,
    "three curvatures": {"curvatures": (3.0, 4.0, 5.0)},
    "one cycle": {"max_cycles": 1},
    "four cycles": {"life": 20.0, "max_cycles": 4},
    "bindings and spread": {"binding_rate": 10.0, "spread": {"speed": 0.1, "curvature": 0.1}},
    "a medium": EATING,
    "a medium, alone": EATING | {"n_swimmers": 1},
    "a crowd": {"interactions": ["contact", "dipole"], "life": 2.0, "start_box": ((0, 1), (0, 1))},
    "a race": NEAR_EGG | {"first_arrivals": 2},
    "a race, alone": NEAR_EGG | {"first_arrivals": 1, "n_swimmers": 1},
    "steered": STEERED,
    "steered in vortices": STEERED | {"flow": "taylor_green", "sense_flow": True},
    "steered to an egg": STEERED | {"field": "radial", "curvature_noise": 0.1},
    "space": SPACE,
    "space, an egg": SPACE | {"field": "radial", "start_box": ((1.2, 1.6), (-0.2, 0.2), (-0.2, 0.2))},
    "space, two records": SPACE | {"n_records": 2, "interval_rule": "exact"},
}  # fmt: skip


class Faces:
    """The faces of one world and, where cells are on their own, of its first cell alone."""

    def __init__(self, n_swimmers=6, life=6.0, **settings):
        settings["life"] = life
        self.cells = n_swimmers
        self.parallel = swarm.parallel_env(n_swimmers, **settings)
        self.vector = swarm.SpermSwarmVector(n_swimmers, autoreset_mode="Disabled", **settings)
        self.world = self.parallel.world
        apart = 1 if self.world.is_shared or n_swimmers == 1 else 2
        given = {"n_swimmers": n_swimmers // apart, "dtype": "float64", "return_state": True}
        self.torchrl = SwarmEnv(apart, seed=5, **given, **settings)
        self.single = None
        if n_swimmers == 1 or not self.world.is_shared:
            self.single = gymnasium.make("chemoswarm/SpermSwarm-v0", **settings).unwrapped

    def reset(self, seed):
        seen, infos = self.parallel.reset(seed=seed)
        self.held = self.torchrl.reset()
        self.hold("observation", np.stack(list(seen.values())), range(self.cells))
        rows, info = self.vector.reset(seed=seed)
        np.testing.assert_array_equal(np.stack(list(seen.values())), rows)
        for name, values in infos["swimmer_0"].items():
            assert values == info[name][0]
        if self.single is not None:
            observation, told = self.single.reset(seed=seed)
            np.testing.assert_array_equal(observation, rows[0])
            assert told == infos["swimmer_0"]

    def step(self, action):
        """One decision of all; returns who has arrived and whose life is over."""
        agents, over = self.parallel.agents, self.vector._done
        live = [self.parallel.agent_index(agent) for agent in agents]
        assert np.flatnonzero(~self.held[GROUP, "done"].flatten()).tolist() == live
        step = self.parallel.step(dict(zip(agents, action[live], strict=True)))
        self.held[GROUP, "action"] = torch.as_tensor(action).reshape(
            *self.torchrl.batch_size, -1, *action.shape[1:]
        )
        self.held = self.torchrl.step(self.held)["next"]
        names = ("observation", "reward", "terminated", "truncated")
        parts = {name: np.array(list(part.values())) for name, part in zip(names, step[:4], strict=True)}
        told = {name: np.array([info[name] for info in step[4].values()]) for name in step[4][agents[0]]}
        for name, part in (parts | told).items():
            self.hold(name, part, live)
        np.testing.assert_allclose(
            self.held["state"].flatten(0, 1), self.parallel.state(), rtol=1e-5, atol=1e-5
        )
        assert self.parallel.state() in self.parallel.state_space
        if not over.any():  # then all must be reset
            *rows, info = self.vector.step(action)
            theirs = dict(zip(names, rows, strict=True)) | info
            for name, part in (parts | told).items():
                if not (self.vector._together and name in names[2:]):  # ends that are told together
                    np.testing.assert_array_equal(part, theirs[name][live])
            np.testing.assert_array_equal(self.parallel.state(), self.vector.state())
        if self.single is not None and live[0] == 0:
            observation, *rest, info = self.single.step(action[0])
            np.testing.assert_array_equal(observation, parts["observation"][0])
            assert rest == [parts[name][0] for name in names[1:]]
            assert info == step[4]["swimmer_0"]
            np.testing.assert_array_equal(self.single.state(), self.parallel.state()[:1])
        return parts["terminated"].any(), parts["truncated"].any()

    def hold(self, name, part, live):
        """TorchRL's face says the same of the living, in its own precision."""
        theirs = self.held[GROUP, name].flatten(0, 1)[list(live)].numpy().reshape(part.shape)
        np.testing.assert_allclose(theirs, part, rtol=1e-5, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("few", [True, False], ids=["numpy", "torch"])
@pytest.mark.parametrize("name", WORLDS)
def test_all_faces_live_the_same_lives(name, few, monkeypatch):
    monkeypatch.setattr(worlds, "NUMPY_CELLS", 5_000 if few else 0)
    faces, generator, ends = Faces(**WORLDS[name]), np.random.default_rng(0), []
    for seed in (5, None):
        faces.reset(seed)
        while faces.parallel.agents:
            if faces.world.is_continuous:
                action = generator.uniform(-1, 5, (faces.cells, 1)).astype(np.float32)
            else:
                action = generator.integers(faces.world.n_actions, size=faces.cells)
            ends.append(faces.step(action))
        assert faces.held["done"].all()
        faces.torchrl.observation_spec.assert_is_in(
            faces.held.select(*faces.torchrl.observation_spec.keys(True, True))
        )
    terminated, truncated = np.any(ends, axis=0)
    assert terminated or truncated
    assert terminated or "egg" not in name or "steered" in name
