"""PPO: its parts by hand, and runs that end as if they had never been stopped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from swarm.policies.network import load_policy
from swarm.torchrl_env import SwarmEnv
from tests.short_runs import short_settings
from tests.trainers.test_cli import elsewhere, run  # noqa: F401
from trainers.algorithms.networks import seed_mlp
from trainers.algorithms.ppo import PPO, ContinuousSampling, Sampling, clip_by_seed
from trainers.settings.composition import settings_from
from trainers.training.loop import Training

RUN = ["learning.epochs=1", "learning.batch_size=8", "world.life=4", "validation.life=4"]
RUN += ["validation.cells=2", "tensorboard=false"]


def test_actions_are_drawn_by_their_probability():
    env = SwarmEnv(1, n_swimmers=2000, seed=0)
    env.restart()
    network = seed_mlp((8, 2), [0])
    sampling = Sampling(network, env, central=False)
    observation = env.observation[:, :1].expand(1, 2000, 8)
    uniform = torch.rand(1, 2000, 2, generator=torch.Generator().manual_seed(0))
    out = sampling(TensorDict({"observation": observation, "uniform": uniform}, (1, 2000)))
    chances = network(observation).softmax(-1)[0, 0]
    assert out["action"].double().mean().item() == pytest.approx(chances[1].item(), abs=0.04)
    taken = chances[out["action"][0]].log()
    torch.testing.assert_close(out["action_log_prob"][0], taken)


def test_curvatures_are_drawn_around_the_middle_that_the_network_tells():
    env = SwarmEnv(1, n_swimmers=4000, seed=0, action="continuous", curvature_range=(-1.0, 5.0))
    env.restart()
    network = seed_mlp((8, 2), [0])
    network[0].bias.data[:] = torch.tensor([0.3, -1.0])
    uniform = torch.rand(1, 4000, 2, generator=torch.Generator().manual_seed(0))
    seen = torch.zeros(1, 4000, 8)
    before = torch.get_rng_state()
    out = ContinuousSampling(network, env, central=False)(
        TensorDict({"observation": seen, "uniform": uniform}, (1, 4000))
    )
    assert torch.equal(before, torch.get_rng_state())
    latent = out["latent"].squeeze()
    assert latent.mean().item() == pytest.approx(0.3, abs=0.02)
    assert latent.std().item() == pytest.approx(np.exp(-1), abs=0.02)
    torch.testing.assert_close(out["action"][0], 2 + 3 * latent.tanh())
    normal = torch.distributions.Normal(0.3, np.exp(-1))
    torch.testing.assert_close(out["action_log_prob"][0], normal.log_prob(latent))


@pytest.mark.slow
def test_a_policy_of_curvatures_is_one_in_numpy_and_in_every_command():
    assert run("train", *RUN, "experiment=continuous_n4", "hydra.run.dir=steered")[0] == 0
    policy = load_policy("steered")
    assert (policy.n_actions, policy.curvature_range, policy.algorithm) == (1, (3.0, 5.0), "ppo")
    seen = np.random.default_rng(0).normal(size=(50, 8)).astype(np.float32)
    by_hand = seen
    for weight, bias in zip(policy.weights[:-1], policy.biases[:-1], strict=True):
        by_hand = np.tanh(by_hand @ weight.T + bias)
    by_hand = 4 + np.tanh(by_hand @ policy.weights[-1].T + policy.biases[-1])
    np.testing.assert_allclose(policy(seen), by_hand[:, 0], rtol=1e-5)
    code, out, _ = run("evaluate", "steered", "--cells", 3, "--life", 8)
    assert code == 0
    assert {"ppo", "greedy", "swinging", "limit:"} <= {
        line.split()[0] for line in out.splitlines() if line.strip()
    }
    assert run("watch", "steered", "--life", 2, "--cells", 2, "--out", "steered.html")[0] == 0
    assert run("export", "steered", "--format", "json")[0] == 0
    code, _, error = run("evaluate", "steered", "--experiment", "linear_n4", "--cells", 2, "--life", 4)
    assert code != 0
    assert "the policy takes curvatures of (3.0, 5.0), the world numbers of actions" in error


def test_deep_q_learning_refuses_curvatures_in_a_line():
    code, _, error = run("train", *RUN, "world.action=continuous", "hydra.run.dir=no")
    assert code != 0
    assert "world.action must be 'discrete' where dqn learns, which values each action, got" in error
    assert not Path("no").exists()


def test_a_gradient_is_scaled_down_seed_by_seed():
    parameter = torch.nn.Parameter(torch.zeros(2, 3, 1))
    parameter.grad = torch.tensor([[[3.0], [0.0], [4.0]], [[0.3], [0.0], [0.4]]])
    clip_by_seed([parameter], 1.0)
    torch.testing.assert_close(parameter.grad.flatten(1).norm(dim=1), torch.tensor([1.0, 0.5]))


def test_advantages_bootstrap_when_time_is_up_and_not_after_an_arrival():
    settings = settings_from(
        ["algorithm=ppo", "learning.n_swimmers=3", "learning.discount=0.9", "learning.lam=0.5"]
    )
    env = SwarmEnv(1, n_swimmers=3, seeds=[0], world=settings.training_world())
    env.restart()
    learner = PPO(env, settings)
    rollout = learner.collector.collect(2)
    # cell 0 goes on, cell 1 arrives in the second decision, cell 2 was done before it
    rollout["next", "terminated"][1, 0, 1] = rollout["next", "done"][1, 0, 1] = True
    rollout["next", "done"][:, 0, 2] = True
    rollout["collector", "mask"][1, 0, 2] = False
    rows = learner.judged(rollout)
    value = lambda seen: learner.critic(seen.reshape(1, 1, -1)).item()  # noqa: E731
    for cell, continues in ((0, True), (1, False)):
        reward = rollout["next", "reward"][:, 0, cell, 0].tolist()
        seen = [*rollout["seen"][:, 0, cell], rollout["next", "observation"][1, 0, cell]]
        v = [value(each) for each in seen]
        last = reward[1] + 0.9 * v[2] * continues - v[1]
        first = reward[0] + 0.9 * v[1] - v[0] + 0.9 * 0.5 * last
        goals = rows["value_target"].reshape(3, 2)[cell]
        torch.testing.assert_close(goals, torch.tensor([first + v[0], last + v[1]]), rtol=1e-4, atol=1e-4)
    alive = rows["collector", "mask"].reshape(3, 2)
    advantage = rows["advantage"].reshape(3, 2)
    assert advantage[~alive].abs().max() == 0
    assert advantage[alive].mean().item() == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize(
    ("world", "numbers"), [({}, 5), ({"torsions": [2.0, 1.0]}, 8)], ids=["plane", "space"]
)
def test_a_central_critic_sees_all_cells_of_the_world(world, numbers):
    training = Training(short_settings("ppo", world, learning={"critic": "central", "n_swimmers": 4}))
    training.env.restart()
    algorithm = training.algorithm
    seen = algorithm.sampling.seen(training.env.observation, algorithm.collector.poses())
    assert seen.shape[-1] == training.env.world.observation_size + numbers * 4
    of_cells = seen[..., -numbers * 4 :]
    np.testing.assert_array_equal(of_cells[0, 0], of_cells[0, 3])
    training.run_epoch()


@pytest.mark.slow
def test_every_command_tells_a_run_of_ppo_from_one_of_dqn():
    algorithms = ["ppo", "dqn", "drqn"]
    for algorithm in algorithms:
        code, *_ = run("train", *RUN, f"algorithm={algorithm}", f"hydra.run.dir={algorithm}")
        assert (code, load_policy(algorithm).card["algorithm"]) == (0, algorithm)
        assert "nothing is left to learn" in run("train", f"resume={algorithm}")[1]
        _, out, _ = run("evaluate", algorithm, "--cells", 2, "--life", 4)
        assert {line.split()[0] for line in out.splitlines()[1:4]} == {algorithm, "greedy", "swinging"}
        run("watch", algorithm, "--life", 2, "--cells", 2, "--out", f"{algorithm}.html")
        assert f'"name": "{algorithm}"' in Path(f"{algorithm}.html").read_text()
    _, out, _ = run("compare", *algorithms, "--cells", 2)
    assert {line.split()[0] for line in out.splitlines()[1:]} == set(algorithms)
    assert run("export", "drqn", "--format", "json")[0] == 0
    assert "format must be json for a recurrent network" in run("export", "drqn", "--format", "onnx")[2]
