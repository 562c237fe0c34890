"""How each algorithm learns: the numbers behind `learning`, with what each of them means."""

import dataclasses
import sys
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import ConfigDict, Field, model_validator
from pydantic.dataclasses import dataclass

from swarm._support.registry import Registry

ALGORITHMS = Registry("algorithm", "chemoswarm.algorithms")  # their settings, which name what learns
RULES = ConfigDict(extra="forbid", validate_default=True)

# Strict: 1.0 is no whole number, "1" no number and 1 no flag, wherever they come from.
Count = Annotated[int, Field(strict=True, ge=1, le=sys.maxsize)]
Whole = Annotated[int, Field(strict=True, ge=0, le=sys.maxsize)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
Amount = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Part = Annotated[float, Field(strict=True, ge=0, le=1, allow_inf_nan=False)]
Share = Annotated[float, Field(strict=True, gt=0, le=1, allow_inf_nan=False)]
Flag = Annotated[bool, Field(strict=True)]
Sizes = list[Count]  # none: the outputs are linear in what is observed


@dataclass(config=RULES, frozen=True, kw_only=True)
class LearningSettings:
    """What every algorithm has. The defaults are the paper's (table 2) and, where it is silent, its authors'
    code's.

    Those of an algorithm derive from it, and are registered in `ALGORITHMS` by the algorithm's name.
    """

    learner: ClassVar[Any]  # the `Algorithm` that learns so, or where it is: "module:name"
    n_swimmers: Count = 1  # cells in a world
    n_worlds: Count = 1  # worlds of each seed
    epochs: Count = 1600  # lives to train for, paper table 2
    collect: Whole = 0  # decisions between two rounds of updates; 0: a whole life
    # cells of a seed that decide in a task of their own, which may go to other processes or nodes: some whole
    # worlds, or a part of one; 0: all cells at once
    block: Whole = 0
    # rounds of updates that the policy which collects may lag behind; 1: it collects while the next learns
    staleness: Annotated[Whole, Field(le=1)] = 0
    batch_size: Count = 128  # decisions of a cell in an update
    hidden: Sizes = dataclasses.field(
        default_factory=lambda: [24, 24, 24]
    )  # N_hidden = 3 layers of N_n nodes, paper table 2
    discount: Part = 0.98  # γ, paper table 2
    learning_rate: Positive = 0.01  # α, paper table 2
    # α / (1 + decay · updates), or "linear": to `learning_rate_end` · α
    learning_rate_schedule: Literal["inverse_time", "linear"] = "inverse_time"
    learning_rate_decay: Amount = 0.1  # paper table 2
    learning_rate_end: Part = 0.01  # fraction of α left after the last epoch
    keep: Literal["last", "best"] = "last"  # the policy that is kept: the last, or the best in validation

    @property
    def sees_worlds(self) -> bool:
        """Whether what a cell learns from is of its whole world."""
        return False


@ALGORITHMS.register("dqn")
@dataclass(config=RULES, frozen=True, kw_only=True)
class DQNSettings(LearningSettings):
    """Deep Q-learning (Mnih et al. 2015), as in the paper unless said otherwise."""

    learner: ClassVar[Any] = "trainers.algorithms.dqn:DQN"
    updates: Count = 1  # in a round
    buffer_size: Count = 10_000  # transitions
    n_steps: Count = 1  # decisions whose rewards a target sums before it bootstraps
    double: Flag = False  # the online network chooses the next action, the target network values it
    target_rate: Share = 1.0  # part of the way the target network moves per update; 1: the same network
    loss: Literal["squared", "huber"] = "squared"
    epsilon_start: Part = 1.0  # ε in the first epoch
    epsilon_end: Part = 0.1  # ε is never lower, paper table 2
    # ε · decay per epoch, or "linear": over `epsilon_fraction` of the epochs
    epsilon_schedule: Literal["exponential", "linear"] = "exponential"
    epsilon_decay: Share = 0.998  # paper table 2
    epsilon_fraction: Share = 0.6

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.epsilon_end > self.epsilon_start:
            raise ValueError(
                "epsilon_end must not be above epsilon_start, "
                f"got {self.epsilon_end:g} and {self.epsilon_start:g}"
            )
        return self


@ALGORITHMS.register("drqn")
@dataclass(config=RULES, frozen=True, kw_only=True)
class DRQNSettings(DQNSettings):
    """Deep recurrent Q-learning (Hausknecht and Stone 2015, Kapturowski et al. 2019), from sequences of
    `collect` decisions, so many that an update has `batch_size`; none of its own numbers is the paper's.
    """

    learner: ClassVar[Any] = "trainers.algorithms.drqn:DRQN"
    n_swimmers: Count = 40
    seen: Annotated[Count, Field(ge=2)] = 2  # newest records that the network is shown; others it remembers
    nodes: Annotated[Count, Field(le=1024)] = 32  # of the recurrent layer, a GRU (Cho et al. 2014)
    hidden: Sizes = dataclasses.field(
        default_factory=list
    )  # layers between the recurrent one and the outputs
    collect: Whole = 20
    burn_in: Whole = 10  # decisions before those, which only bring the hidden state up to date
    batch_size: Count = 640


@ALGORITHMS.register("ppo")
@dataclass(config=RULES, frozen=True, kw_only=True)
class PPOSettings(LearningSettings):
    """Proximal policy optimisation (Schulman et al. 2017); none of its numbers is the paper's."""

    learner: ClassVar[Any] = "trainers.algorithms.ppo:PPO"
    n_swimmers: Count = 40
    epochs: Count = 12
    collect: Whole = 70
    passes: Count = 8  # over the decisions of a round, shuffled, in batches
    batch_size: Count = 700
    hidden: Sizes = dataclasses.field(default_factory=lambda: [64])  # of the policy and of the critic
    lam: Part = 0.9  # λ of the generalised advantage estimate (Schulman et al. 2016)
    clip: Share = 0.2  # how far the ratio of new to old probabilities may leave 1
    entropy: Amount = 0.003  # weight of the policy's entropy in the loss
    critic: Literal["own", "central"] = "own"  # values one cell's observation, or the whole world's state
    critic_weight: Positive = 0.5  # of the critic's squared error in the loss
    max_gradient: Positive = 0.5  # norm that gradients are scaled down to
    learning_rate: Positive = 3e-3
    learning_rate_schedule: Literal["inverse_time", "linear"] = "linear"
    keep: Literal["last", "best"] = "best"

    @property
    def sees_worlds(self) -> bool:
        return self.critic == "central"


@ALGORITHMS.register("evolution")
@dataclass(config=RULES, frozen=True, kw_only=True)
class EvolutionSettings(LearningSettings):
    """Evolution strategy (CMA-ES, Hansen 2016): no gradients; none of its numbers is the paper's.

    An epoch is a generation, and each world of a seed has a candidate of its own. What learns by gradients
    alone, `batch_size`, `discount` and the rates, is not used.
    """

    learner: ClassVar[Any] = "trainers.algorithms.evolution:Evolution"
    n_swimmers: Count = 20
    n_worlds: Annotated[Count, Field(ge=4)] = 16  # candidates of a generation
    epochs: Count = 60
    collect: Whole = 16
    hidden: Sizes = dataclasses.field(default_factory=lambda: [8])
    step_size: Positive = 0.5  # σ of the first generation's weights about those of a fresh network
    keep: Literal["last", "best"] = "best"

    @property
    def sees_worlds(self) -> bool:
        return True
