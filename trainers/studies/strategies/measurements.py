"""What every strategy gains in one world, beside what is possible there."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarm.optimal.physical_limit import bound, limit
from swarm.optimal.problem import why_no_limit
from swarm.physics.starts import Starts, draw_starts
from swarm.physics.world import World
from swarm.policies.policy import AnyPolicy
from swarm.population import evaluation
from swarm.population.blocks.block import lives
from trainers.jobs.executors import Task
from trainers.studies.estimates import Estimate, estimate
from trainers.studies.minimal import search
from trainers.studies.minimal.brain import Brains
from trainers.studies.plan import Training
from trainers.studies.stacks import all_policies
from trainers.studies.strategies.plan import DQN, MINIMAL, PPO, STRATEGIES, StrategiesPlan
from trainers.studies.study import do

LIMIT, ANY = "the limit", "the limit, any curvature"


class Lived(NamedTuple):
    """Lives of the same cells under one strategy, of every training seed where it is trained."""

    gain: np.ndarray  # (seeds, cells) [concentration]
    arrived: np.ndarray  # (seeds, cells) bool
    lifetime: np.ndarray  # (seeds, cells) [time]


class WorldFindings(NamedTuple):
    world: World
    lived: Mapping[str, Lived]  # by strategy
    possible: np.ndarray | None  # (cells,) the largest gains, whose mean is the limit [concentration]
    any_curvature: np.ndarray | None  # the same where curvatures are actions
    why_not: Mapping[str, str]  # of strategies and limits that are missing

    def gain(self, strategy: str) -> Estimate | None:
        """Mean gain [concentration]; None where there is none."""
        return estimate(self.lived[strategy].gain) if strategy in self.lived else None

    def fraction(self, strategy: str, *, any_curvature: bool = False) -> Estimate | None:
        """Of the limit, cell by cell; None where there is none."""
        most = self.any_curvature if any_curvature else self.possible
        if most is None or strategy not in self.lived:
            return None
        return estimate(self.lived[strategy].gain, most[None], combine=lambda gained, limit: gained / limit)

    def arrived(self, strategy: str) -> Estimate | None:
        """The part that reaches the egg; None where there is none."""
        seen = self.world.egg is not None and strategy in self.lived
        return estimate(self.lived[strategy].arrived) if seen else None

    def time_to_egg(self, strategy: str) -> Estimate | None:
        """How long cells take to the egg [time]; None unless all reach it."""
        all_arrive = strategy in self.lived and self.lived[strategy].arrived.all()
        return estimate(self.lived[strategy].lifetime) if all_arrive else None


def minimal(name: str, plan: StrategiesPlan) -> Brains:
    """The smallest brain of every seed, searched for in lives of the world that is trained in."""
    trained = plan.settings(plan.recipes[0], f"{name}_{DQN}").training_world()
    life = min(trained.life, plan.search.fitness_life)
    return search.linear(trained.replace(life=life, sense_flow=False), plan.search, plan.parameters)


def measure(
    name: str, plan: StrategiesPlan, trained: Mapping[str, Sequence[AnyPolicy]], smallest: Brains
) -> WorldFindings:
    """Live the test's cells under every strategy; `trained` are the policies of all seeds by algorithm."""
    world, continuous = plan.world(name), plan.continuous(name)
    starts = draw_starts(world, plan.cells if world.egg is None else plan.egg_cells, plan.seed)
    policies: dict[str, Sequence[AnyPolicy]] = {
        **trained,
        MINIMAL: [smallest[seed : seed + 1] for seed in range(len(smallest))],
    }
    worlds = {PPO: continuous, MINIMAL: world.replace(sense_flow=False)}
    found: dict[str, Lived] = {}
    why: dict[str, str] = {}
    for strategy in STRATEGIES:
        where = worlds.get(strategy, world)
        try:
            if isinstance(where, str):
                raise ValueError(where)
            players = policies.get(strategy) or [evaluation.STRATEGIES[strategy](where)]
        except ValueError as error:
            why[strategy] = str(error)
            continue
        found[strategy] = _lived(where, players, starts, plan.seed, strategy)
    most = {LIMIT: possible(world, starts), ANY: possible(continuous, starts)}
    why |= {name: reason for name, reason in most.items() if isinstance(reason, str)}
    two, free = (None if isinstance(each, str) else each for each in most.values())
    return WorldFindings(world, found, two, free, why)


def _lived(world: World, players: Sequence[AnyPolicy], starts: Starts, seed: int, name: str) -> Lived:
    rows = [lives(world, each, starts, seed, name=name, population="test") for each in players]
    return Lived(*(np.stack([row[key] for row in rows]) for key in Lived._fields))


def possible(world: World | str, starts: Starts) -> np.ndarray | str:
    """The largest gain (cells,) of these starts, their mean that of the extrapolated limit; or why there is
    none, or no such world [concentration].
    """
    if isinstance(world, str):
        return world
    cells, mean = bound(world, starts), limit(world, starts)
    if cells is None or mean is None:
        return f"the limit needs {why_no_limit(world)}"
    return cells * (mean / cells.mean())


def find(plan: StrategiesPlan, planned: Sequence[Training], out: Path) -> dict[str, WorldFindings]:
    """Search for the smallest brains, and test every strategy in every world."""
    searches = [Task(f"smallest brain in {name}", minimal, (name, plan)) for name in plan.worlds]
    brains = do(plan.executor(), searches, "searches").values()
    policies, tests = all_policies(planned), []
    for name, smallest in zip(plan.worlds, brains, strict=True):
        trained = {each: policies[f"{name}_{each}"] for each in (DQN, PPO) if f"{name}_{each}" in policies}
        tests.append(Task(name, measure, (name, plan, trained, smallest)))
    return do(plan.executor(), tests, "tests")
