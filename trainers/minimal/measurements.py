"""Rungs: brains of one method and size, one for each training seed, and what they gain in validation and in
the test.
"""

import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarm._support import provenance, tensors
from swarm.optimal.physical_limit import limit
from swarm.physics.starts import draw_starts
from swarm.policies.network import Network
from swarm.policies.strategies import Greedy
from swarm.population.blocks.block import lives
from swarm.population.results import RIVAL
from trainers.minimal import neuroevolution, search
from trainers.minimal.brain import Brains, brains_of, gains, stacked
from trainers.minimal.plan import ATTAINABLE, DQN, EVOLUTION, MinimalPlan
from trainers.paper.claims import Estimate, estimate

MACHINE, PRUNED, THINNED, NEAT = "machine", "pruned", "thinned", "neat"
METHODS = {
    DQN: "DQN",
    PRUNED: "DQN, pruned",
    EVOLUTION: "CMA-ES",
    THINNED: "CMA-ES, pruned and searched on",
    NEAT: "NEAT",
    MACHINE: "two-state machine",
}
MOST_OF_NEAT = 24  # parameters


class Rung(NamedTuple):
    """Brains of one size."""

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
    """What was found of one experiment."""

    measured: list[Measured]
    limit: float  # of the test cells
    validation_limit: float
    greedy: np.ndarray  # (cells,) gains of the test
    attainable: float | None  # what 95% and 99% are of where the limit is out of reach

    def fraction(self, each: Measured) -> Estimate:
        """Of the limit, in the test."""
        return estimate(each.gain / self.limit)

    def smallest(self, method: str, level: float) -> Measured | None:
        """The rung with the fewest parameters whose validation cells reach that part of the limit, or of
        what is attainable.
        """
        wanted = level * (self.attainable or self.validation_limit)
        fit = [
            each for each in self.measured if each.rung.method == method and each.validation.mean() >= wanted
        ]
        return min(fit, key=lambda each: (each.rung.parameters, -float(each.validation.mean())), default=None)


def rungs(
    method: str, case: str, plan: MinimalPlan, networks: dict[tuple[str, int], Sequence[Network]]
) -> Iterator[Rung]:
    """All rungs of a method; `networks` are those that were trained, by algorithm and nodes."""
    world = plan.training_world(case)
    trained = {key: brains_of(each) for key, each in networks.items()}
    if method in plan.algorithms:
        for nodes in plan.nodes:
            yield _rung(method, nodes, trained[method, nodes])
    elif method == PRUNED:
        for nodes in plan.nodes:
            for brains in search.pruned(trained[DQN, nodes]):
                yield _rung(method, nodes, brains)
    elif method == THINNED:
        for nodes in plan.thinned:
            for brains in search.thinned(world, trained[EVOLUTION, nodes], plan, 100 * (1 + nodes)):
                yield _rung(method, nodes, brains)
    elif method == MACHINE:
        yield _rung(method, 0, search.machine(world, plan))
    else:
        yield from _grown(case, plan)


def _rung(method: str, nodes: int | None, brains: Brains) -> Rung:
    return Rung(method, nodes, int(brains.parameters.max()), brains)


def _grown(case: str, plan: MinimalPlan) -> Iterator[Rung]:
    """NEAT's: for each size the brain of every seed that validation prefers among those not larger."""
    found = [neuroevolution.champions(plan.training_world(case), plan, seed) for seed in range(plan.n_seeds)]
    validated = [validation_gains(case, plan, brains) for brains in found]
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


def validation_gains(case: str, plan: MinimalPlan, brains: Brains) -> np.ndarray:
    """Mean gains (brains,) of the validation cells."""
    world = plan.test_world(case)
    starts = draw_starts(world, plan.cells, plan.seed, population="validation")
    return gains(world, brains, starts, plan.seed, population="validation").mean(axis=1)


def measure(case: str, plan: MinimalPlan, found: Sequence[Rung]) -> CaseFindings:
    """Validate and test all rungs."""
    world = plan.test_world(case)
    starts = draw_starts(world, plan.cells, plan.seed)
    measured = [
        Measured(
            each,
            validation_gains(case, plan, each.brains),
            gains(world, each.brains, starts, plan.seed, population="test"),
        )
        for each in found
    ]
    greedy = lives(world, Greedy(), starts, plan.seed, name=RIVAL, population="test")["gain"]
    others = limit(world, draw_starts(world, plan.cells, plan.seed, population="validation"))
    bound = limit(world, starts)
    assert bound is not None, "the plan asks for worlds with a limit"
    assert others is not None, "validation is in the same world"
    return CaseFindings(measured, bound, others, greedy, ATTAINABLE.get(case))


# --- what was searched before ------------------------------------------------------------------------------


def kept(
    method: str,
    case: str,
    plan: MinimalPlan,
    networks: dict[tuple[str, int], Sequence[Network]],
    folder: Path,
) -> list[Rung]:
    """The rungs that `folder` holds of this very search, else those searched now, which are kept."""
    path = folder / f"{case}_{method}.{_digest(case, plan, networks)}.safetensors"
    if path.exists():
        held, card = tensors.read(path, lambda card, shapes: None, at_most=2**26)
        return [
            Rung(method, nodes, parameters, Brains(held[f"{place}.weights"], held[f"{place}.biases"]))
            for place, (nodes, parameters) in enumerate(card["rungs"])
        ]
    found = list(rungs(method, case, plan, networks))
    arrays = {f"{place}.weights": each.brains.weights for place, each in enumerate(found)}
    arrays |= {f"{place}.biases": each.brains.biases for place, each in enumerate(found)}
    folder.mkdir(parents=True, exist_ok=True)
    tensors.write(path, arrays, {"rungs": [[each.nodes, each.parameters] for each in found]})
    return found


def _digest(case: str, plan: MinimalPlan, networks: dict[tuple[str, int], Sequence[Network]]) -> str:
    """Of all that decides what is searched."""
    others = {"cases", "experiments", "records", "bins"}  # decide no search
    numbers = {name: value for name, value in plan.recorded().items() if name not in others}
    plain = numbers, plan.training_world(case).described(), provenance.versions()
    found = hashlib.sha256(json.dumps(plain, default=str).encode())
    for each in networks.values():
        for array in (part for network in each for part in (*network.weights, *network.biases)):
            found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]
