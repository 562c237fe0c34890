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
from trainers.jobs.study_figure import Request, check_axis_name, request_of
from trainers.settings.composition import (
    SettingsError,
    by_value,
    checked,
    key_of,
    line_of,
    settings_from,
)
from trainers.settings.learning import RULES, Count, Positive, Whole
from trainers.settings.schema import Settings, unknown
from trainers.training.run_folder import MAX_TEXT, plain_yaml

NAME = r"[\w.+-]{1,80}"
AFTER = ("seed", "n_seeds", "evaluation", "evaluate", "checkpoint_every", "tensorboard", "wandb")
SECTIONS = ("world", "learning", "validation", "evaluation")
Value = str | int | float


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
            check_axis_name(name)
            several = isinstance(values, list | dict) and len(values) > 0
            if not several or (
                isinstance(values, dict) and not all(isinstance(each, dict) for each in values.values())
            ):
                rule = "a list of values, or of each label the settings"
                raise ValueError(f"grid.{name} must be {rule}, got {str(values)[:200]!r}")
            labels = labels_of(values)
            if len(set(labels)) < len(labels):
                raise ValueError(f"grid.{name} must hold every value once, got {', '.join(map(str, labels))}")
            for key in itertools.chain(
                [name] if isinstance(values, list) else [],
                *(values.values() if isinstance(values, dict) else []),
            ):
                _check_no_seed(f"grid.{name}", key)
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


def plan_of(file: Path) -> Plan:
    """What a study's file asks for, all of it checked; raises SettingsError, PolicyError or OSError."""
    text = files.read_bytes(file, at_most=MAX_TEXT).decode(errors="replace")
    try:
        values = plain_yaml(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise SettingsError(f"{file} must be YAML: {' '.join(str(error).split())}") from None
    study = _checked(values, file)
    axes = {name: labels_of(each) for name, each in study.grid.items()}
    references = list(dict.fromkeys([RIVAL, *study.policies]))
    points = [
        _point(study, chosen, references) for chosen in itertools.product(*map(_choices, study.grid.items()))
    ]
    known = axes | {"seed": study.seeds, "test": list(study.tests)}
    figures = [request_of(each, known) for each in study.figures]
    return Plan(text, axes, study.seeds, study.stack, points, list(study.tests), references, figures)


def _checked(values: Any, file: Path) -> StudySettings:
    if not isinstance(values, dict):
        raise SettingsError(f"{file} must hold keys and values, got {str(values)[:200]!r}")
    try:
        return TypeAdapter(StudySettings).validate_python(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        if first["type"] == "unexpected_keyword_argument":
            kind = StudySettings if len(first["loc"]) == 1 else TestSettings
            known = [each.name for each in dataclasses.fields(kind)]
            what = f"{file}: {'studies have' if len(first['loc']) == 1 else 'tests have'}"
            raise SettingsError(unknown(str(first["loc"][-1]), known, what)) from None
        raise SettingsError(f"{file}: {line_of(error, values)}") from None


def _check_no_seed(where: str, key: Any) -> None:
    if key in ("seed", "n_seeds"):
        raise ValueError(f"{where} must leave seeds to the key seeds, got {key}")


def labels_of(values: Any) -> list[Value]:
    """What the values of an axis are called."""
    return [
        each if isinstance(each, str | int | float) and not isinstance(each, bool) else _written(each)
        for each in values
    ]


Choice = tuple[Value, dict[str, Any]]


def _choices(axis: tuple[str, Any]) -> list[Choice]:
    """Every label of an axis and its settings."""
    name, values = axis
    labels = labels_of(values)
    if isinstance(values, dict):
        return list(zip(labels, values.values(), strict=True))
    return [(label, {name: value}) for label, value in zip(labels, values, strict=True)]


def _point(study: StudySettings, chosen: Sequence[Choice], references: Sequence[str]) -> Point:
    keys = _dotted(study.settings)
    for _, changes in chosen:
        keys |= _dotted(changes)
    words = [f"{key}={_written(value)}" for key, value in keys.items()]
    for word in words:
        key_of(word)
    settings = settings_from([*words, f"seed={study.seeds[0]}"])
    tests, rivals = {}, {}
    for name, test in study.tests.items():
        tests[name] = tested_in(settings, name, test)
        rivals[name] = {each: named_policy(each, tests[name][0]) for each in references}
    return Point(tuple(label for label, _ in chosen), settings, tests, rivals)


def _dotted(given: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by their own keys, so that a section leaves what it does not name as it was."""
    return {
        f"{key}.{name}" if parts is value else key: each
        for key, value in given.items()
        for parts in [value if key in SECTIONS and isinstance(value, dict) else {"": value}]
        for name, each in parts.items()
    }


def tested_in(settings: Settings, name: str, test: TestSettings) -> tuple[World, dict[str, int]]:
    """The world of a test and its sizes; raises SettingsError unless the run's policies can steer there."""
    own = dataclasses.asdict(settings.evaluation)
    sizes = {each: getattr(test, each) for each in ("cells", "worlds", "seed")}
    sizes = {each: own[each] if size is None else size for each, size in sizes.items()}
    own |= {} if test.life is None else {"life": test.life}
    own |= {"field": None} if "field" in test.world else {}
    changed = {"world": settings.world | test.world, "evaluation": own}
    world = checked(dataclasses.asdict(settings) | changed, f"tests.{name}: ").test_world()
    learnt_in = settings.training_world()
    shape, given = ((each.observation_size, each.n_actions) for each in (learnt_in, world))
    if shape != given:
        raise SettingsError(
            f"tests.{name}.world must leave policies their {shape[0]} inputs and {shape[1]} actions, "
            f"got {given[0]} and {given[1]}"
        )
    return world, sizes


def learnt(settings: Settings) -> str:
    """All that decides a training but its seeds."""
    told = by_value(settings)
    return json.dumps({key: told[key] for key in sorted(told) if key.split(".")[0] not in AFTER}, default=str)


def _written(value: Any) -> str:
    """A value of YAML as it is written in a word."""
    match value:
        case None | bool():
            return json.dumps(value)
        case dict():
            return "{" + ", ".join(f"{key}: {_written(each)}" for key, each in value.items()) + "}"
        case list():
            return "[" + ", ".join(map(_written, value)) + "]"
        case str():
            return value if re.fullmatch(r"[A-Za-z_][\w.]*", value) else json.dumps(value, ensure_ascii=False)
    return str(value)


def stacks(seeds: Sequence[int], most: int) -> list[tuple[int, int]]:
    """Seeds in rows, so many in each at most: the first of each row, and how many."""
    found: list[tuple[int, int]] = []
    for seed in sorted(seeds):
        first, count = found[-1] if found else (-1, 0)
        if count and seed == first + count and count < most:
            found[-1] = first, count + 1
        else:
            found.append((seed, 1))
    return found


def name_of(axes: Mapping[str, Any], point: Point, first: int, count: int) -> str:
    """What a run's folder is called."""
    parts = [f"{axis}={label}" for axis, label in zip(axes, point.labels, strict=True)]
    parts.append(f"seed={first}" if count == 1 else f"seeds={first}-{first + count - 1}")
    return re.sub(r"[^\w.,=+-]", "_", ",".join(parts))
