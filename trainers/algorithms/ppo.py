"""Proximal policy optimisation (Schulman et al. 2017), made of TorchRL's parts, for a stack of seeds."""

from collections.abc import Iterator
from typing import Any, cast

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn
from torch.distributions import Categorical
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from swarm.envs.torchrl import SwarmEnv
from trainers.algorithms.base import Algorithm, fused_adam, held_by, learning_rate_at, living_mean
from trainers.algorithms.collector import SeedCollector
from trainers.algorithms.networks import best, memory_of, seed_mlp
from trainers.settings.learning import PPOSettings
from trainers.settings.schema import Settings

OF_ACTOR = ("observation", "action_log_prob", "advantage")
SPREAD = (-5.0, 2.0)  # of the logarithm of a continuous action's deviation
OF_CRITIC = ("seen", "value_target", "state_value")
OF_A_CELL = {2: 5, 3: 8}  # numbers of a world's state for each cell, by dimensions: place, heading, curvature


class Sampling(TensorDictModuleBase):
    """Draws an action by its probability; keeps how probable it was, and what the critic sees.

    ProbabilisticActor draws from torch's global generator; here the numbers are drawn outside.
    """

    out_keys = ["action", "action_log_prob", "seen"]

    def __init__(self, network: nn.Module, env: SwarmEnv, *, central: bool) -> None:
        super().__init__()
        self.in_keys = ["observation", "uniform", *["poses"] * central]
        self.network, self.n_swimmers, self.action_range = network, env.n_swimmers, env.world.action_range
        box = env.world.box
        self.middle = torch.tensor([(low + high) / 2 for low, high in box], device=env.device)
        self.size = max(high - low for low, high in box) or 1.0

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        observation = tensordict["observation"]
        tensordict.update(self.drawn(self.network(observation), tensordict["uniform"][..., :1]))
        return tensordict.set("seen", self.seen(observation, tensordict.get("poses")))

    def drawn(self, outputs: Tensor, uniform: Tensor) -> dict[str, Tensor]:
        """The action, and how probable it was, from a network's outputs and numbers (..., 1) in [0, 1)."""
        chances = outputs.log_softmax(-1)
        action = (uniform >= chances.exp().cumsum(-1)[..., :-1]).sum(-1)
        return {"action": action, "action_log_prob": chances.gather(-1, action.unsqueeze(-1)).squeeze(-1)}

    def seen(self, observation: Tensor, poses: Tensor | None) -> Tensor:
        """Observations (seeds, cells, ...); with `poses` (seeds, cells, numbers), for a central critic, and
        those of all cells of their worlds.
        """
        if poses is None:
            return observation
        dimensions = len(self.middle)
        place = (poses[..., :dimensions] - self.middle) / self.size
        whole = torch.cat([place, poses[..., dimensions:]], dim=-1)
        whole = whole.reshape(-1, self.n_swimmers * whole.shape[-1])
        of_cells = whole.unsqueeze(1).expand(-1, self.n_swimmers, -1)  # the same for all cells of a world
        return torch.cat([observation, of_cells.reshape(*observation.shape[:2], -1).float()], dim=-1)


class ContinuousSampling(Sampling):
    """Draws `latent`, a real number for every cell, from a normal distribution; the action is the curvature
    that it stands for. How probable it was is told of the latent: what `tanh` adds cancels in PPO's ratio.
    """

    out_keys = ["action", "latent", "action_log_prob", "seen"]

    def drawn(self, outputs: Tensor, uniform: Tensor) -> dict[str, Tensor]:
        middle, spread = middle_and_spread(outputs)
        latent = middle + spread * torch.special.ndtri(uniform.clamp(1e-6, 1 - 1e-6))
        chance = IndependentNormal(middle, spread).log_prob(latent)
        return {"action": best(latent, self.action_range), "latent": latent, "action_log_prob": chance}


def middle_and_spread(outputs: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and deviation (..., 1) of a continuous action's latent, from a network's outputs (..., 2)."""
    return outputs[..., :1], outputs[..., 1:].clamp(*SPREAD).exp()


class PPO(Algorithm):
    """Decides for every cell by chance, and makes more probable what turned out better than expected."""

    metrics = ("loss", "entropy", "explained", "learning_rate")
    settings: PPOSettings

    def __init__(self, env: SwarmEnv, settings: Settings) -> None:
        learning = cast(PPOSettings, settings.learning)
        self.env, self.settings = env, learning
        self.policy = seed_mlp(settings.layers, self.keys("network"), env.device)
        self.critic = seed_mlp(layers_of_critic(settings), self.keys("network", 1), env.device)
        continuous = env.world.is_continuous
        sampling = ContinuousSampling if continuous else Sampling
        self.sampling = sampling(self.policy, env, central=learning.critic == "central")
        self.collector = SeedCollector(env, self.sampling)
        self.chosen = "latent" if continuous else "action"
        actor = actor_of(self.policy, continuous=continuous)
        self.loss = ClipPPOLoss(
            actor,
            ValueOperator(self.critic, in_keys=["seen"]),
            clip_epsilon=learning.clip,
            entropy_coeff=learning.entropy,
            critic_coeff=learning.critic_weight,
            loss_critic_type="smooth_l1",
            reduction="none",
        )
        self.loss.set_keys(action=self.chosen, sample_log_prob="action_log_prob")
        self.distribution = actor.get_dist
        self.advantage = GAE(gamma=learning.discount, lmbda=learning.lam, value_network=None, time_dim=2)
        self.optimiser = fused_adam([*self.policy.parameters(), *self.critic.parameters()])

    @staticmethod
    def memory_needed(settings: Settings) -> int:
        learning, critic = cast(PPOSettings, settings.learning), layers_of_critic(settings)
        world = settings.training_world()
        cells = learning.n_worlds * learning.n_swimmers
        rows = cells * min(learning.collect or world.max_decisions, world.max_decisions)
        held = 4 * rows * 3 * (settings.layers[0] + critic[0]) + memory_of(critic, learning.batch_size)
        return held + Algorithm.memory_needed(settings)

    @torch.no_grad()
    def judged(self, rollout: TensorDict) -> TensorDict:
        """The decisions (seeds, rows) of a rollout, with their advantages and the critic's goals.

        Advantages (Schulman et al. 2016) are scaled to mean 0 and deviation 1 over the seed's living cells.
        """
        poses = self.collector.poses() if self.settings.critic == "central" else None
        seen = self.sampling.seen(rollout["next", "observation"][-1], poses).unsqueeze(0)
        seen = torch.cat([rollout["seen"], seen])  # nobody starts anew within a rollout
        decisions, seeds, cells = rollout.shape
        by_seed = seen.transpose(0, 1).reshape(seeds, (decisions + 1) * cells, -1)
        values = self.critic(by_seed).reshape(seeds, decisions + 1, cells, 1).permute(0, 2, 1, 3)
        lives = rollout.permute(1, 2, 0)  # (seeds, cells, decisions)
        lives.set("state_value", values[:, :, :-1]).set(("next", "state_value"), values[:, :, 1:])
        rows = self.advantage(lives).flatten(1)
        alive = rows["collector", "mask"].unsqueeze(-1)
        advantage, count = torch.where(alive, rows["advantage"], 0.0), alive.sum(1, keepdim=True).clamp(min=1)
        centred = torch.where(alive, advantage - advantage.sum(1, keepdim=True) / count, 0.0)
        spread = (centred.square().sum(1, keepdim=True) / count).sqrt()
        return rows.set("advantage", centred / (spread + 1e-8))

    def batches(self, rows: TensorDict) -> Iterator[TensorDict]:
        """The decisions (seeds, rows), shuffled anew for each pass, in batches."""
        chosen = rows.select(*OF_ACTOR, self.chosen, *OF_CRITIC, ("collector", "mask"))
        places = torch.arange(len(self.draws), device=rows["seen"].device)[:, None]
        for _ in range(self.settings.passes):
            order = [torch.randperm(rows.shape[1], generator=each, device=each.device) for each in self.draws]
            yield from chosen[places, torch.stack(order)].split(self.settings.batch_size, dim=1)

    def learn(self, rollout: TensorDict, progress: float) -> dict[str, Tensor | float] | None:
        rows = self.judged(rollout)
        rate = learning_rate_at(self.settings, self.updates, progress)
        self.optimiser.param_groups[0]["lr"] = rate
        for batch in self.batches(rows):
            parts: Any = self.loss(batch)
            each = parts["loss_objective"] + parts["loss_entropy"] + parts["loss_critic"]
            loss = living_mean(each, batch)
            self.optimiser.zero_grad()
            loss.sum().backward()
            clip_by_seed(self.optimiser.param_groups[0]["params"], self.settings.max_gradient)
            self.optimiser.step()
            self.updates += 1
        return {"loss": loss.detach(), "learning_rate": rate, **self.looked_at(rows)}

    @torch.no_grad()
    def looked_at(self, rows: TensorDict) -> dict[str, Tensor]:
        """Per seed: the policy's mean entropy [nat], and the part of the returns' variance that the critic
        explained before it learnt from them."""
        entropy = self.distribution(rows.select("observation")).entropy().mean(-1)
        goal = rows["value_target"].squeeze(-1)
        missed = goal - rows["state_value"].squeeze(-1)
        return {"entropy": entropy, "explained": 1 - missed.var(-1) / goal.var(-1).clamp_min(1e-12)}

    def tensors(self) -> dict[str, Tensor]:
        return held_by(self.optimiser, policy=self.policy, critic=self.critic)


def actor_of(policy: nn.Module, *, continuous: bool) -> ProbabilisticActor:
    """The policy as the loss reads it."""
    actor: Any = TensorDictModule(policy, in_keys=["observation"], out_keys=["logits"])
    if continuous:
        parts = TensorDictModule(middle_and_spread, in_keys=["logits"], out_keys=["loc", "scale"])
        actor = TensorDictSequential(actor, parts)
    return ProbabilisticActor(
        actor,
        in_keys=["loc", "scale"] if continuous else ["logits"],
        out_keys=["latent" if continuous else "action"],
        distribution_class=IndependentNormal if continuous else Categorical,
        return_log_prob=True,
    )


def layers_of_critic(settings: Settings) -> tuple[int, ...]:
    """Sizes of its layers, from inputs to outputs."""
    learning = cast(PPOSettings, settings.learning)
    inputs, *hidden, _ = settings.layers
    others = OF_A_CELL[settings.training_world().dimensions] * learning.n_swimmers
    return (inputs + others * (learning.critic == "central"), *hidden, 1)


def clip_by_seed(parameters: list[nn.Parameter], most: float) -> None:
    """Scales the gradient of each seed down to a norm of at most `most`; torch's own takes one of all."""
    slopes = [each.grad for each in parameters if each.grad is not None]
    norms = torch.stack([slope.flatten(1).norm(dim=1) for slope in slopes]).norm(dim=0)  # (seeds,)
    factors = (most / (norms + 1e-6)).clamp(max=1.0)
    torch._foreach_mul_(slopes, [factors.reshape(-1, *(1,) * (slope.ndim - 1)) for slope in slopes])
