"""Lives of whole stacks of training seeds, all on the same fresh cells, and what is read off them."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarm.optimal import physical_limit as optimal
from swarm.physics.starts import Starts, draw_starts
from swarm.physics.world import World
from swarm.policies.policy import AnyPolicy
from swarm.policies.strategies import Greedy, Swinging
from swarm.population.blocks.block import lives
from swarm.population.results import RIVAL
from trainers.jobs.executors import Task
from trainers.studies.claims import DEVISED, Claim, Measure, all_claims, statements
from trainers.studies.estimates import loss
from trainers.studies.paper.plan import EGG, RECORDS, TESTS, Plan
from trainers.studies.plan import Training
from trainers.studies.stacks import Key, Stack, Trained, TrainingGains, stacks_of
from trainers.studies.study import do

SHIPPED = "swarm"  # the recipe whose policies are shipped
TENTH = 0.1  # part of the epochs at either end of a training that are compared


class Case(NamedTuple):
    """A world and everything that is tested in it."""

    name: str
    world: World  # with the test's life
    stacks: tuple[Stack, ...]
    cells: int
    seed: int

    @property
    def recipes(self) -> list[str]:
        """Whose policies are tested."""
        return list(dict.fromkeys(stack.recipe for stack in self.stacks))


class Lives(NamedTuple):
    """What is kept of every cell's life under every policy of a stack, all (seeds, cells, ...)."""

    seeds: tuple[int, ...]  # of training; none for a strategy
    gain: np.ndarray  # [concentration]
    arrived: np.ndarray  # bool
    lifetime: np.ndarray  # [time]
    drift: np.ndarray  # (seeds, cells, 2) way of the centre of curvature from start to end [length]
    wave: np.ndarray  # root mean square distance of the centreline from a straight line [length]
    winding: np.ndarray  # angle around the egg from start to arrival, counter-clockwise [rad]; or NaN
    broken: np.ndarray  # part of the decisions that break the swinging pattern
    ahead: np.ndarray  # bool: gains more than the same cell under greedy


class Circle(NamedTuple):
    """What swinging does, beside what geometry says."""

    fitted: np.ndarray  # (1, cells) radius of the circle through the centres of the arcs with κ₁ [length]
    predicted: float  # [length]
    deviation: np.ndarray  # (1, cells) the farthest that a centre lies off its predicted circle, per radius
    back: np.ndarray  # (1, cells) how near the centreline comes to where it began [steps of it]
    revolution: float  # [time] once around
    seeds: tuple[int, ...] = ()


class Measured(NamedTuple):
    limit: float | None  # for the very starts that were tested
    limit_error: float | None  # about how far off the limit may be
    lives: dict[tuple[str, str], Lives]  # by recipe and kind


class Evidence(NamedTuple):
    cases: Mapping[str, Measured]
    circles: Mapping[str, Circle]
    training: Mapping[tuple[str, str], TrainingGains]  # by recipe and experiment

    def sample(self, where: str, recipe: str) -> Lives | Circle | TrainingGains | None:
        """What was measured of CASE/KIND under a recipe, if it was; a strategy is the same under each.

        The kinds `training` and `circle` are a case's training gains and its circle of swinging.
        """
        case, kind = where.split("/")
        if kind == "circle":
            return self.circles.get(case)
        if kind == "training":
            return self.training.get((recipe, case))
        found = self.cases[case].lives if case in self.cases else {}
        return found.get((DEVISED, kind)) or found.get((recipe, kind))


def measure(case: Case) -> Measured:
    """Live every cell's life under every policy of the case."""
    starts = draw_starts(case.world, case.cells, case.seed)
    devised: dict[str, AnyPolicy] = {RIVAL: Greedy()}
    if not case.world.in_flow and case.world.egg is None:
        devised |= {"swinging": Swinging(), "optimal": optimal.Optimal(case.world)}
    found = {(DEVISED, name): _lives(case, starts, (), [policy]) for name, policy in devised.items()}
    for stack in case.stacks:
        found[stack.recipe, stack.kind] = _lives(case, starts, stack.seeds, stack.policies)
    greedy = found[DEVISED, RIVAL].gain
    found = {key: each._replace(ahead=each.gain > greedy) for key, each in found.items()}
    details = optimal.limit_details(case.world, starts)
    limit, error = (None, None) if details is None else (float(details.value), float(details.error))
    return Measured(limit, error, found)


def _lives(case: Case, starts: Starts, seeds: tuple[int, ...], policies: Sequence[AnyPolicy]) -> Lives:
    world, rows = case.world, []
    for policy in policies:
        lived = lives(world, policy, starts, case.seed, name=case.name, population="test", record=True)
        drift, wave = centreline(lived["centre"])
        winding = np.full(case.cells, math.nan) if world.egg is None else wound(lived["centre"], world.egg)
        broken, ahead = pattern_broken(lived["curvature"], world.n_records), np.zeros(case.cells, bool)
        kept = (lived[name] for name in ("gain", "arrived", "lifetime"))
        rows.append((*kept, drift, wave, winding, broken, ahead))
    return Lives(seeds, *(np.stack(column) for column in zip(*rows, strict=True)))


def centreline(centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Way (cells, 2) from start to end of lines (cells, places, 2), NaN after their ends; and their wave.

    The wave (cells,) is the root mean square distance from the straight line that makes it smallest.
    """
    lived = np.isfinite(centres[..., 0])
    count = lived.sum(axis=1)
    places = np.where(lived[..., None], centres, 0.0).astype(float)
    way = places[np.arange(len(places)), count - 1] - places[:, 0]
    local = np.where(lived[..., None], places - (places.sum(axis=1) / count[:, None])[:, None], 0.0)
    covariance = np.einsum("cpi,cpj->cij", local, local) / count[:, None, None]
    return way, np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, 0], 0.0))


def wound(centres: np.ndarray, egg: tuple[tuple[float, float], float]) -> np.ndarray:
    """Angle (cells,) that lines (cells, places, 2) wind around the egg's middle until they reach it [rad].

    Counter-clockwise; 0 for a line that begins in the egg.
    """
    (x, y), radius = egg
    local = centres.astype(float) - (x, y)
    outside = np.hypot(local[..., 0], local[..., 1]) > radius  # not where a life is over
    last = np.cumprod(outside, axis=1).sum(axis=1) - 1
    angle = np.unwrap(np.arctan2(local[..., 1], local[..., 0]), axis=1)
    return np.where(last > 0, angle[np.arange(len(angle)), last] - angle[:, 0], 0.0)


def pattern_broken(curvature: np.ndarray, n_records: int) -> np.ndarray:
    """Part (cells,) of the decisions that break the swinging pattern, in curvatures (cells, decisions + 1).

    In the pattern the curvature changes every N_T/2 decisions, so that each decision differs from the one
    N_T/2 before it. One that does not breaks the pattern; of those that chance chooses half do.
    """
    chosen, half = curvature[:, 1:], max(1, n_records // 2)
    lived = np.isfinite(chosen[:, half:])
    same = np.isclose(chosen[:, half:], chosen[:, :-half]) & lived
    return same.sum(axis=1) / np.maximum(lived.sum(axis=1), 1)


def swinging_circle(world: World, *, cells: int, seed: int) -> Circle:
    """Let cells swing for a little more than once around, and fit circles to their centres of curvature."""
    radii, step, revolution = predicted_circle(world)
    world = world.replace(life=1.25 * revolution)
    starts = draw_starts(world, cells, seed)
    lived = lives(world, Swinging(), starts, seed, name="swinging", population="test", record=True)
    time, curvature, centre = (lived[name][:, 1:].astype(float) for name in ("time", "curvature", "centre"))
    fitted, deviation, back = np.empty((3, 1, cells))
    for cell in range(cells):
        chosen = [np.isclose(curvature[cell], world.curvatures[end]) for end in (0, -1)]
        circles = [fit_circle(centre[cell][which]) for which in chosen]
        deviation[0, cell] = max(
            np.max(np.abs(np.linalg.norm(centre[cell][which] - middle, axis=1) - radius)) / radius
            for which, (middle, _), radius in zip(chosen, circles, radii, strict=True)
        )
        fitted[0, cell] = circles[0][1]
        later = centre[cell][chosen[0] & (time[cell] > 0.5 * revolution)]
        back[0, cell] = np.min(np.linalg.norm(later - centre[cell][chosen[0]][0], axis=1)) / step
    return Circle(fitted, radii[0], deviation, back, revolution)


def predicted_circle(world: World) -> tuple[tuple[float, float], float, float]:
    """Radii of the circles on which swinging's centres with κ₁ and κ₂ lie, one step on the first, the time
    of a revolution.

    In a swing a cell turns by α₁ = v₁κ₁n₁ΔT₁ with the lowest curvature for n₁ decisions, then by
    α₂ = v₂κ₂n₂ΔT₂ with the highest for n₂. The centre r + n/κ rests on an arc; where the curvature changes,
    the cell stays and the centre jumps by ∓n(1/κ₁ − 1/κ₂) (paper: displacement of the curvature centre). Two
    jumps, across the turn α₂ between them, move a centre with κ₁ by the chord
    s = 2(1/κ₁ − 1/κ₂)|sin(α₂/2)|. The next swing does the same, turned by α₁ + α₂: because ΔT is rounded
    down, that is δ short of a full turn. Equal chords, each turned by δ against the last, are a polygon in a
    circle of radius

        R₁ = s / (2|sin(δ/2)|) = (1/κ₁ − 1/κ₂) |sin(α₂/2)| / |sin((α₁ + α₂)/2)|

    and for the centres with κ₂, about the same middle, R₂ has α₁ in the place of α₂. It closes after 2π/δ
    swings. Raises ValueError where swinging goes straight on (δ = 0).
    """
    schedule, actions = Swinging.schedule(world), (0, world.n_actions - 1)
    intervals = [int(np.sum(schedule == action)) * world.intervals[action] for action in actions]
    first, second = (
        world.action_speeds[action] * world.curvatures[action] * interval
        for action, interval in zip(actions, intervals, strict=True)
    )
    short = abs(math.remainder(first + second, 2 * math.pi))
    if short < 1e-9:
        raise ValueError(
            f"a swing must turn by less or more than a circle to go round, got {first + second:g}"
        )
    jump, bend = 1 / world.curvatures[0] - 1 / world.curvatures[-1], math.sin(short / 2)
    half_steps = [jump * abs(math.sin(turn / 2)) for turn in (second, first)]
    radii = (half_steps[0] / bend, half_steps[1] / bend)
    return radii, 2 * half_steps[0], sum(intervals) * 2 * math.pi / short


def fit_circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the circle nearest to points (n, 2), by linear least squares."""
    middle = points.mean(axis=0)
    local = points - middle
    system = np.column_stack([2 * local, np.ones(len(local))])
    solution = np.linalg.lstsq(system, np.sum(local**2, axis=1), rcond=None)[0]
    return middle + solution[:2], float(np.sqrt(solution[2] + solution[0] ** 2 + solution[1] ** 2))


# --- what is measured: (seeds, cells) whose mean over the cells is the number of a seed ---------------------


def _spread(lives: Lives) -> np.ndarray:
    """Standard deviation of the gain over cells, to first order in each cell's weight."""
    off = lives.gain - lives.gain.mean(axis=1, keepdims=True)
    std = off.std(axis=1, keepdims=True)
    return std + np.divide(off**2 - std**2, 2 * std, out=np.zeros_like(off), where=std > 0)


def _turn(lives: Lives) -> tuple[np.ndarray, np.ndarray]:
    """Angle (seeds, 1) of the mean drift to the left of +y [rad], and what each cell (seeds, cells) adds."""
    drift = lives.drift[..., 1] - 1j * lives.drift[..., 0]
    mean = drift.mean(axis=1, keepdims=True)
    return np.angle(mean), np.imag(drift * mean.conj()) / np.abs(mean) ** 2


def _uphill(lives: Lives) -> np.ndarray:
    angle, turned = _turn(lives)
    return np.cos(angle) - np.sin(angle) * turned


def _rise(training: TrainingGains) -> np.ndarray:
    gain = training.gain
    length = max(1, round(TENTH * gain.shape[1]))
    return (gain[:, -length:].mean(axis=1) - gain[:, :length].mean(axis=1))[:, None]


MEASURES = {
    "gain": Measure(lambda lives: lives.gain, "concentration"),
    "part lost": Measure(lambda lives: lives.gain, "of the gain", loss),
    "spread of the gain": Measure(_spread, "concentration, standard deviation over cells"),
    "angle": Measure(lambda lives: np.degrees(sum(_turn(lives))), "degrees"),
    "part of the way up": Measure(_uphill, "of the way leads up the gradient"),
    "wave": Measure(lambda lives: lives.wave, "length"),
    "part that breaks the pattern": Measure(lambda lives: lives.broken, "of the decisions"),
    "part ahead of greedy": Measure(lambda lives: lives.ahead, "of the cells"),
    "part that arrives": Measure(lambda lives: lives.arrived, "of the cells"),
    "winding": Measure(lambda lives: np.degrees(lives.winding), "degrees"),
    "rise": Measure(_rise, "concentration"),
    "way back": Measure(lambda circle: circle.back, "steps of the centreline"),
    "distance off the circle": Measure(lambda circle: circle.deviation, "of the radius"),
}


# --- the whole ----------------------------------------------------------------------------------------------


class Findings(NamedTuple):
    plan: Plan
    planned: Sequence[Training]  # none where shipped policies are tested
    trained: Mapping[Key, Trained]
    tests: Sequence[Case]
    evidence: Evidence
    claims: Sequence[Claim]


def find(plan: Plan, planned: Sequence[Training], out: Path) -> Findings:
    """Test every policy in every world, and judge."""
    trained = stacks_of(plan, planned)
    tests = cases(plan, trained)
    gains = {key: each.gains for key, each in trained.items() if each.gains is not None}
    tasks = [Task(case.name, measure, (case,), work(case)) for case in tests]
    measured = do(plan.executor(), tasks, "tests")
    circles = {
        case.name: swinging_circle(case.world, cells=plan.swinging_cells, seed=plan.seed)
        for case in tests
        if case.name in RECORDS
    }
    evidence = Evidence(measured, circles, gains)
    recipes = list(dict.fromkeys(recipe for case in tests for recipe in case.recipes))
    claims = all_claims(statements(__package__, MEASURES), evidence.sample, recipes)
    return Findings(plan, planned, trained, tests, evidence, claims)


def cases(plan: Plan, trained: Mapping[Key, Trained]) -> list[Case]:
    """Every test for which there are policies."""
    found = []
    ordered = sorted((each.stack for each in trained.values()), key=lambda stack: stack.recipe != SHIPPED)
    for name, kinds in TESTS.items():
        tested = tuple(
            stack._replace(kind=kind)
            for stack in ordered
            for kind, experiment in kinds.items()
            if stack.experiment == experiment
        )
        if tested and next(iter(kinds.values())) in plan.experiments:
            cells = plan.radial_cells if name == EGG else plan.cells
            found.append(Case(name, plan.test_world(name), tested, cells, plan.seed))
    return found


def work(case: Case) -> float:
    """Roughly in their ratio tests take their time."""
    policies = 3 + sum(len(stack.policies) for stack in case.stacks)
    return policies * case.world.max_decisions * (5.0 if case.world.in_flow else 1.0)
