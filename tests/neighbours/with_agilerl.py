"""AgileRL: its PettingZoo vector environment, and IPPO with one network for all cells."""

import numpy as np
import torch
from agilerl.algorithms import IPPO
from agilerl.training.train_multi_agent_on_policy import train_multi_agent_on_policy
from agilerl.vector import PzDummyVecEnv

import swarm

CELLS, LIFE, DECISIONS = 3, 8.0, 200


def steps():
    env, count = PzDummyVecEnv(swarm.parallel_env(CELLS, life=LIFE)), 50
    env.reset(seed=0)
    for _ in range(count):
        env.step({agent: np.array([1]) for agent in env.agents})
    return f"{count} decisions of {CELLS} cells in its vector environment"


def trains():
    env = swarm.parallel_env(CELLS, life=LIFE)
    agents = env.possible_agents
    spaces = [[of(agent) for agent in agents] for of in (env.observation_space, env.action_space)]
    learner = IPPO(*spaces, agent_ids=agents, learn_step=50, batch_size=50)
    first = [each.detach().clone() for each in learner.actors["swimmer"].parameters()]
    settings = {"max_steps": DECISIONS, "evo_steps": DECISIONS, "eval_loop": 1, "verbose": False}
    (learnt,), _ = train_multi_agent_on_policy(PzDummyVecEnv(env), "cells", "IPPO", [learner], **settings)
    after = learnt.actors["swimmer"].parameters()
    assert any(not torch.equal(*pair) for pair in zip(first, after, strict=True)), "nothing was learnt"
    return f"IPPO, {DECISIONS} decisions of {CELLS} cells"
