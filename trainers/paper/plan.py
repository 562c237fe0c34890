"""The plan of a reproduction: what is trained, with which seeds, and what is tested where."""

from __future__ import annotations

import dataclasses
import functools
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from swarm.physics.world import World
from trainers.paper.statements import EGG, RECORDS, STEADY, VARYING, VORTICES
from trainers.settings.composition import settings_from
from trainers.settings.learning import DQNSettings
from trainers.settings.schema import Settings

AWARE, BLIND = "taylor_green_aware", "taylor_green_blind"
EXPERIMENTS = (*RECORDS, VARYING, EGG, AWARE, BLIND)
# the world of a test, and which trainings are tested in it, by what figures call them
TESTS = {name: {"dqn": name} for name in (*RECORDS, VARYING, EGG)}
TESTS[VORTICES] = {"aware": AWARE, "blind": BLIND, "still": STEADY}
RUNS = "runs"


@dataclass(frozen=True)
class Plan:
    """What decides a reproduction."""

    quick: bool = False  # test the shipped policies instead of training
    recipes: tuple[str, ...] = ("swarm", "paper")
    n_seeds: int = 5  # training seeds of each experiment: 0, 1, …
    cells: int = 400  # of a test; none of them was ever seen in training or validation
    radial_cells: int = 100  # of the test around the egg
    swinging_cells: int = 40  # whose circles are fitted
    figure_cells: int = 40  # in figures: the first of the test's
    radial_figure_cells: int = 9
    radial_reach: float = 30.0  # they start in a square around the egg, so far to each side [length]
    seed: int = 100  # of the test population and the bootstrap
    words: tuple[str, ...] = ()  # settings of every training that differ from its recipe's
    experiments: tuple[str, ...] = EXPERIMENTS
    workers: int = dataclasses.field(default_factory=lambda: min(2, os.cpu_count() or 1))  # processes at once

    def settings(self, recipe: str, experiment: str) -> Settings:
        """Settings of a training."""
        words = (f"recipe={recipe}", f"experiment={experiment}", f"n_seeds={self.n_seeds}")
        return _composed(*words, "tensorboard=false", *self.words)

    def test_world(self, test: str) -> World:
        """The world of a test; it is the same under every recipe."""
        experiment = next(iter(TESTS[test].values()))
        world = self.settings(self.recipes[0], experiment).test_world()
        if world.egg is None:
            return world
        (x, y), _ = world.egg
        reach = self.radial_reach
        return world.replace(start_box=((x - reach, x + reach), (y - reach, y + reach)))


_composed = functools.lru_cache(maxsize=64)(lambda *words: settings_from(words))  # Hydra takes its time


class Training(NamedTuple):
    """One stack of seeds to train; `radial` shares the run of `varying_speed` where nothing differs."""

    recipe: str
    experiment: str
    settings: Settings
    folder: Path


def trainings(plan: Plan, out: Path) -> list[Training]:
    """Every training of the plan; raises SettingsError."""
    found: list[Training] = []
    for recipe in plan.recipes:
        for experiment in plan.experiments:
            settings = plan.settings(recipe, experiment)
            same = learnt(settings, shared=True)
            alike = [each.folder for each in found if learnt(each.settings, shared=True) == same]
            folder = alike[0] if alike else out / RUNS / recipe / experiment
            found.append(Training(recipe, experiment, settings, folder))
    return found


def learnt(settings: Settings, *, shared: bool = False) -> dict[str, Any]:
    """What decides the policies that come out; `shared`: whatever the experiment is called."""
    left_out = {"evaluation", "evaluate", "checkpoint_every", "tensorboard", "wandb"}
    left_out |= {"experiment"} if shared else set()
    return {name: value for name, value in dataclasses.asdict(settings).items() if name not in left_out}


def expected_seconds(settings: Settings) -> float:
    """Roughly what a training takes on one core: the costs of decisions and updates were measured once."""
    learning, world, seeds = settings.learning, settings.training_world(), settings.n_seeds

    def decision(cells: int) -> float:
        return 1.6e-4 + (8e-7 if world.in_flow else 3e-7) * cells * seeds

    assert isinstance(learning, DQNSettings)
    checked = settings.validation
    validations = learning.epochs / checked.every
    rounds = world.max_decisions / (learning.collect or world.max_decisions)
    nodes = sum(learning.hidden)
    update = 3e-4 + 2.5e-8 * learning.batch_size * seeds * nodes
    epoch = world.max_decisions * decision(learning.n_swimmers * learning.n_worlds)
    epoch += rounds * learning.updates * update
    return learning.epochs * epoch + validations * world.replace(life=checked.life).max_decisions * decision(
        checked.cells
    )
