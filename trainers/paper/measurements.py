"""Tests of whole stacks of training seeds, all on the same fresh cells, and what is read off the lives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from swarm.optimal import physical_limit as optimal
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.network import Network
from swarm.policies.policy import Policy
from swarm.policies.strategies import Swinging
from swarm.population.contest import population_test
from swarm.population.results import RIVAL

if TYPE_CHECKING:
    import xarray as xr

DEVISED = ""  # the recipe of strategies that nobody trained


class Stack(NamedTuple):
    """Networks of one kind, one for each training seed."""

    recipe: str
    kind: str  # what figures call it: dqn, aware, blind, still
    experiment: str  # what it was trained on
    seeds: tuple[int, ...]
    policies: tuple[Network, ...]
    chosen: int  # place of the policy that validation prefers

    @property
    def choice(self) -> Network:
        """The policy that validation prefers."""
        return self.policies[self.chosen]


class Case(NamedTuple):
    """A world and everything that is tested in it."""

    name: str
    world: World  # with the test's life
    stacks: tuple[Stack, ...]
    cells: int
    seed: int


class Lives(NamedTuple):
    """What is kept of every cell's life under every policy of a stack."""

    seeds: tuple[int, ...]  # of training; none for a strategy
    gain: np.ndarray  # (seeds, cells) [concentration]
    arrived: np.ndarray  # (seeds, cells) bool
    lifetime: np.ndarray  # (seeds, cells) [time]
    drift: np.ndarray  # (seeds, cells, 2) way of the centre of curvature from start to end [length]
    spiral: np.ndarray  # (seeds, cells) angle between the centreline and the way to the egg [rad]; else NaN

    @property
    def off_gradient(self) -> np.ndarray:
        """Drift (seeds, cells) as complex numbers, along +y and to the left of it."""
        return self.drift[..., 1] - 1j * self.drift[..., 0]


class Measured(NamedTuple):
    """Outcome of a case."""

    limit: float | None  # for the very starts that were tested
    limit_error: float | None  # about how far off the limit may be
    lives: dict[tuple[str, str], Lives]  # by recipe and kind


def measure(case: Case) -> Measured:
    """Live every cell's life under every policy of the case."""
    devised: dict[str, Policy] = {} if case.world.in_flow or case.world.egg else {"swinging": Swinging()}
    results = _test(case, devised)
    lives = {(DEVISED, name): _lives(case.world, results, [name]) for name in (RIVAL, *devised)}
    for stack in case.stacks:
        named: dict[str, Policy] = {
            f"seed {seed}": policy for seed, policy in zip(stack.seeds, stack.policies, strict=True)
        }
        results = _test(case, named)
        found = _lives(case.world, results, list(named))
        lives[stack.recipe, stack.kind] = found._replace(seeds=stack.seeds)
    details = optimal.limit_details(case.world, draw_starts(case.world, case.cells, case.seed))
    limit, error = (None, None) if details is None else (float(details.value), float(details.error))
    return Measured(limit, error, lives)


def _test(case: Case, policies: dict[str, Policy]) -> xr.Dataset:
    return population_test(
        case.world, policies, cells=case.cells, life=case.world.life, seed=case.seed, limit=False
    )


def _lives(world: World, results: xr.Dataset, names: Sequence[str]) -> Lives:
    chosen = results.sel(policy=list(names))
    centres = chosen["centre"].values.astype(float)  # (policies, cells, decisions + 1, 2)
    last = np.isfinite(centres[..., 0]).sum(axis=-1) - 1
    end = np.take_along_axis(centres, last[..., None, None], axis=2)[:, :, 0]
    spiral = np.full(last.shape, math.nan)
    if world.egg is not None:
        for place in np.ndindex(spiral.shape):
            spiral[place] = spiral_angle(centres[place][: last[place] + 1], world.egg)
    return Lives(
        seeds=(),
        gain=chosen["gain"].values,
        arrived=chosen["arrived"].values,
        lifetime=chosen["lifetime"].values,
        drift=end - centres[:, :, 0],
        spiral=spiral,
    )


def spiral_angle(centres: np.ndarray, egg: tuple[tuple[float, float], float]) -> float:
    """Angle between a centreline (places, 2) and the way to the egg, counter-clockwise [rad].

    A line that keeps an angle ψ to the way inwards is a logarithmic spiral, φ = tan ψ ln r + constant: ψ is
    fitted to the part outside the egg. NaN where that is too short.
    """
    (x, y), radius = egg
    distance = np.hypot(centres[:, 0] - x, centres[:, 1] - y)
    inside = np.flatnonzero(distance <= radius)
    outside = slice(0, inside[0] if len(inside) else None)
    log_distance = np.log(distance[outside])
    if len(log_distance) < 2 or np.ptp(log_distance) == 0:
        return math.nan
    angle = np.unwrap(np.arctan2(centres[outside, 1] - y, centres[outside, 0] - x))
    slope = np.polyfit(log_distance - log_distance.mean(), angle - angle.mean(), 1)[0]
    return math.atan(slope)


class Circle(NamedTuple):
    """What swinging does, beside what geometry says."""

    fitted: np.ndarray  # (1, cells) radius of the circle through the centres of the arcs with κ₁ [length]
    predicted: float  # [length]
    deviation: np.ndarray  # (1, cells) the farthest that a centre lies off its predicted circle, per radius
    back: np.ndarray  # (1, cells) how near the centreline comes to where it began [steps of it]
    revolution: float  # [time] once around


def swinging_circle(world: World, *, cells: int, seed: int) -> Circle:
    """Let cells swing for a little more than once around, and fit circles to their centres of curvature."""
    radii, step, revolution = predicted_circle(world)
    life = 1.25 * revolution
    results = population_test(world, {"swinging": Swinging()}, cells=cells, life=life, seed=seed, limit=False)
    lives = results.sel(policy="swinging")
    fitted, deviation, back = np.empty((3, 1, cells))
    for cell in range(cells):
        one = lives.isel(cell=cell)
        curvature, time = one["curvature"].values[1:].astype(float), one["time"].values[1:]
        centre = one["centre"].values[1:].astype(float)
        off = []
        for radius, kappa in zip(radii, (world.curvatures[0], world.curvatures[-1]), strict=True):
            points = centre[np.isclose(curvature, kappa)]
            middle, found = fit_circle(points)
            off.append(np.max(np.abs(np.linalg.norm(points - middle, axis=1) - radius)) / radius)
            if kappa == world.curvatures[0]:
                fitted[0, cell] = found
        deviation[0, cell] = max(off)
        first = np.isclose(curvature, world.curvatures[0])
        later = centre[first & (time > 0.5 * revolution)]
        back[0, cell] = np.min(np.linalg.norm(later - centre[first][0], axis=1)) / step
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
    schedule = Swinging.schedule(world)
    top = world.n_actions - 1
    counts = [int(np.sum(schedule == action)) for action in (0, top)]
    intervals = [count * world.intervals[action] for count, action in zip(counts, (0, top), strict=True)]
    first, second = (
        world.action_speeds[action] * world.curvatures[action] * interval
        for action, interval in zip((0, top), intervals, strict=True)
    )
    short = abs(math.remainder(first + second, 2 * math.pi))
    if short < 1e-9:
        raise ValueError(
            f"a swing must turn by less or more than a circle to go round, got {first + second:g}"
        )
    jump = 1 / world.curvatures[0] - 1 / world.curvatures[-1]
    bend = math.sin(short / 2)
    radii = (jump * abs(math.sin(second / 2)) / bend, jump * abs(math.sin(first / 2)) / bend)
    return radii, 2 * jump * abs(math.sin(second / 2)), sum(intervals) * 2 * math.pi / short


def fit_circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the circle nearest to points (n, 2), by linear least squares."""
    middle = points.mean(axis=0)
    local = points - middle
    system = np.column_stack([2 * local, np.ones(len(local))])
    solution = np.linalg.lstsq(system, np.sum(local**2, axis=1), rcond=None)[0]
    return middle + solution[:2], float(np.sqrt(solution[2] + solution[0] ** 2 + solution[1] ** 2))
