"""The file of a study: settings that vary, seeds and tests, and what follows from them."""

import dataclasses
import itertools
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from pydantic import TypeAdapter, ValidationError, field_validator
from pydantic.dataclasses import dataclass

from swarm._support import files
from swarm.physics.world import World
from swarm.policies.policy import AnyPolicy
from swarm.population.evaluation import named_policy
from swarm.population.results import RIVAL
from trainers.jobs.study_figure import AXES, VARIABLES, Request, request_of
from trainers.settings.composition import (
    SettingsError,
    by_value,
    checked,
    key_of,
    line_of,
    settings_from,
    written,
)
from trainers.settings.learning import RULES, Count, Positive, Whole
from trainers.settings.schema import Settings, dotted, unknown
from trainers.training.run_folder import MAX_TEXT, plain_yaml

NAME = r"[\w.+-]{1,80}"
AFTER = ("seed", "n_seeds", "evaluation", "evaluate", "checkpoint_every", "tensorboard", "wandb")
SIZES = ("cells", "worlds", "seed")  # of a test
Value = str | int | float
Choice = tuple[Value, dict[str, Any]]  # a label of an axis, and its settings


@dataclass(config=RULES, frozen=True, kw_only=True)
class TestSettings:
    """One test of every policy; what is left out is as in the run's `evaluation`."""

    world: dict[str, Any] = dataclasses.field(default_factory=dict)  # parameters that differ from the run's
    cells: Count | None = None
    worlds: Count | None = None
    life: Positive | None = None  # t_life [time]
    seed: Whole | None = None


@dataclass(config=RULES, frozen=True, kw_only=True)
class StudySettings:
    """What a study's file says."""

    settings: dict[str, Any] = dataclasses.field(
        default_factory=dict
    )  # of every run, as `swarm train` has them
    # axis: the values of the key that it is named by, or of each of its labels the settings
    grid: dict[str, Any] = dataclasses.field(default_factory=dict)
    seeds: Any = 1  # so many, from 0, or a list of them
    stack: Count = 16  # seeds in a row that are trained in one run at most
    tests: dict[str, TestSettings] = dataclasses.field(default_factory=lambda: {"own": TestSettings()})
    policies: list[str] = dataclasses.field(default_factory=list)  # tested beside greedy
    figures: list[str] = dataclasses.field(default_factory=list)  # STATISTIC:AXIS[:AXIS=VALUE,...]

    @field_validator("grid")
    @classmethod
    def _axes(cls, given: dict[str, Any]) -> dict[str, Any]:
        for name, values in given.items():
            _check_axis(name, values)
        return given

    @field_validator("settings")
    @classmethod
    def _no_seeds(cls, given: dict[str, Any]) -> dict[str, Any]:
        for key in given:
            _check_no_seed("settings", key)
        return given

    @field_validator("seeds", mode="before")
    @classmethod
    def _listed(cls, given: Any) -> list[int]:
        whole = [each for each in given if type(each) is int and each >= 0] if isinstance(given, list) else []
        if type(given) is int and 1 <= given <= 10**6:
            return list(range(given))
        if not whole or whole != given or len(set(whole)) < len(whole):
            raise ValueError(f"seeds must be how many, or a list of different ones, got {str(given)[:200]}")
        return sorted(whole)

    @field_validator("tests", mode="before")
    @classmethod
    def _named(cls, given: Any) -> Any:
        if not isinstance(given, dict) or not given:
            raise ValueError(f"tests must be named, each with what differs from the run's own, got {given!r}")
        for name in given:
            if not isinstance(name, str) or not re.fullmatch(NAME, name):
                raise ValueError(f"tests must be named by letters, digits and . + - _, got {name!r}")
        return {name: {} if test is None else test for name, test in given.items()}


class Point(NamedTuple):
    """A place of the grid."""

    labels: tuple[Value, ...]  # of each axis
    settings: Settings  # of its first seed
    tests: dict[str, tuple[World, dict[str, int]]]  # the world with its life; cells, worlds, seed
    references: dict[str, dict[str, AnyPolicy]]  # of each test, by name

    @property
    def learnt(self) -> str:
        """What tells its trainings from others."""
        return learnt(self.settings)


class Plan(NamedTuple):
    """What a study's file asks for."""

    text: str
    axes: dict[str, list[Value]]
    seeds: list[int]
    stack: int
    points: list[Point]
    tests: list[str]
    references: list[str]
    figures: list[Request]


def plan_of(file: Path, figures: Sequence[str] = ()) -> Plan:
    """What a study's file asks for, and further figures, all of it checked; raises SettingsError,
    PolicyError, ValueError or OSError.
    """
    text = files.read_bytes(file, at_most=MAX_TEXT).decode(errors="replace")
    try:
        values = plain_yaml(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise SettingsError(f"{file} must be YAML: {' '.join(str(error).split())}") from None
    study = _checked(values, file)
    choices = {name: choices_of(name, each) for name, each in study.grid.items()}
    axes = {name: [label for label, _ in each] for name, each in choices.items()}
    references = list(dict.fromkeys([RIVAL, *study.policies]))
    points = [_point(study, chosen, references) for chosen in itertools.product(*choices.values())]
    known = axes | {"seed": study.seeds, "test": list(study.tests)}
    requests = [request_of(each, known) for each in (*study.figures, *figures)]
    return Plan(text, axes, study.seeds, study.stack, points, list(study.tests), references, requests)


def _checked(values: Any, file: Path) -> StudySettings:
    if not isinstance(values, dict):
        raise SettingsError(f"{file} must hold keys and values, got {str(values)[:200]!r}")
    try:
        return TypeAdapter(StudySettings).validate_python(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        *outer, key = first["loc"]
        if first["type"] == "unexpected_keyword_argument":
            kind, have = (TestSettings, "tests have") if outer else (StudySettings, "studies have")
            known = [each.name for each in dataclasses.fields(kind)]
            raise SettingsError(unknown(str(key), known, f"{file}: {have}")) from None
        raise SettingsError(f"{file}: {line_of(error, values)}") from None


def _check_axis(name: Any, values: Any) -> None:
    """Raises ValueError unless an axis of the grid may be called so and have these values."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z_][\w.]*", name):
        raise ValueError(f"grid must have axes named by letters, digits, dots and _, got {name!r}")
    if name.removeprefix("reference_") in (taken := (*AXES, *VARIABLES)):
        raise ValueError(f"grid must have axes of other names than {', '.join(taken)}, got {name}")
    choices = choices_of(name, values) if isinstance(values, list | dict) else []
    if not choices or not all(isinstance(settings, dict) for _, settings in choices):
        rule = "a list of values, or of each label the settings"
        raise ValueError(f"grid.{name} must be {rule}, got {str(values)[:200]!r}")
    labels = [label for label, _ in choices]
    if len(set(labels)) < len(labels):
        raise ValueError(f"grid.{name} must hold every value once, got {', '.join(map(str, labels))}")
    for key in itertools.chain(*(settings for _, settings in choices)):
        _check_no_seed(f"grid.{name}", key)


def _check_no_seed(where: str, key: Any) -> None:
    if key in ("seed", "n_seeds"):
        raise ValueError(f"{where} must leave seeds to the key seeds, got {key}")


def choices_of(name: str, values: Any) -> list[Choice]:
    """Every label of an axis and its settings."""
    settings = values.items() if isinstance(values, dict) else ((each, {name: each}) for each in values)
    return [
        (each if isinstance(each, Value) and not isinstance(each, bool) else written(each), chosen)
        for each, chosen in settings
    ]


def _point(study: StudySettings, chosen: Sequence[Choice], references: Sequence[str]) -> Point:
    keys = dotted(study.settings)
    for _, changes in chosen:
        keys |= dotted(changes)
    words = [f"{key}={written(value)}" for key, value in keys.items()]
    for word in words:
        key_of(word)
    settings = settings_from([*words, f"seed={study.seeds[0]}"])
    tests, rivals = {}, {}
    for name, test in study.tests.items():
        tests[name] = tested_in(settings, name, test)
        rivals[name] = {each: named_policy(each, tests[name][0]) for each in references}
    return Point(tuple(label for label, _ in chosen), settings, tests, rivals)


def tested_in(settings: Settings, name: str, test: TestSettings) -> tuple[World, dict[str, int]]:
    """The world of a test and its sizes; raises SettingsError unless the run's policies can steer there."""
    given = {key: value for key, value in dataclasses.asdict(test).items() if value is not None}
    own = dataclasses.asdict(settings.evaluation) | {key: given[key] for key in given if key != "world"}
    own |= {"field": None} if "field" in test.world else {}
    changed = {"world": settings.world | test.world, "evaluation": own}
    world = checked(dataclasses.asdict(settings) | changed, f"tests.{name}: ").test_world()
    learnt_in = settings.training_world()
    shape, found = ((each.observation_size, each.n_actions) for each in (learnt_in, world))
    if shape != found:
        raise SettingsError(
            f"tests.{name}.world must leave policies their {shape[0]} inputs and {shape[1]} actions, "
            f"got {found[0]} and {found[1]}"
        )
    return world, {each: own[each] for each in SIZES}


def learnt(settings: Settings) -> str:
    """All that decides a training but its seeds."""
    told = by_value(settings)
    return json.dumps({key: told[key] for key in sorted(told) if key.split(".")[0] not in AFTER}, default=str)


def stacks(seeds: Sequence[int], most: int) -> list[tuple[int, int]]:
    """Seeds in rows, so many in each at most: the first of each row, and how many."""
    found: list[tuple[int, int]] = []
    for seed in sorted(seeds):
        first, count = found[-1] if found else (seed, most)
        if count < most and seed == first + count:
            found[-1] = first, count + 1
        else:
            found.append((seed, 1))
    return found


def name_of(axes: Mapping[str, Any], point: Point, first: int, count: int) -> str:
    """What a run's folder is called."""
    parts = [f"{axis}={label}" for axis, label in zip(axes, point.labels, strict=True)]
    parts.append(f"seed={first}" if count == 1 else f"seeds={first}-{first + count - 1}")
    return re.sub(r"[^\w.,=+-]", "_", ",".join(parts))
