"""Lookup tables: an action for every bin of the newest record and the one a quarter of a turn before it, for
any number of records.

A table is filled by dynamic programming: in each bin that a life passes, what the limit's policy could still
gain after either action, known for every pose, is added up, and the better action is entered. Then lives
under that table are looked at, and so on; the table that training cells gain most with is kept.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from swarm.optimal.physical_limit import Optimal, limit
from swarm.physics.starts import Starts, draw_starts
from swarm.physics.world import State, World
from swarm.population.rollout import Moment, rollout
from trainers.studies.minimal.plan import MinimalPlan
from trainers.studies.minimal.search import training_starts

REACH = 1.2  # of c* that bins divide, about what it swings by
ROUNDS = 4  # of lives that a table is filled from
STAGE = 700  # of the streams of training cells


@dataclass(frozen=True)
class LookupTables:
    """Tables of several seeds: the second action where the entry of both records' c* (in bins) and κ* is
    above 0.
    """

    bins: int  # of each c*
    entries: np.ndarray  # (seeds, bins² · 4)

    def act(self, world: World, state: State, uniform: Any = None) -> np.ndarray:
        found = np.take_along_axis(self.entries, self.place(world, state), axis=1)
        return (found > 0).astype(np.int32)

    def place(self, world: World, state: State) -> np.ndarray:
        """The entry (seeds, cells) of a memory."""
        older = max(1, world.n_records // 4)  # of a turn's records
        seen = world.observation(state)[..., [0, 1, 2 * older, 2 * older + 1]]
        within = (seen[..., ::2] / REACH + 1) * (self.bins / 2)
        newest, before = np.moveaxis(np.clip(within.astype(int), 0, self.bins - 1), -1, 0)
        curvature = (seen[..., 1::2] > 0).astype(int)
        return ((newest * self.bins + before) * 2 + curvature[..., 0]) * 2 + curvature[..., 1]


class Tabulated(NamedTuple):
    n_records: int
    bins: int
    entries: int  # that lives of the test cells pass
    gain: np.ndarray  # (seeds, cells) of the test [concentration]
    limit: float


def tabulate(world: World, life: float, bins: int, plan: MinimalPlan) -> Tabulated:
    """Fill a table for each seed in lives of the world, and test them in lives of length `life`."""
    tables, tested = _filled(world, bins, plan), world.replace(life=life)
    starts = draw_starts(tested, plan.cells, plan.seed)
    shared = Starts(*(np.broadcast_to(part, (plan.n_seeds, *part.shape)) for part in starts))
    passed = np.zeros(tables.entries.shape, bool)
    for moment in rollout(tested, tables, shared, plan.seed, episode=np.zeros(plan.n_seeds, int)):
        np.put_along_axis(passed, tables.place(tested, moment.state), True, axis=1)
    bound = limit(tested, starts)
    assert bound is not None, "the plan asks for worlds with a limit"
    return Tabulated(world.n_records, bins, int(passed.sum(axis=1).max()), _gain(moment), bound)


def _filled(world: World, bins: int, plan: MinimalPlan) -> LookupTables:
    """The tables that the training cells of each seed gain most with."""
    sums = np.zeros((plan.n_seeds, 4 * bins**2))
    best, most = LookupTables(bins, sums.copy()), np.full(plan.n_seeds, -np.inf)
    optimal = Optimal(world)
    policy: Optimal | LookupTables = optimal
    rows = np.arange(plan.n_seeds)[:, None]
    for episode in range(ROUNDS + 1):
        starts = training_starts(world, plan, plan.n_seeds, 1000 * STAGE + episode)
        episodes = np.full(plan.n_seeds, episode)
        for moment in rollout(world, policy, starts, STAGE, population="training", episode=episodes):
            if not moment.state.finished.all():
                low, high = optimal.scores(world, moment.state)
                np.add.at(sums, (rows, best.place(world, moment.state)), high - low)
        gain = _gain(moment).mean(axis=1)
        if isinstance(policy, LookupTables):
            better = gain > most
            best.entries[better], most[better] = policy.entries[better], gain[better]
        policy = LookupTables(bins, sums.copy())
        sums *= 0.5  # what lives under older tables pass counts for less
    return best


def _gain(last: Moment) -> np.ndarray:
    assert last.outcome is not None, "a life has a decision at least"
    return np.asarray(last.outcome.gain)
