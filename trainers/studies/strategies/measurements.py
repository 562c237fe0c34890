"""What every strategy gains in one world, beside what is possible there."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from swarm.optimal.physical_limit import bound, limit
from swarm.optimal.problem import why_no_limit
from swarm.physics.starts import Starts, draw_starts
from swarm.physics.world import World
from swarm.policies.policy import AnyPolicy
from swarm.population import evaluation
from swarm.population.blocks.block import lives
from trainers.studies.estimates import Estimate, estimate
from trainers.studies.minimal import search
from trainers.studies.minimal.brain import Brains
from trainers.studies.strategies.plan import DQN, MINIMAL, PPO, STRATEGIES, StrategiesPlan


class Lived(NamedTuple):
    """Lives of the same cells under one strategy, of every training seed where it is trained."""

    gain: np.ndarray  # (seeds, cells) [concentration]
    arrived: np.ndarray  # (seeds, cells) bool
    lifetime: np.ndarray  # (seeds, cells) [time]


class WorldFindings(NamedTuple):
    """What was found in one world. Texts say why there is nothing."""

    world: World
    lived: Mapping[str, Lived | str]  # by strategy
    possible: np.ndarray | str  # (cells,) the largest gains, whose mean is the limit [concentration]
    any_curvature: np.ndarray | str  # the same where curvatures are actions

    def gain(self, strategy: str) -> Estimate | None:
        """Mean gain [concentration]; None where there is none."""
        lived = self.lived[strategy]
        return None if isinstance(lived, str) else estimate(lived.gain)

    def fraction(self, strategy: str, *, any_curvature: bool = False) -> Estimate | None:
        """Of the limit, cell by cell; None where there is none."""
        lived, most = self.lived[strategy], self.any_curvature if any_curvature else self.possible
        if isinstance(lived, str) or isinstance(most, str):
            return None
        return estimate(lived.gain, most[None], combine=lambda gained, possible: gained / possible)

    def arrived(self, strategy: str) -> Estimate | None:
        """The part that reaches the egg; None where there is none."""
        lived = self.lived[strategy]
        return None if isinstance(lived, str) or self.world.egg is None else estimate(lived.arrived)

    def time_to_egg(self, strategy: str) -> Estimate | None:
        """How long cells take to the egg [time]; None unless all reach it."""
        lived = self.lived[strategy]
        return None if isinstance(lived, str) or not lived.arrived.all() else estimate(lived.lifetime)


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
    found: dict[str, Lived | str] = {}
    for strategy in STRATEGIES:
        where: World | str = world
        if strategy == PPO:
            where = continuous
        elif strategy == MINIMAL:
            where = world.replace(sense_flow=False)
        try:
            if isinstance(where, str):
                raise ValueError(where)
            players = policies.get(strategy) or [evaluation.STRATEGIES[strategy](where)]
        except ValueError as error:
            found[strategy] = str(error)
            continue
        found[strategy] = _lived(where, players, starts, plan.seed, strategy)
    free = continuous if isinstance(continuous, str) else possible(continuous, starts)
    return WorldFindings(world, found, possible(world, starts), free)


def _lived(world: World, players: Sequence[AnyPolicy], starts: Starts, seed: int, name: str) -> Lived:
    rows = [lives(world, each, starts, seed, name=name, population="test") for each in players]
    return Lived(*(np.stack([row[key] for row in rows]) for key in Lived._fields))


def possible(world: World, starts: Starts) -> np.ndarray | str:
    """The largest gain (cells,) of these starts, their mean that of the extrapolated limit; or why there is
    none [concentration].
    """
    cells, mean = bound(world, starts), limit(world, starts)
    if cells is None or mean is None:
        return f"the limit needs {why_no_limit(world)}"
    return cells * (mean / cells.mean())
