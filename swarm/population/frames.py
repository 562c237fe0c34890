"""Frames: a limited number of pictures of a medium over time, on a grid that stays small."""

from __future__ import annotations

import dataclasses

import numpy as np

from swarm.physics.crowd.medium import Medium, MediumState
from swarm.physics.world import State, World

MOST = 48  # frames of a life
NODES = 64  # of a frame along each axis, at most


def coarse(medium: Medium) -> Medium:
    """The medium on the grid of its frames."""
    columns, rows = (min(each, NODES) for each in medium.shape)
    return dataclasses.replace(medium, shape=(columns, rows), kernel="linear")


class Frames:
    """Takes frames of the medium of one world, the first where there are several, all alike in time."""

    def __init__(self, world: World, medium: Medium) -> None:
        self.world, self.medium, self.mesh = world, medium, coarse(medium).mesh
        self.every, self.taken = 1, 0
        self.frames: list[dict[str, np.ndarray]] = []
        self.last: dict[str, np.ndarray] = {}

    def take(self, state: State) -> None:
        """A frame, where it is time for one; where they get too many, every second goes."""
        self.last = self._frame(state)
        if self.taken % self.every == 0:
            self.frames.append(self.last)
        self.taken += 1
        if len(self.frames) == MOST:
            self.frames, self.every = self.frames[::2], 2 * self.every

    def series(self) -> dict[str, np.ndarray]:
        """What was taken by name (frames, ...), the last state always."""
        frames = self.frames if self.frames[-1] is self.last else [*self.frames, self.last]
        return {name: np.stack([frame[name] for frame in frames]) for name in self.last}

    def _frame(self, state: State) -> dict[str, np.ndarray]:
        held: MediumState = state.medium
        grid, origin, time = held.grid, held.origin, self.world.time(state)
        if grid.ndim > 2:
            grid, origin, time = grid[0], origin[0], time[0]
        places = self.mesh.places(origin)
        found = self.medium.sense(held._replace(grid=grid, origin=origin), places, np.zeros(len(places)))
        return {
            "medium": found.reshape(self.mesh.shape).astype(np.float32),
            "medium_origin": origin,
            "medium_time": time.max(),
        }
