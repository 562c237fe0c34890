"""What is to be seen of a swarm: from where, which cells, and the paths that they swam."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from swarm.figures.scene.easel import SIZE
from swarm.physics.crowd.interactions import Contact
from swarm.physics.world import World

TRAIL = 28  # decisions that a trail reaches back

Groups = list[tuple[str, np.ndarray]]  # colours, and which cells (cells,) are of each


class Camera(NamedTuple):
    """The square of the world that is in view."""

    x: float  # of its centre [length]
    y: float
    width: float

    @property
    def scale(self) -> float:
        """Pixels per length."""
        return SIZE / self.width

    def pixels(self, places: np.ndarray) -> np.ndarray:
        """Columns and rows (..., 2) of complex places (...) [length]."""
        away = (places - complex(self.x, self.y)) * self.scale
        return np.stack([away.real, -away.imag], axis=-1) + (SIZE - 1) / 2

    # What the view of space has to compute, `Orbit`, is plain here.

    def flat(self, places: np.ndarray) -> np.ndarray:
        return places

    def angle(self, places: np.ndarray, heading: np.ndarray) -> np.ndarray:
        return heading

    def nearness(self, places: np.ndarray) -> float:
        return 1.0

    def order(self, places: np.ndarray, below: np.ndarray) -> np.ndarray:
        return np.argsort(~below, kind="stable")

    def layers(self, groups: Groups, places: np.ndarray) -> Groups:
        return groups


class Glance(NamedTuple):
    """What of a state is to be seen."""

    position: np.ndarray  # (cells,) complex, in space (cells, 3) [length]
    heading: np.ndarray  # (cells,) [rad], in space unit vectors (cells, 3)
    curvature: np.ndarray  # (cells,) of the interval that ended [1 / length]
    time: np.ndarray  # (cells,)
    gain: np.ndarray  # (cells,)
    finished: np.ndarray  # (cells,) bool
    won: np.ndarray | None = None  # (cells,) bool: has arrived in time; None where nobody races
    closed: bool = False  # whether the egg lets nobody in any more
    medium: Any = None  # its `MediumState`
    orientation: Any = None  # (cells, 4) quaternions; None in the plane


class Teams(NamedTuple):
    """Several policies in one world."""

    names: Sequence[str]
    steered_by: np.ndarray  # (cells,) number of the policy


class Segment(NamedTuple):
    """The paths of one decision: arcs between two glances."""

    start: np.ndarray  # (cells,) complex [length]
    chord: np.ndarray  # (cells,) complex [length]
    turn: np.ndarray  # (cells,) [rad]
    seen: np.ndarray  # (cells,) bool: swum, and in the cell's present life

    def places(self, share: np.ndarray) -> np.ndarray:
        """Complex places (cells, k) at shares (k,) in [0, 1] of the interval; NaN where nothing is seen.

        z(s) = z₀ + (z₁ − z₀)(e^{iαs} − 1)/(e^{iα} − 1): the arc of angle α through both ends.
        """
        small = np.abs(self.turn) < 1e-4
        turn = np.where(small, 1.0, self.turn)[:, None]
        ratio = np.where(small[:, None], share, np.expm1(1j * turn * share) / np.expm1(1j * turn))
        return np.where(self.seen[:, None], self.start[:, None] + self.chord[:, None] * ratio, np.nan)

    def heading(self, share: float, end: np.ndarray) -> np.ndarray:
        """Where cells head (cells,) at a share of the interval, at whose end they head to `end` [rad]."""
        return end - np.where(self.seen, (1 - share) * self.turn, 0.0)


def contact_of(world: World) -> float:
    """Diameter of the disks that push each other apart [length]; 0 where cells do not touch."""
    return max((each.diameter for each in world.interactions if isinstance(each, Contact)), default=0.0)


def places_behind(trail: Sequence[Any], share: float, back: np.ndarray) -> np.ndarray:
    """Places (cells, k), in space (cells, k, 3), where cells were `back` (k,) decisions ago, rising."""
    age = np.ceil(back - share).astype(int).clip(0)  # segments that have been swum since
    return np.hstack(
        [segment.places(share + i - back[age == i]) for i, segment in enumerate(reversed(trail))]
    )
