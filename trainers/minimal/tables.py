"""Lookup tables: an action for every bin of the two newest records, for any number of records.

A table is filled by dynamic programming: in each bin that a life passes, what the limit's policy could still
gain after either action, known for every pose, is added up, and the better action is entered. Then lives
under that table are looked at, and so on; the table that training cells gain most with is kept.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from swarm.optimal.physical_limit import Optimal, limit
from swarm.physics.starts import draw_starts
from swarm.physics.world import State, World
from swarm.population.rollout import rollout
from trainers.minimal.plan import MinimalPlan

REACH = 1.2  # of c* that bins divide, about what it swings by
ROUNDS = 6  # of lives that a table is filled from
STAGE = 700  # of the streams of training cells


@dataclass(frozen=True)
class LookupTable:
    """The second action where the entry of the newest two c* (in bins) and κ* is above 0."""

    bins: int  # of each c*
    entries: np.ndarray  # (bins² · 4,)

    def act(self, world: World, state: State, uniform: Any = None) -> np.ndarray:
        """Actions (..., cells)."""
        return (self.entries[self.place(world, state)] > 0).astype(np.int32)

    def place(self, world: World, state: State) -> np.ndarray:
        """The entry (..., cells) of a memory."""
        seen = world.observation(state)
        c = np.clip(((seen[..., [0, 2]] / REACH + 1) * (self.bins / 2)).astype(int), 0, self.bins - 1)
        curvature = (seen[..., [1, 3]] > 0).astype(int)
        return ((c[..., 0] * self.bins + c[..., 1]) * 2 + curvature[..., 0]) * 2 + curvature[..., 1]


class Tabulated(NamedTuple):
    """What tables of one size gain."""

    n_records: int
    bins: int
    entries: int  # that lives of the test cells pass, of the table with most of them
    gain: np.ndarray  # (seeds, cells) of the test
    limit: float


def tabulate(world: World, bins: int, plan: MinimalPlan, life: float) -> Tabulated:
    """Fill a table for each seed in lives of the world, and test them in lives of length `life`."""
    tables = [_filled(world, bins, plan, seed) for seed in range(plan.n_seeds)]
    tested = world.replace(life=life)
    starts = draw_starts(tested, plan.cells, plan.seed)
    gain, passed = [], []
    for table in tables:
        seen = np.zeros(len(table.entries), bool)
        for moment in rollout(tested, table, starts, plan.seed):
            seen[table.place(tested, moment.state)] = True
            outcome = moment.outcome
        assert outcome is not None
        gain.append(np.asarray(outcome.gain))
        passed.append(int(seen.sum()))
    bound = limit(tested, starts)
    assert bound is not None, "the plan asks for worlds with a limit"
    return Tabulated(world.n_records, bins, max(passed), np.stack(gain), bound)


def _filled(world: World, bins: int, plan: MinimalPlan, seed: int) -> LookupTable:
    """The table that the training cells of a seed gain most with."""
    best, most = LookupTable(bins, np.zeros(4 * bins**2)), -np.inf
    optimal = Optimal(world)
    sums, policy = np.zeros(4 * bins**2), optimal
    for episode in range(ROUNDS + 1):
        starts = draw_starts(world, plan.cells, seed, population="training", episode=1000 * STAGE + episode)
        for moment in rollout(world, policy, starts, seed, population="training", episode=episode):
            state, outcome = moment.state, moment.outcome
            if not state.finished.all():
                low, high = optimal.scores(world, state)
                np.add.at(sums, best.place(world, state), high - low)
        assert outcome is not None
        if episode and outcome.gain.mean() > most:
            best, most = policy, float(outcome.gain.mean())
        policy = LookupTable(bins, sums.copy())
        sums = 0.5 * sums
    return best
