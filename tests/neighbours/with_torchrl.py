"""TorchRL: its multi-agent PPO with a central critic, in the manner of its own scripts, on `SwarmEnv`."""

import torch
from tensordict.nn import TensorDictModule
from torch.distributions import Categorical
from torchrl.envs import RewardSum, TransformedEnv
from torchrl.modules import MultiAgentMLP, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss, ValueEstimators

from swarm.envs.torchrl import SwarmEnv

WORLDS, CELLS, LIFE, DECISIONS = 8, 4, 8.0, 40
SEEN, LOGITS, VALUE = ("swimmers", "observation"), ("swimmers", "logits"), ("swimmers", "state_value")


def make_env():
    env = SwarmEnv(WORLDS, n_swimmers=CELLS, life=LIFE, seed=0)
    return TransformedEnv(env, RewardSum(in_keys=[env.reward_key], out_keys=[("swimmers", "episode_reward")]))


def steps():
    worlds, decisions = make_env().rollout(DECISIONS, break_when_any_done=False).shape
    return f"{decisions} decisions of {worlds} × {CELLS} cells"


def network(env, outputs, *, centralised):
    inputs = env.observation_spec[SEEN].shape[-1]
    sizes = {"n_agent_inputs": inputs, "n_agent_outputs": outputs, "n_agents": CELLS}
    inner = {"depth": 2, "num_cells": 24, "activation_class": torch.nn.Tanh}
    return MultiAgentMLP(**sizes, **inner, centralised=centralised, share_params=True)


def trains():
    env = make_env()
    module = TensorDictModule(network(env, 2, centralised=False), in_keys=[SEEN], out_keys=[LOGITS])
    keys = {"in_keys": {"logits": LOGITS}, "out_keys": [env.action_key]}
    actor = ProbabilisticActor(module, **keys, distribution_class=Categorical, return_log_prob=True)
    critic = ValueOperator(network(env, 1, centralised=True), in_keys=[SEEN], out_keys=[VALUE])
    loss = ClipPPOLoss(actor, critic)
    ends = {name: ("swimmers", name) for name in ("done", "terminated")}
    loss.set_keys(reward=env.reward_key, action=env.action_key, value=VALUE, **ends)
    (log_prob,) = [key for key in actor.out_keys if "log_prob" in str(key)]
    loss.set_keys(sample_log_prob=log_prob)
    loss.make_value_estimator(ValueEstimators.GAE, gamma=0.98, lmbda=0.9)
    optimiser = torch.optim.Adam(loss.parameters(), 3e-3)
    first = [each.detach().clone() for each in actor.parameters()]
    critics = {"params": loss.critic_network_params, "target_params": loss.target_critic_network_params}
    for _ in range(3):
        with torch.no_grad():
            data = env.rollout(DECISIONS, actor, break_when_any_done=False)
            loss.value_estimator(data, **critics)
        for _ in range(4):
            found = loss(data)
            optimiser.zero_grad()
            sum(value for name, value in found.items() if name.startswith("loss_")).backward()
            optimiser.step()
    both = zip(first, actor.parameters(), strict=True)
    assert any(not torch.equal(*pair) for pair in both), "nothing was learnt"
    return f"MAPPO, 3 × {DECISIONS} decisions of {WORLDS} × {CELLS} cells"
