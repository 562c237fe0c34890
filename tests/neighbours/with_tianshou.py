"""Tianshou: its PettingZoo environment, and a DQN for each cell."""

import torch
from tianshou.algorithm import DQN, MultiAgentOffPolicyAlgorithm
from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv, PettingZooEnv
from tianshou.trainer import OffPolicyTrainerParams
from tianshou.utils.net.common import Net

from swarm import sperm_swarm_v0

CELLS, LIFE, DECISIONS = 3, 8.0, 600


def make_env():
    return PettingZooEnv(sperm_swarm_v0.env(CELLS, life=LIFE))


def steps():
    env, count, ended = make_env(), 0, False
    env.reset(seed=0)
    while not ended:
        _, _, terminated, truncated, _ = env.step(1)
        ended, count = terminated or truncated, count + 1
    return f"a life of {count} turns of single cells in its wrapper"


def trains():
    env, algorithms = make_env(), []
    for _ in env.agents:
        shapes = {"state_shape": env.observation_space.shape, "action_shape": env.action_space.n}
        net = Net(**shapes, hidden_sizes=(24, 24))
        policy = DiscreteQLearningPolicy(model=net, action_space=env.action_space, eps_training=0.2)
        algorithms.append(DQN(policy=policy, optim=AdamOptimizerFactory(3e-3), gamma=0.98))
    learner = MultiAgentOffPolicyAlgorithm(algorithms=algorithms, env=env)
    first = [each.detach().clone() for each in learner.parameters()]
    worlds = DummyVectorEnv([make_env] * 2)
    settings = OffPolicyTrainerParams(
        training_collector=Collector(learner, worlds, VectorReplayBuffer(2000, 2), exploration_noise=True),
        max_epochs=1,
        epoch_num_steps=DECISIONS,
        collection_step_num_env_steps=60,
        batch_size=64,
        update_step_num_gradient_steps_per_sample=0.1,
    )
    learner.run_training(settings)
    both = zip(first, learner.parameters(), strict=True)
    assert any(not torch.equal(*pair) for pair in both), "nothing was learnt"
    return f"DQN, {DECISIONS} turns of {CELLS} cells"
