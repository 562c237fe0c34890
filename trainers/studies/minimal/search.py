"""Searches for ever smaller brains: CMA-ES over the numbers that are left, pruning by magnitude, the
two-state machine.
"""

import dataclasses
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from swarm._support import streams
from swarm.physics.starts import Starts, draw_starts
from swarm.physics.world import World
from trainers.studies.minimal.brain import Brains, gains
from trainers.studies.minimal.plan import MinimalPlan

STEP = 0.3  # σ of a search that goes on, in parts of the largest number
FEWEST = 1  # parameter
SIZES = 24  # of networks that are pruned without going on, evenly on a logarithmic scale


def searched(
    world: World, brains: Brains, free: np.ndarray, plan: MinimalPlan, stage: int, step: np.ndarray
) -> Brains:
    """The means of searches, one for each training seed, that begin at `brains` (seeds) with the standard
    deviations `step` (seeds,) and change the numbers that are `free` (seeds, numbers).

    Fitness is the mean gain of training cells; `stage` names their streams. CMA-ES (Hansen 2016).
    """
    with warnings.catch_warnings():  # of what it would plot with
        warnings.simplefilter("ignore")
        from cma import CMAEvolutionStrategy

    generators = [streams.generator("training", "network", seed, stage) for seed in range(len(brains))]
    searches = []
    for begun, chosen, width, generator in zip(brains.flat, free, step, generators, strict=True):
        options: dict[str, Any] = {"popsize": plan.candidates, "seed": np.nan, "verbose": -9}
        options["randn"] = lambda *size, generator=generator: generator.standard_normal(size)
        searches.append(CMAEvolutionStrategy(begun[chosen], float(width), options))
    for generation in range(plan.generations):
        asked = [search.ask() for search in searches]
        flat = np.repeat(brains.flat, plan.candidates, axis=0)
        for place, (chosen, candidates) in enumerate(zip(free, asked, strict=True)):
            rows = slice(place * plan.candidates, (place + 1) * plan.candidates)
            flat[rows, chosen] = np.array(candidates)
        fitness = fitness_of(world, brains.with_flat(flat), len(brains), plan, stage, generation)
        for search, candidates, found in zip(searches, asked, np.split(fitness, len(brains)), strict=True):
            search.tell(candidates, (-found).tolist())
    flat = brains.flat.copy()
    for row, chosen, search in zip(flat, free, searches, strict=True):
        row[chosen] = search.mean
    return brains.with_flat(flat)


def fitness_of(
    world: World, brains: Brains, n_seeds: int, plan: MinimalPlan, stage: int, generation: int
) -> np.ndarray:
    """Mean gain (brains,) of training cells, the same for the brains of a seed, which stand together."""
    begun = training_starts(world, plan, n_seeds, 1000 * (stage + 1) + generation)
    starts = Starts(*(np.repeat(part, len(brains) // n_seeds, axis=0) for part in begun))
    return gains(world, brains, starts, stage, population="training").mean(axis=1)


def training_starts(world: World, plan: MinimalPlan, n_seeds: int, episode: int) -> Starts:
    """Of the cells (seeds, cells, …) whose mean gain is a fitness."""
    drawn = [
        draw_starts(world, plan.fitness_cells, seed, population="training", episode=episode)
        for seed in range(n_seeds)
    ]
    return Starts(*map(np.stack, zip(*drawn, strict=True)))


def without_smallest(brains: Brains, left: int) -> Brains:
    """Brains whose numbers are 0 but for the `left` largest of each (magnitude pruning, LeCun et al. 1989,
    Han et al. 2015).
    """
    flat = brains.flat.copy()
    smallest = np.argsort(np.abs(flat), axis=1)[:, : flat.shape[1] - left]
    np.put_along_axis(flat, smallest, 0.0, axis=1)
    return brains.with_flat(flat)


def pruned(brains: Brains) -> Iterator[Brains]:
    """Brains with ever fewer parameters, which learn nothing on the way."""
    most = int(brains.parameters.max())
    for left in sorted({*np.geomspace(FEWEST, most, SIZES).round().astype(int).tolist()}, reverse=True)[1:]:
        yield without_smallest(brains, left)


def thinned(world: World, brains: Brains, plan: MinimalPlan, stage: int) -> Iterator[Brains]:
    """Brains with ever fewer parameters, whose search goes on whenever one was taken away."""
    for left in range(min(int(brains.parameters.max()) - 1, plan.most_thinned), FEWEST - 1, -1):
        brains = without_smallest(brains, left)
        if left > 1:  # of a single number only the sign counts
            step = STEP * np.abs(brains.flat).max(axis=1)
            brains = searched(world, brains, brains.flat != 0, plan, stage + left, step)
        yield brains


def machine(world: World, plan: MinimalPlan) -> Brains:
    """The two-state machine: the state is the curvature, and each state ends at a threshold of its own of the
    newest concentration: κ₁ turns into κ₂ where c* > a, κ₂ into κ₁ where c* < b.

    As a network c* + κ* (a − b)/2 > (a + b)/2; searched are a and b.
    """
    inputs = world.observation_size
    weights, biases = np.zeros((plan.n_seeds, 1, inputs)), np.zeros((plan.n_seeds, 1))
    weights[..., 0] = 1.0
    free = np.zeros((plan.n_seeds, inputs + 1), bool)
    free[:, [1, -1]] = True
    return searched(world, Brains(weights, biases), free, plan, 900, np.full(plan.n_seeds, 0.3))


def linear(world: World, plan: MinimalPlan, parameters: int) -> Brains:
    """Networks without nodes: all their numbers are searched for, for four times as many generations as after
    one of them is taken away, which goes on until so many `parameters` are left.
    """
    shape = plan.n_seeds, 1, world.observation_size
    brains = Brains(np.zeros(shape), np.zeros(shape[:2]))
    longer = dataclasses.replace(plan, generations=4 * plan.generations)
    brains = searched(world, brains, np.ones_like(brains.flat, bool), longer, 900, np.full(plan.n_seeds, 0.3))
    return next(each for each in thinned(world, brains, plan, 950) if each.parameters.max() <= parameters)
