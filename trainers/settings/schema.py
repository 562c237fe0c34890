"""Typed settings of a training run, checked before anything runs; the defaults are the paper's numbers."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from swarm._support.checks import check_box, check_count, check_name, check_number
from swarm.physics.world import FIELDS, FLOWS, World
from swarm.policies.policy_file import MAX_FILE, MAX_HEADER, MAX_LAYERS, MAX_WIDTH

MAX_THREADS = 1024
MAX_PLACE = 1e5  # [length] of a start, where float32 tells places 0.008 apart


@dataclass
class WorldSettings:
    """Parameters of `swarm.World`, with fields and flows by name; paper table 1 are the defaults there."""

    n_records: int = 4  # N_T
    field: str = "linear"
    flow: str = "still"
    sense_flow: bool = False
    varying_speed: bool = False
    life: float = 80.0  # t_life in training
    start_box: list[Any] | None = None  # [[x, x], [y, y]]
    curvatures: list[float] = dataclasses.field(default_factory=lambda: [3.0, 5.0])
    speed: float = 1.0
    speeds: list[float] = dataclasses.field(default_factory=lambda: [1.1, 0.9])
    time_step: float = 0.02
    interval_rule: str = "truncated"
    concentration_noise: float = 0.0
    curvature_noise: float = 0.0
    rotational_diffusion: float = 0.0

    def __post_init__(self) -> None:
        if self.start_box is not None:  # whole numbers too: OmegaConf converts nested lists only halfway
            self.start_box = [list(side) for side in check_box("world.start_box", self.start_box)]


@dataclass
class LearningSettings:
    """How the network learns. The defaults are the paper's (table 2) and, where it is silent, its authors'
    code's.
    """

    n_swimmers: int = 1  # cells in a world
    n_worlds: int = 1  # worlds of each seed
    epochs: int = 1600  # lives to train for, paper table 2
    collect: int = 0  # decisions between two rounds of updates; 0: a whole life
    updates: int = 1  # updates in a round
    batch_size: int = 128
    buffer_size: int = 10_000  # transitions
    hidden: list[int] = dataclasses.field(
        default_factory=lambda: [24, 24, 24]
    )  # N_hidden = 3 layers of N_n nodes, paper table 2
    discount: float = 0.98  # γ, paper table 2
    n_steps: int = 1  # decisions whose rewards a target sums before it bootstraps
    double: bool = (
        False  # double DQN: the online network chooses the next action, the target network values it
    )
    target_rate: float = (
        1.0  # part of the way the target network moves to the online one per update; 1: the same network
    )
    loss: str = "squared"  # or "huber"
    learning_rate: float = 0.01  # α, paper table 2
    learning_rate_schedule: str = (
        "inverse_time"  # α / (1 + decay · updates), or "linear": to `learning_rate_end` · α
    )
    learning_rate_decay: float = 0.1  # paper table 2
    learning_rate_end: float = 0.01  # fraction of α left after the last epoch
    epsilon_start: float = 1.0  # ε in the first epoch
    epsilon_end: float = 0.1  # ε is never lower, paper table 2
    epsilon_schedule: str = (
        "exponential"  # ε · decay per epoch, or "linear": over `epsilon_fraction` of the epochs
    )
    epsilon_decay: float = 0.998  # paper table 2
    epsilon_fraction: float = 0.6
    keep: str = "last"  # the policy that is kept: "last", or "best" on the validation population


@dataclass
class ValidationSettings:
    """The population on which the greedy policy is tested during training; its starts are never trained or
    tested on.
    """

    cells: int = 40
    life: float = 200.0  # t_life [time]
    every: int = 20  # epochs


@dataclass
class EvaluationSettings:
    """The test after training, on fresh cells."""

    field: str | None = None  # the field of the test where it differs from training
    cells: int = 40
    life: float = 200.0  # t_life in tests, paper table 1
    seed: int = 0


@dataclass
class Settings:
    """Everything that decides a run, but for where its folder is."""

    experiment: str = "linear_n4"
    recipe: str = "paper"
    seed: int = 0
    n_seeds: int = 1  # independent seeds trained at once: seed, seed + 1, …
    world: WorldSettings = dataclasses.field(default_factory=WorldSettings)
    learning: LearningSettings = dataclasses.field(default_factory=LearningSettings)
    validation: ValidationSettings = dataclasses.field(default_factory=ValidationSettings)
    evaluation: EvaluationSettings = dataclasses.field(default_factory=EvaluationSettings)
    evaluate: bool = False  # test the kept policy when training ends
    checkpoint_every: int = 10  # epochs
    device: str = "cpu"
    threads: int = 1  # of torch
    compile: str = "auto"  # "never", "always", or "auto": when the run is long enough to gain
    tensorboard: bool = True
    wandb: bool = False

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def seeds(self) -> list[int]:
        """The seeds trained at once."""
        return list(range(self.seed, self.seed + self.n_seeds))

    def training_world(self) -> World:
        """The world to learn in."""
        return make_world(self.world)

    def test_world(self) -> World:
        """The world to be tested in, with the test's life."""
        changes: dict[str, Any] = {"life": self.evaluation.life}
        if self.evaluation.field is not None:
            changes["field"] = self.evaluation.field
        return self.training_world().replace(**changes)


def make_world(settings: WorldSettings) -> World:
    """The World these settings describe; raises what World raises."""
    values = dataclasses.asdict(settings)
    values["curvatures"] = tuple(values["curvatures"])
    values["speeds"] = tuple(values["speeds"])
    if values["start_box"] is not None:
        values["start_box"] = tuple(tuple(side) for side in values["start_box"])
    return World(**values)


def check_settings(settings: Settings) -> None:
    """Raises ValueError or TypeError naming the key, the rule and the value."""
    for name in ("experiment", "recipe"):
        if not getattr(settings, name).isprintable():
            raise ValueError(f"{name} must be printable text, got {getattr(settings, name)!r}")
    check_count("n_seeds", settings.n_seeds)
    for name, seed in (("seed", settings.seed), ("evaluation.seed", settings.evaluation.seed)):
        check_count(name, seed, at_least=0)
    check_name("world.field", settings.world.field, FIELDS)
    check_name("world.flow", settings.world.flow, FLOWS)
    _check_box(settings.world.start_box)
    with _naming("world"):
        world = make_world(settings.world)
    _check_learning(settings.learning)
    _check_network(settings.learning, world)
    for name, section in (("validation", settings.validation), ("evaluation", settings.evaluation)):
        check_count(f"{name}.cells", section.cells)
        check_number(f"{name}.life", section.life, above=0.0)
    check_count("validation.every", settings.validation.every)
    if settings.evaluation.field is not None:
        check_name("evaluation.field", settings.evaluation.field, FIELDS)
    with _naming("validation"):
        world.replace(life=settings.validation.life)
    with _naming("evaluation"):
        settings.test_world()
    check_count("checkpoint_every", settings.checkpoint_every)
    check_count("threads", settings.threads)
    if settings.threads > MAX_THREADS:
        raise ValueError(f"threads must be at most {MAX_THREADS}, got {settings.threads}")
    if not re.fullmatch(r"cpu|mps|(cuda|xpu)(:\d+)?", settings.device):
        raise ValueError(f"device must be cpu, mps, cuda or cuda:N, got {settings.device!r}")
    check_name("compile", settings.compile, ("never", "always", "auto"))


@contextmanager
def _naming(section: str) -> Iterator[None]:
    """Within, an error says in which section the key is."""
    try:
        yield
    except (TypeError, ValueError) as error:
        raise type(error)(f"{section}: {error}") from None


def _check_box(box: list[Any] | None) -> None:
    if box is not None and any(abs(number) > MAX_PLACE for side in box for number in side):
        raise ValueError(
            f"world.start_box must lie within ±{MAX_PLACE:g}, beyond which float32 is too coarse, got {box}"
        )


def _check_network(learning: LearningSettings, world: World) -> None:
    """Raises ValueError where the network would not fit into a policy file."""
    sizes = (world.observation_size, *learning.hidden, world.n_actions)
    if len(sizes) > MAX_LAYERS + 1 or max(sizes) > MAX_WIDTH:
        raise ValueError(
            f"learning.hidden must be at most {MAX_LAYERS - 1} layers of at most {MAX_WIDTH} nodes, as must "
            f"be inputs (world.n_records) and actions, got {' → '.join(map(str, sizes))}"
        )
    size = 4 * sum(inputs * outputs + outputs for inputs, outputs in itertools.pairwise(sizes))
    if size > MAX_FILE - MAX_HEADER:
        raise ValueError(
            f"learning.hidden must make a policy of at most {MAX_FILE - MAX_HEADER} bytes, got {size}"
        )


def _check_learning(learning: LearningSettings) -> None:
    for name in ("n_swimmers", "n_worlds", "epochs", "updates", "n_steps", "batch_size", "buffer_size"):
        check_count(f"learning.{name}", getattr(learning, name))
    check_count("learning.collect", learning.collect, at_least=0)
    if not learning.hidden:
        raise ValueError(f"learning.hidden must be one or more layer sizes, got {learning.hidden}")
    for size in learning.hidden:
        check_count("learning.hidden", size)
    for name in ("learning_rate", "target_rate", "epsilon_fraction", "epsilon_decay"):
        check_number(f"learning.{name}", getattr(learning, name), above=0.0)
    check_number("learning.learning_rate_decay", learning.learning_rate_decay, at_least=0.0)
    for name in (
        "discount",
        "target_rate",
        "learning_rate_end",
        "epsilon_start",
        "epsilon_end",
        "epsilon_decay",
        "epsilon_fraction",
    ):
        value = check_number(f"learning.{name}", getattr(learning, name), at_least=0.0)
        if value > 1:
            raise ValueError(f"learning.{name} must be between 0 and 1, got {value:g}")
    if learning.epsilon_end > learning.epsilon_start:
        raise ValueError(
            "learning.epsilon_end must not be above learning.epsilon_start, "
            f"got {learning.epsilon_end:g} and {learning.epsilon_start:g}"
        )
    check_name("learning.loss", learning.loss, ("squared", "huber"))
    check_name("learning.learning_rate_schedule", learning.learning_rate_schedule, ("inverse_time", "linear"))
    check_name("learning.epsilon_schedule", learning.epsilon_schedule, ("exponential", "linear"))
    check_name("learning.keep", learning.keep, ("last", "best"))
