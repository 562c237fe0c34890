"""The plan of a study: what is trained, with which seeds, and where its runs lie."""

import dataclasses
import functools
import itertools
import os
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from swarm.physics.world import World
from trainers.jobs.cluster import launched
from trainers.jobs.executors import executor_for
from trainers.settings.composition import SettingsError, settings_from, settings_from_stored
from trainers.settings.schema import Settings
from trainers.training.run_folder import TIMINGS, RunError, RunFolder

RUNS = "runs"


@dataclass(frozen=True)
class TrainingPlan:
    """What decides the trainings of a study."""

    DECIDED: ClassVar[tuple[str, ...]] = ("recipe", "algorithm", "seed", "n_seeds")  # no words of users

    quick: bool = False  # test the shipped policies instead of training
    recipes: tuple[str, ...] = ("swarm",)
    n_seeds: int = 5  # training seeds of each experiment: 0, 1, …
    words: tuple[str, ...] = ()  # settings of every training that differ from its recipe's
    experiments: tuple[str, ...] = ()
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
            if word.lstrip("+~").partition("=")[0] in self.DECIDED:
                *others, last = self.DECIDED
                raise SettingsError(f"{', '.join(others)} and {last} are the plan's to choose, got {word!r}")
        return _composed(f"recipe={recipe}", *self.chosen(experiment), "tensorboard=false", *self.words)

    def world(self, experiment: str) -> World:
        """The world of an experiment's test, with its life; it is the same under every recipe."""
        return self.settings(self.recipes[0], experiment).test_world()


_composed = functools.lru_cache(maxsize=64)(lambda *words: settings_from(words))  # Hydra takes its time


def around_egg(world: World, reach: float) -> World:
    """Where there is an egg, the world whose cells start in a square around it, `reach` to each side."""
    if world.egg is None:
        return world
    (x, y), _ = world.egg
    return world.replace(start_box=((x - reach, x + reach), (y - reach, y + reach)))


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
    def name(self) -> str:
        """The experiment, and from which seed on it is trained where that is not the first."""
        return self.experiment + (f"-from-{self.settings.seed}" if self.settings.seed else "")

    @property
    def decisions(self) -> float:
        """Decisions of one cell of every seed: roughly in their ratio trainings take their time."""
        settings = self.settings
        return float(settings.learning.epochs * settings.training_world().max_decisions * settings.n_seeds)

    @property
    def minutes(self) -> float:
        """How long all seeds at once took."""
        return sum(float(row["seconds"]) for row in RunFolder(self.folder).rows(TIMINGS)) / 60

    def recorded(self) -> dict[str, Any]:
        """Where what it trained comes from."""
        record = RunFolder(self.folder).record
        about = {"seeds": self.settings.seeds, "settings": dataclasses.asdict(self.settings)}
        return about | {name: record.get(name) for name in ("versions", "commit")}


def trainings(plan: TrainingPlan, out: Path) -> list[Training]:
    """Every training of the plan, none where shipped policies are tested; raises SettingsError.

    Seeds are added to those of an earlier study: a second run, FOLDER-from-5, trains those from 5 on.
    """
    found: list[Training] = []
    for recipe, experiment in itertools.product(plan.recipes, () if plan.quick else plan.experiments):
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
