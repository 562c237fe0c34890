"""What is measured at each place of the figures: (seeds, units) of independent units, and its intervals.

What cells of one world do is not independent where they share it: units are worlds, of a race turns of
worlds, in shear, where nobody meets, cells.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarm._support import provenance
from swarm.optimal.physical_limit import limit
from swarm.physics.starts import draw_starts, draw_worlds
from swarm.policies.policy import AnyPolicy
from swarm.policies.strategies import Greedy
from swarm.population.blocks.block import lives
from swarm.population.contests import contest
from swarm.population.results import RIVAL
from swarm.population.rollout import rollout
from trainers.jobs.executors import Task
from trainers.studies.claims import (
    NOT_REPRODUCED,
    REPRODUCED,
    REVERSED,
    Claim,
    Measure,
    all_claims,
    statements,
)
from trainers.studies.crowd.plan import CROWD, FILM, FINE, RACE, SHEAR, UPTAKE, CrowdPlan, Point, points
from trainers.studies.estimates import Estimate, estimate
from trainers.studies.plan import Training
from trainers.studies.stacks import Trained, arrays_of, stacks_of
from trainers.studies.study import Packed, do_once, kept_in

VERDICTS = {REPRODUCED: "yes", NOT_REPRODUCED: "not shown", REVERSED: "no"}
LATER = 0.5  # part of a film's decisions after which order is measured


class Sample(NamedTuple):
    """What was measured of one kind of policy."""

    seeds: tuple[int, ...]  # of training; none for a strategy
    numbers: dict[str, np.ndarray]  # (seeds, units)


MEASURES = {
    "height": Measure(lambda sample: sample.numbers["height"], "length"),
    "gain": Measure(lambda sample: sample.numbers["gain"], "concentration"),
    "share of wins": Measure(lambda sample: sample.numbers["won"], "of the wins", part=True),
    "part that arrives": Measure(lambda sample: sample.numbers["arrived"], "of the cells", part=True),
    "polar order": Measure(lambda sample: sample.numbers["polar"], ""),
    "nearest neighbour": Measure(lambda sample: sample.numbers["nearest"], "length"),
}


def level(sample: Sample, measure: str) -> Estimate:
    """A measure of one sample, and its interval."""
    found = MEASURES[measure]
    return estimate(found.values(sample), part=found.part)


Samples = Mapping[str, Mapping[str, Sample]]  # by point and kind


def measure(point: Point) -> dict[str, Sample]:
    """What happens at a point under every kind of policy, greedy first; in a race all are against greedy."""
    by_seed: Callable[[Point, AnyPolicy], dict[str, np.ndarray]] = _MEASURED[point.experiment]
    greedy: dict[str, tuple[tuple[int, ...], Sequence[AnyPolicy]]] = {RIVAL: ((), (Greedy(),))}
    players = {} if point.experiment == RACE else greedy
    players |= {stack.kind: (stack.seeds, stack.policies) for stack in point.stacks}
    found = {}
    for kind, (seeds, policies) in players.items():
        rows = [by_seed(point, policy) for policy in policies]
        found[kind] = Sample(seeds, {name: np.stack([row[name] for row in rows]) for name in rows[0]})
    return found


def _eating(point: Point, policy: AnyPolicy) -> dict[str, np.ndarray]:
    """How far cells climb, and what they gain: means (worlds,)."""
    starts = draw_worlds(point.world, point.cells, point.seed, range(point.worlds))
    for last in rollout(point.world, policy, starts, point.seed):
        moment = last
    assert moment.outcome is not None
    height = moment.state.position[..., 1] - starts.position[..., 1]
    return {"height": height.mean(axis=-1), "gain": moment.outcome.gain.mean(axis=-1)}


def _racing(point: Point, policy: AnyPolicy) -> dict[str, np.ndarray]:
    """The share of the wins against greedy (turns,); where nobody wins, its share of the crowd."""
    share = float(point.value)
    raced = contest(
        point.world,
        {"learnt": policy, RIVAL: Greedy()},
        {"learnt": share, RIVAL: 1 - share},
        cells=point.cells,
        worlds=point.worlds,
        seed=point.seed,
    )
    winner, turn = raced["winner"].values, raced["turn"].values
    of_turn = np.arange(turn[-1] + 1)[:, None] == turn
    wins = of_turn @ winner.sum(axis=-1)
    mine = of_turn @ (winner & (raced["steered_by"].values == 0)).sum(axis=-1)
    return {"won": np.where(wins > 0, mine / np.maximum(wins, 1), share)}


def _searching(point: Point, policy: AnyPolicy) -> dict[str, np.ndarray]:
    starts = draw_starts(point.world, point.cells, point.seed, population=point.population)
    lived = lives(point.world, policy, starts, point.seed, name=point.name, population=point.population)
    return {"arrived": lived["arrived"].astype(float)}


def _crowding(point: Point, policy: AnyPolicy) -> dict[str, np.ndarray]:
    """Gain at the end, and polar order and distance of the nearest neighbour in the later decisions."""
    from scipy.spatial import cKDTree

    starts = draw_worlds(point.world, point.cells, point.seed, range(point.worlds))
    polar, nearest = [], []
    for moment in rollout(point.world, policy, starts, point.seed):
        polar.append(np.linalg.norm(moment.state.heading.mean(axis=1), axis=-1))
        trees = [(places, cKDTree(places)) for places in moment.state.position]
        nearest.append([tree.query(places, k=2)[0][:, 1].mean() for places, tree in trees])
        outcome = moment.outcome
    assert outcome is not None
    later = int(LATER * len(polar))
    means = (np.mean(each[later:], axis=0) for each in (polar, nearest))
    return dict(zip(("gain", "polar", "nearest"), (outcome.gain.mean(axis=-1), *means), strict=True))


_MEASURED = {UPTAKE: _eating, FINE: _eating, RACE: _racing, SHEAR: _searching, FILM: _crowding}


# --- the whole, and what was measured before ----------------------------------------------------------------


def file_of(point: Point, folder: Path) -> Path:
    """Which keeps what is measured at this very point of these policies."""
    plain = point.world.described(), point.cells, point.worlds, point.seed, point.population
    parts: list[Any] = []
    for stack in point.stacks:
        parts += [f"{stack.kind} {stack.seeds}", *arrays_of(stack.policies)]
    return kept_in(folder, point.name, (plain, provenance.versions()), parts)


def packed(found: dict[str, Sample]) -> Packed:
    arrays = {f"{kind}/seeds": np.array(each.seeds, int) for kind, each in found.items()}
    for kind, each in found.items():
        arrays |= {f"{kind}/{name}": values for name, values in each.numbers.items()}
    return arrays, {"kinds": list(found)}


def unpacked(task: Task, stored: Mapping[str, np.ndarray], card: Mapping[str, Any]) -> dict[str, Sample]:
    found: dict[str, dict[str, np.ndarray]] = {kind: {} for kind in card.get("kinds", ())}
    for key, values in stored.items():
        kind, _, name = key.partition("/")
        found.setdefault(kind, {})[name] = values
    return {kind: Sample(tuple(numbers.pop("seeds").tolist()), numbers) for kind, numbers in found.items()}


def with_best(found: Samples, rates: Sequence[float]) -> Samples:
    """Everything, and as `shear_best` each kind at the shear rate at which most arrive among other cells."""
    names = [f"{SHEAR}_{rate:g}" for rate in rates]
    best: dict[str, Sample] = {}
    for kind in found[names[0]]:
        chances = [found[f"{name}_choice"][kind].numbers["arrived"].mean() for name in names]
        best[kind] = found[names[int(np.argmax(chances))]][kind]
    return {**found, f"{SHEAR}_best": best}


class CrowdFindings(NamedTuple):
    plan: CrowdPlan
    samples: Samples
    claims: Sequence[Claim]  # their verdicts in the words of `VERDICTS`
    trained: dict[str, Trained]  # by experiment
    limit: float | None  # of a cell alone, in the same lives
    minutes: dict[str, float]  # of every training


def find(plan: CrowdPlan, planned: Sequence[Training], out: Path) -> CrowdFindings:
    """Measure every point, and judge."""
    trained = {experiment: each for (_, experiment), each in stacks_of(plan, planned).items()}
    wanted = points(plan, {name: each.stack for name, each in trained.items()})
    tasks = {
        file_of(each, out / "measured"): Task(each.name, measure, (each,), work(each)) for each in wanted
    }
    by_name = do_once(plan.executor(), tasks, "points", packed, unpacked)
    samples = with_best(by_name, plan.shear_rates)

    def sample(where: str, recipe: str) -> Sample | None:
        point, kind = where.split("/")
        return samples.get(point, {}).get(kind)

    claims = all_claims(statements(__package__, MEASURES), sample, plan.recipes)
    claims = [each._replace(verdict=VERDICTS[each.verdict]) for each in claims]
    alone = plan.world(CROWD).replace(medium=None)
    cells = max(cells for cells, _ in plan.crowds)
    bound = limit(alone, draw_starts(alone, cells, plan.seed))
    return CrowdFindings(plan, samples, claims, trained, bound, {each.name: each.minutes for each in planned})


def work(point: Point) -> float:
    """Roughly in their ratio points take their time."""
    policies = 1 + sum(len(stack.policies) for stack in point.stacks)
    decision = {  # [ms]
        UPTAKE: 0.5 + 0.005 * point.cells,
        FINE: 4.0,
        RACE: 0.01,
        SHEAR: 0.012 * point.cells,
        FILM: 300.0,
    }
    return policies * point.world.max_decisions * point.worlds * decision[point.experiment]
