"""Rungs: brains of one method and size, one for each training seed, and what they gain in validation and in
the test.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarm._support import provenance
from swarm._support.streams import Population
from swarm.optimal.physical_limit import limit
from swarm.physics.starts import draw_starts
from swarm.policies.network import Network
from swarm.policies.strategies import Greedy
from swarm.population.blocks.block import lives
from swarm.population.results import RIVAL
from trainers.jobs.executors import Task
from trainers.studies.estimates import Estimate, estimate
from trainers.studies.minimal import neuroevolution, search
from trainers.studies.minimal.brain import Brains, brains_of, gains, stacked
from trainers.studies.minimal.plan import ATTAINABLE, DQN, EVOLUTION, MinimalPlan, rung
from trainers.studies.minimal.tables import Tabulated, tabulate
from trainers.studies.plan import Training
from trainers.studies.stacks import all_policies, arrays_of
from trainers.studies.study import Packed, do, do_once, kept_in

MACHINE, PRUNED, THINNED, NEAT = "machine", "pruned", "thinned", "neat"
METHODS = {
    DQN: "DQN",
    PRUNED: "DQN, pruned",
    EVOLUTION: "CMA-ES",
    THINNED: "CMA-ES, pruned and searched on",
    NEAT: "NEAT",
    MACHINE: "two-state machine",
}
LEVELS = (0.95, 0.99)  # of the limit
POPULATIONS: tuple[Population, ...] = ("test", "validation")
MOST_OF_NEAT = 24  # parameters


class Rung(NamedTuple):
    method: str
    nodes: int | None  # of the network that was trained or searched; None where it grew
    parameters: int  # of the largest of them
    brains: Brains  # one for each seed


class Measured(NamedTuple):
    """What a rung gains [concentration]."""

    rung: Rung
    validation: np.ndarray  # (seeds,) mean gains
    gain: np.ndarray  # (seeds, cells) of the test


class CaseFindings(NamedTuple):
    measured: list[Measured]
    limit: float  # of the test cells
    validation_limit: float
    greedy: np.ndarray  # (cells,) gains of the test
    attainable: float | None  # what 95% and 99% are of where the limit is out of reach

    def fraction(self, each: Measured) -> Estimate:
        """Of the limit, in the test."""
        return estimate(each.gain / self.limit)

    def by_size(self, method: str) -> list[Measured]:
        """A method's rungs, of those of the same size the one that validation prefers, by size."""
        mine = [each for each in self.measured[::-1] if each.rung.method == method]  # of equals the first
        best = {each.rung.parameters: each for each in sorted(mine, key=lambda each: each.validation.mean())}
        return [best[size] for size in sorted(best)]

    def smallest(self, method: str, level: float) -> Measured | None:
        """The rung with the fewest parameters whose validation cells reach that part of the limit, or of
        what is attainable.
        """
        wanted = level * (self.attainable or self.validation_limit)
        return next((each for each in self.by_size(method) if each.validation.mean() >= wanted), None)


Networks = Mapping[tuple[str, int], Sequence[Network]]  # that were trained, by algorithm and nodes


def rungs(method: str, case: str, plan: MinimalPlan, networks: Networks) -> list[Rung]:
    """All rungs of a method."""
    world = plan.training_world(case)
    trained = {key: brains_of(each) for key, each in networks.items()}
    found: Iterable[tuple[int, Brains]]
    if method in plan.algorithms:
        found = [(nodes, trained[method, nodes]) for nodes in plan.nodes]
    elif method == PRUNED:
        found = [(nodes, each) for nodes in plan.nodes for each in search.pruned(trained[DQN, nodes])]
    elif method == THINNED:
        found = [
            (nodes, each)
            for nodes in plan.thinned
            for each in search.thinned(world, trained[EVOLUTION, nodes], plan, 100 * (1 + nodes))
        ]
    elif method == MACHINE:
        found = [(0, search.machine(world, plan))]
    else:
        return list(_grown(case, plan))
    return [Rung(method, nodes, int(each.parameters.max()), each) for nodes, each in found]


def _grown(case: str, plan: MinimalPlan) -> Iterator[Rung]:
    """NEAT's: for each size the brain of every seed that validation prefers among those not larger."""
    found = [neuroevolution.champions(plan.training_world(case), plan, seed) for seed in range(plan.n_seeds)]
    validated = [lived(case, plan, brains, "validation").mean(axis=1) for brains in found]
    before: tuple[int, ...] = ()
    for most in range(max(int(each.parameters.min()) for each in found), MOST_OF_NEAT + 1):
        chosen = tuple(
            int(np.argmax(np.where(brains.parameters <= most, gain, -np.inf)))
            for brains, gain in zip(found, validated, strict=True)
        )
        if chosen != before:
            brains = stacked([each[at : at + 1] for each, at in zip(found, chosen, strict=True)])
            yield Rung(NEAT, None, most, brains)
        before = chosen


def lived(case: str, plan: MinimalPlan, brains: Brains, population: Population) -> np.ndarray:
    """Gains (brains, cells) of the cells of validation or of the test."""
    world = plan.test_world(case)
    starts = draw_starts(world, plan.cells, plan.seed, population=population)
    return gains(world, brains, starts, plan.seed, population=population)


def measure(case: str, plan: MinimalPlan, found: Sequence[Rung]) -> CaseFindings:
    world = plan.test_world(case)
    starts = [draw_starts(world, plan.cells, plan.seed, population=each) for each in POPULATIONS]
    measured = [
        Measured(
            each,
            lived(case, plan, each.brains, "validation").mean(axis=1),
            lived(case, plan, each.brains, "test"),
        )
        for each in found
    ]
    greedy = lives(world, Greedy(), starts[0], plan.seed, name=RIVAL, population="test")["gain"]
    bound, others = (limit(world, each) for each in starts)
    assert bound is not None, "the plan asks for worlds with a limit"
    assert others is not None, "validation is in the same world"
    return CaseFindings(measured, bound, others, greedy, ATTAINABLE.get(case))


# --- the whole, and what was searched before ----------------------------------------------------------------


def file_of(method: str, case: str, plan: MinimalPlan, networks: Networks, folder: Path) -> Path:
    """Which keeps what comes of this very search."""
    others = {"cases", "experiments", "records", "bins"}  # decide no search
    numbers = {name: value for name, value in plan.recorded().items() if name not in others}
    plain = numbers, plan.training_world(case).described(), provenance.versions()
    parts = [part for each in networks.values() for part in arrays_of(each)]
    return kept_in(folder, f"{case}_{method}", plain, parts)


def packed(found: Sequence[Rung]) -> Packed:
    arrays = {f"{place}.weights": each.brains.weights for place, each in enumerate(found)}
    arrays |= {f"{place}.biases": each.brains.biases for place, each in enumerate(found)}
    return arrays, {"rungs": [[each.nodes, each.parameters] for each in found]}


def unpacked(task: Task, held: Mapping[str, np.ndarray], card: Mapping[str, Any]) -> list[Rung]:
    """The rungs that a search found, whose first argument is the method."""
    return [
        Rung(task.arguments[0], nodes, parameters, Brains(held[f"{place}.weights"], held[f"{place}.biases"]))
        for place, (nodes, parameters) in enumerate(card["rungs"])
    ]


class Findings(NamedTuple):
    cases: dict[str, CaseFindings]
    tables: list[Tabulated]


def find(plan: MinimalPlan, planned: Sequence[Training], out: Path) -> Findings:
    """Find the smallest brains of every case, and fill lookup tables of all sizes."""
    trained, tasks = all_policies(planned), {}
    for case in plan.cases:
        rungs_of = itertools.product(plan.algorithms, plan.nodes)
        networks = {
            (algorithm, nodes): trained[rung(case, algorithm, nodes)] for algorithm, nodes in rungs_of
        }
        for method, label in METHODS.items():
            path = file_of(method, case, plan, networks, out / "searched")
            tasks[path] = Task(f"{case} by {label}", rungs, (method, case, plan, networks))
    searched = do_once(plan.executor(), tasks, "searches", packed, unpacked)
    of_case: dict[str, list[Rung]] = {case: [] for case in plan.cases}
    for task in tasks.values():
        of_case[task.arguments[1]] += searched[task.label]
    tests = [Task(case, measure, (case, plan, found)) for case, found in of_case.items()]
    cases = do(plan.executor(), tests, "tests")
    world, life = plan.training_world(plan.cases[0]), plan.test_world(plan.cases[0]).life
    filled = [
        Task(f"N_T = {n}, {bins} bins", tabulate, (world.replace(n_records=n), life, bins, plan), n)
        for n, bins in itertools.product(plan.records, plan.bins)
    ]
    return Findings(cases, list(do(plan.executor(), filled, "tables").values()))
