"""Typed settings of a training run, checked when they are made; the defaults are the paper's numbers."""

import dataclasses
import difflib
import functools
import itertools
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, Literal, Self

import yaml
from pydantic import Field, TypeAdapter, ValidationInfo, field_validator, model_validator
from pydantic.dataclasses import dataclass

from swarm._support.checks import check_name
from swarm.physics.world import World
from swarm.physics.world.rules import PARTS, as_data
from swarm.policies.policy_file import MAX_FILE, MAX_HEADER, MAX_LAYERS, MAX_WIDTH
from trainers.settings.learning import ALGORITHMS, RULES, Count, Flag, LearningSettings, Positive, Whole

SECTIONS = ("world", "learning", "validation", "evaluation")
CELLS = 40  # of a population whose cells are independent
MAX_PLACE = 1e5  # [length] of a start, where float32 tells places 0.008 apart


# Where it is left out: the crowd that was trained in where cells share their world, else `CELLS`.
_CROWD: Any = Field(default=None, validate_default=False)


@dataclass(config=RULES, frozen=True, kw_only=True)
class ValidationSettings:
    """The population on which the greedy policy is tested during training; its starts are never trained or
    tested on.
    """

    cells: Count = _CROWD  # in each world
    worlds: Count = 1
    life: Positive = 200.0  # t_life [time]
    every: Count = 20  # epochs


@dataclass(config=RULES, frozen=True, kw_only=True)
class EvaluationSettings:
    """The test after training, on fresh cells."""

    field: Any = None  # the field of the test where it differs from training, as `world.field`
    cells: Count = _CROWD  # in each world
    worlds: Count = 1
    life: Positive = 200.0  # t_life in tests, paper table 1
    seed: Whole = 0


@dataclass(config=RULES, frozen=True, kw_only=True)
class Settings:
    """Everything that decides a run, but for where its folder is."""

    experiment: str = "linear_n4"
    recipe: str = "paper"
    algorithm: str = "dqn"  # one of `ALGORITHMS`
    seed: Whole = 0
    n_seeds: Count = 1  # independent seeds trained at once: seed, seed + 1, …
    # parameters of `swarm.World`, by its names and with its defaults; a field, flow, sensor or reward is a
    # name or {type: name, parameter: value, …}
    world: dict[str, Any] = dataclasses.field(default_factory=dict)
    learning: LearningSettings = dataclasses.field(default_factory=dict)  # type: ignore[assignment]
    validation: ValidationSettings = dataclasses.field(default_factory=ValidationSettings)
    evaluation: EvaluationSettings = dataclasses.field(default_factory=EvaluationSettings)
    evaluate: Flag = False  # test the kept policy when training ends
    checkpoint_every: Count = 10  # epochs
    device: str = "cpu"
    threads: Annotated[Count, Field(le=1024)] = 1  # of torch
    compile: Literal["never", "always", "auto"] = "auto"  # "auto": when the run is long enough to gain
    tensorboard: Flag = True
    wandb: Flag = False

    @field_validator("algorithm")
    @classmethod
    def _known(cls, given: str) -> str:
        kind = ALGORITHMS[check_name("algorithm", given, ALGORITHMS)]
        if not issubclass(kind, LearningSettings):
            raise ValueError(f"algorithm {given!r} must be registered by LearningSettings, got {kind!r}")
        return given

    @field_validator("learning", mode="before")
    @classmethod
    def _of_the_algorithm(cls, given: Any, info: ValidationInfo) -> Any:
        wanted = ALGORITHMS[info.data.get("algorithm", "dqn")]
        return TypeAdapter(wanted).validate_python(given)

    @model_validator(mode="after")
    def _check(self) -> Self:
        """Raises ValueError naming the key, the rule and the value."""
        for name in ("experiment", "recipe"):
            if not getattr(self, name).isprintable():
                raise ValueError(f"{name} must be printable text, got {getattr(self, name)!r}")
        if not re.fullmatch(r"cpu|mps|(cuda|xpu)(:\d+)?", self.device):
            raise ValueError(f"device must be cpu, mps, cuda or cuda:N, got {self.device!r}")
        object.__setattr__(self, "world", _completed(self.world))
        with _naming("validation"):
            self.training_world().replace(life=self.validation.life)
        with _naming("evaluation"):
            field = _plain("field", self.evaluation.field, self.test_world().field)
        cells = self.learning.n_swimmers if self.training_world().is_shared else CELLS
        for name, changes in (("validation", {}), ("evaluation", {"field": field})):
            section = getattr(self, name)
            changes = changes | ({"cells": cells} if section.cells is None else {})
            object.__setattr__(self, name, dataclasses.replace(section, **changes))
        _check_network(self.layers)
        self._check_spread()
        return self

    def _check_spread(self) -> None:
        """Raises ValueError where decisions cannot be collected block by block."""
        learning = self.learning
        if 0 < learning.block < learning.n_swimmers and (
            self.training_world().is_shared or learning.sees_worlds
        ):
            raise ValueError(
                f"learning.block must be at least the {learning.n_swimmers} cells of a world, whose cells "
                f"share it here, got {learning.block}"
            )
        if learning.staleness and not (learning.block and learning.collect):
            raise ValueError(
                f"learning.staleness must go with a learning.block and a learning.collect above 0, got "
                f"{learning.staleness} with {learning.block} and {learning.collect}"
            )

    @property
    def seeds(self) -> list[int]:
        """The seeds trained at once."""
        return list(range(self.seed, self.seed + self.n_seeds))

    @property
    def layers(self) -> tuple[int, ...]:
        """Sizes of the policy's layers, from inputs to outputs."""
        world = self.training_world()
        outputs = 2 if world.is_continuous else world.n_actions  # middle and spread, or a value of each
        return (world.observation_size, *self.learning.hidden, outputs)

    def training_world(self) -> World:
        """The world to learn in."""
        return _world(json.dumps(self.world))

    def test_world(self) -> World:
        """The world to be tested in, with the test's life."""
        field, life = self.evaluation.field, self.evaluation.life
        return self.training_world().replace(life=life, **({} if field is None else {"field": field}))

    def identity(self) -> dict[str, Any]:
        """All that decides a run: where its data lie does not, their checksums do."""
        told = dataclasses.asdict(self)
        for part in (*told["world"].values(), told["evaluation"]["field"]):
            if isinstance(part, dict) and part.get("sha256"):
                part.pop("path", None)
        return told

    def dotted(self) -> dict[str, Any]:
        """Every key, as it is written in words, and its value; of data their checksum."""
        return dotted(self.identity())

    def as_yaml(self) -> str:
        """As they are shown, and stored in a run's folder."""
        return yaml.safe_dump(dataclasses.asdict(self), sort_keys=False)


def completed(stored: Mapping[str, Any]) -> dict[str, Any]:
    """What `identity` said in an earlier version; settings that have come since are at their defaults."""
    if not isinstance(name := stored.get("algorithm"), str) or name not in ALGORITHMS:
        return dict(stored)
    defaults = Settings(algorithm=name).identity()
    given = {key: stored[key] for key in SECTIONS if isinstance(stored.get(key), Mapping)}
    return defaults | dict(stored) | {key: defaults[key] | each for key, each in given.items()}


def dotted(given: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by their own keys: those of a section one by one."""
    found: dict[str, Any] = {}
    for key, value in given.items():
        inner = key in SECTIONS and isinstance(value, Mapping)
        found |= {f"{key}.{name}": each for name, each in value.items()} if inner else {key: value}
    return found


@functools.lru_cache(maxsize=8)
def _world(text: str) -> World:
    """The world of these parameters, made once: its data are known by their checksum, and take a while."""
    return World(**json.loads(text))


def unknown(key: str, known: Iterable[str], what: str = "settings have") -> str:
    """What is said of a key that settings do not have."""
    near = difflib.get_close_matches(key, list(known), n=1, cutoff=0.4)
    return f"{what} no key {key!r}" + (f"; did you mean {near[0]!r}?" if near else "")


def _completed(given: dict[str, Any]) -> dict[str, Any]:
    """All parameters of the world that some of them describe, as plain data; raises ValueError."""
    names = World.defaults()
    for name in given:
        if name not in names:
            raise ValueError(unknown(f"world.{name}", [f"world.{each}" for each in names]))
    with _naming("world"):
        world = World(**given)
        for number in itertools.chain(*(world.start_box or ())):
            if abs(number) > MAX_PLACE:
                raise ValueError(
                    f"start_box must lie within ±{MAX_PLACE:g}, beyond which float32 is too coarse, "
                    f"got {number:g}"
                )
        return {name: _plain(name, given.get(name, names[name]), getattr(world, name)) for name in names}


def _plain(name: str, given: Any, held: Any) -> Any:
    """A parameter of a world as plain data: a part with parameters with all of them, pairs as lists."""
    if name in PARTS:
        if not isinstance(given, (str, dict, type(None))):
            raise ValueError(f"{name} must be a name or keys and values, got {given!r}")
        return PARTS[name].describe(held) or given if isinstance(given, dict) else given
    return as_data(name, held)


@contextmanager
def _naming(section: str) -> Iterator[None]:
    """Within, an error says in which section the key is."""
    try:
        yield
    except (TypeError, ValueError, OSError) as error:
        known = str(error).split(" ")[0] in World.defaults()
        raise ValueError(f"{section}{'.' if known else ': '}{error}") from None


def _check_network(sizes: Sequence[int]) -> None:
    """Raises ValueError where the network of these layers would not fit into a policy file."""
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
