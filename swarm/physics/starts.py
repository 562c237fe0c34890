"""Starts: the poses and pasts that cells begin with, and the noise of their lives, drawn cell by cell."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from swarm._support import streams
from swarm._support.checks import check_count

if TYPE_CHECKING:
    from swarm.physics.world import World

NOISE_BLOCK = 64  # decisions whose noise is drawn at once, everywhere
_ATTEMPTS = 1000


class Starts(NamedTuple):
    """What a life begins with; every policy can be given the same."""

    position: np.ndarray  # (cells, 2) [length]
    heading: np.ndarray  # (cells,) in [−π, π) [rad]
    past: np.ndarray  # (cells, N_T) actions, newest first


def draw_starts(
    world: World, cells: int, seed: int, *, population: streams.Population = "test", episode: int = 0
) -> Starts:
    """Starts uniform in the world's box and in heading, with a random past, in float64.

    Poses are the same for every N_T. Starts within reach of the egg are drawn again. Raises ValueError where
    the box leaves no room outside the egg.
    """
    check_count("cells", cells)
    streams.check_seed(seed)
    poses = _draw_poses(world, cells, streams.generator(population, "start", seed, episode))
    for attempt in range(1, _ATTEMPTS):
        taken = _in_egg(world, poses[:, :2])
        if not taken.any():
            break
        again = _draw_poses(world, cells, streams.generator(population, "start", seed, episode, attempt))
        poses = np.where(taken[:, None], again, poses)
    else:
        raise ValueError(
            f"start_box must leave room outside the egg (position, radius) = {world.egg}, got {world.box}"
        )
    past = streams.generator(population, "past", seed, episode).integers(
        world.n_actions, size=(cells, world.n_records)
    )
    return Starts(poses[:, :2].copy(), poses[:, 2].copy(), past)


def draw_noise(
    seed: int,
    cells: int,
    decisions: int,
    *,
    population: streams.Population = "test",
    episode: int = 0,
    block: int = 0,
) -> np.ndarray:
    """Standard normal numbers (cells, decisions, 3) for the world's perturbations, one block of decisions at
    a time."""
    return streams.generator(population, "noise", seed, episode, block).standard_normal((cells, decisions, 3))


def _draw_poses(world: World, cells: int, generator: np.random.Generator) -> np.ndarray:
    (left, right), (bottom, top) = world.box
    low, high = np.array([left, bottom, -np.pi]), np.array([right, top, np.pi])
    return low + (high - low) * generator.random((cells, 3))


def _in_egg(world: World, position: np.ndarray) -> np.ndarray:
    if world.egg is None:
        return np.zeros(len(position), bool)
    centre, radius = world.egg
    return np.hypot(*(position - np.asarray(centre)).T) <= radius
