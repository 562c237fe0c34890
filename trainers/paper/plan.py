"""The plan of a reproduction: what is trained, with which seeds, and what is tested where."""

import dataclasses
import functools
import itertools
import os
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from swarm.physics.world import World
from trainers.jobs.cluster import launched
from trainers.jobs.executors import executor_for
from trainers.settings.composition import SettingsError, settings_from, settings_from_stored
from trainers.settings.schema import Settings
from trainers.training.run_folder import RunError, RunFolder

DECIDED = ("recipe", "algorithm")  # by the plan, not by words
RECORDS = {"linear_n2": 2, "linear_n4": 4, "linear_n8": 8}  # N_T of the cases with one speed
STEADY, VARYING, EGG, VORTICES = "linear_n4", "varying_speed", "radial", "taylor_green"
AWARE, BLIND = "taylor_green_aware", "taylor_green_blind"
EXPERIMENTS = (*RECORDS, VARYING, EGG, AWARE, BLIND)
# the world of a test, and which trainings are tested in it, by what figures call them
TESTS = {name: {"dqn": name} for name in (*RECORDS, VARYING, EGG)}
TESTS[VORTICES] = {"aware": AWARE, "blind": BLIND, "still": STEADY}
RUNS = "runs"


@dataclass(frozen=True)
class TrainingPlan:
    """What decides the trainings of a reproduction."""

    quick: bool = False  # test the shipped policies instead of training
    recipes: tuple[str, ...] = ("swarm", "paper")
    n_seeds: int = 20  # training seeds of each experiment: 0, 1, …
    words: tuple[str, ...] = ()  # settings of every training that differ from its recipe's
    experiments: tuple[str, ...] = EXPERIMENTS
    # processes at once; None: as `launched` says
    workers: int | None = dataclasses.field(default_factory=lambda: min(2, os.cpu_count() or 1))
    launcher: str | None = None
    address: str | None = None  # of a Ray cluster

    def executor(self, *, on_disk: bool = False) -> Executor:
        """What does the tasks; those that write files stay on this machine."""
        if self.launcher is None or (on_disk and self.launcher == "ray"):
            return executor_for(1 if self.workers is None else self.workers)
        return launched(self.launcher, self.workers, self.address)

    def recorded(self) -> dict[str, Any]:
        """All that numbers depend on, as plain data."""
        told = dataclasses.asdict(self)
        return {name: told[name] for name in told if name not in ("workers", "launcher", "address")}

    def chosen(self, experiment: str) -> tuple[str, ...]:
        """The words that choose an experiment."""
        return (f"experiment={experiment}",)

    def settings(self, recipe: str, experiment: str) -> Settings:
        """Settings of an experiment's trainings, of its first seed; raises SettingsError."""
        for word in self.words:  # else tables would name what was not trained
            if word.lstrip("+~").partition("=")[0] in DECIDED:
                raise SettingsError(f"{' and '.join(DECIDED)} are the plan's to choose, got {word!r}")
        return _composed(f"recipe={recipe}", *self.chosen(experiment), "tensorboard=false", *self.words)


@dataclass(frozen=True)
class Plan(TrainingPlan):
    """What decides a reproduction of the paper."""

    cells: int = 400  # of a test; none of them was ever seen in training or validation
    radial_cells: int = 100  # of the test around the egg
    swinging_cells: int = 40  # whose circles are fitted
    figure_cells: int = 40  # in figures: the first of the test's
    radial_figure_cells: int = 9
    radial_reach: float = 30.0  # they start in a square around the egg, so far to each side [length]
    seed: int = 100  # of the test population

    def test_world(self, test: str) -> World:
        """The world of a test; it is the same under every recipe."""
        experiment = next(iter(TESTS[test].values()))
        return around_egg(self.settings(self.recipes[0], experiment).test_world(), self.radial_reach)


def around_egg(world: World, reach: float) -> World:
    """Where there is an egg, the world whose cells start in a square around it, `reach` to each side."""
    if world.egg is None:
        return world
    (x, y), _ = world.egg
    return world.replace(start_box=((x - reach, x + reach), (y - reach, y + reach)))


_composed = functools.lru_cache(maxsize=64)(lambda *words: settings_from(words))  # Hydra takes its time


class Training(NamedTuple):
    """One stack of seeds to train; `radial` shares the run of `varying_speed` where nothing differs."""

    recipe: str
    experiment: str
    settings: Settings
    folder: Path

    @property
    def run(self) -> str:
        """Its run within the folder of runs."""
        return f"{self.folder.parent.name}/{self.folder.name}"

    @property
    def decisions(self) -> float:
        """Decisions of one cell of every seed: roughly in their ratio trainings take their time."""
        settings = self.settings
        return float(settings.learning.epochs * settings.training_world().max_decisions * settings.n_seeds)


def trainings(plan: TrainingPlan, out: Path) -> list[Training]:
    """Every training of the plan; raises SettingsError.

    Seeds are added to those of an earlier reproduction: a second run, FOLDER-from-5, trains those from 5 on.
    """
    found: list[Training] = []
    for recipe, experiment in itertools.product(plan.recipes, plan.experiments):
        whole, first = plan.settings(recipe, experiment), 0
        alike = (each.experiment for each in found if learnt(each.settings) == learnt(whole))
        base = out / RUNS / recipe / next(alike, experiment)
        while first < plan.n_seeds:
            folder = base.with_name(f"{base.name}-from-{first}") if first else base
            wanted = plan.n_seeds - first
            count = min(_seeds_of(folder) or wanted, wanted)
            settings = dataclasses.replace(whole, seed=first, n_seeds=count)
            found.append(Training(recipe, experiment, settings, folder))
            first += count
    return found


def _seeds_of(folder: Path) -> int:
    """How many seeds a run that is there has trained; 0 where there is none that can be read."""
    try:
        return settings_from_stored(RunFolder.open(folder)[1]).n_seeds
    except (RunError, SettingsError):
        return 0


def learnt(settings: Settings, *, seeds: bool = False) -> dict[str, Any]:
    """What decides the policies that come out, whatever the experiment is called; also its `seeds`."""
    left_out = {"experiment", "evaluation", "evaluate", "checkpoint_every", "tensorboard", "wandb"}
    left_out |= set() if seeds else {"seed", "n_seeds"}
    return {name: value for name, value in dataclasses.asdict(settings).items() if name not in left_out}
