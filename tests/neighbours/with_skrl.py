"""skrl: its PettingZoo wrapper, and IPPO with networks for each cell."""

import tempfile
from dataclasses import fields

import torch
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import CategoricalMixin, DeterministicMixin, Model
from skrl.multi_agents.torch.base import ExperimentCfg
from skrl.multi_agents.torch.ippo import IPPO, IPPO_CFG
from skrl.trainers.torch import SequentialTrainer

import swarm

CELLS, LIFE, DECISIONS = 3, 8.0, 200


class Policy(CategoricalMixin, Model):
    def __init__(self, **spaces):
        Model.__init__(self, device="cpu", **spaces)
        CategoricalMixin.__init__(self)
        self.net = torch.nn.Sequential(torch.nn.LazyLinear(24), torch.nn.Tanh(), torch.nn.Linear(24, 2))

    def compute(self, inputs, role=""):
        return self.net(inputs["observations"]), {}


class Value(DeterministicMixin, Model):
    def __init__(self, **spaces):
        Model.__init__(self, device="cpu", **spaces)
        DeterministicMixin.__init__(self)
        self.net = torch.nn.Sequential(torch.nn.LazyLinear(24), torch.nn.Tanh(), torch.nn.Linear(24, 1))

    def compute(self, inputs, role=""):
        return self.net(inputs["observations"]), {}


def steps():
    env, count = wrap_env(swarm.parallel_env(CELLS, life=LIFE)), 0
    env.reset()
    while env.agents:
        env.step({agent: torch.tensor([[1]]) for agent in env.agents})
        count += 1
    return f"a life of {count} decisions in its wrapper"


def trains():
    env = wrap_env(swarm.parallel_env(CELLS, life=LIFE))
    kinds = ("observation_spaces", "state_spaces", "action_spaces")
    spaces = {kind: getattr(env, kind) for kind in kinds}
    models = {}
    for agent in env.possible_agents:
        own = {name[:-1]: of[agent] for name, of in spaces.items()}
        models[agent] = {"policy": Policy(**own), "value": Value(**own)}
        for model in models[agent].values():
            model.net(torch.zeros(1, *env.observation_space(agent).shape))
    first = models["swimmer_0"]["policy"].net[0].weight.detach().clone()
    memories = {agent: RandomMemory(memory_size=20, num_envs=1) for agent in env.possible_agents}
    # skrl 2.1.1 takes each of its own defaults {} for a dictionary by agent that misses them.
    defaults = [each.name for each in fields(IPPO_CFG) if each.name.endswith("_kwargs")]
    settings = {"rollouts": 20} | {name: {agent: {} for agent in models} for name in defaults}
    with tempfile.TemporaryDirectory() as folder:
        settings["experiment"] = ExperimentCfg(directory=folder, write_interval=0)
        parts = {"models": models, "memories": memories, "device": "cpu"} | spaces
        learner = IPPO(possible_agents=env.possible_agents, cfg=settings, **parts)
        SequentialTrainer(env=env, agents=learner, cfg={"timesteps": DECISIONS}).train()
    assert not torch.equal(first, models["swimmer_0"]["policy"].net[0].weight), "nothing was learnt"
    return f"IPPO, {DECISIONS} decisions of {CELLS} cells"
