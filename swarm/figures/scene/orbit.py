"""A view of space that goes round what it looks at, and the helices that were swum there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from matplotlib.colors import to_hex, to_rgb

from swarm.figures.scene.easel import SIZE
from swarm.figures.scene.glance import Groups
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.helix import along_helix, helix
from swarm.physics.world import World

AWAY = 4.0  # of the eye, in edges of the cube
ROOM = 1.8  # width of the picture, in edges of the cube, which turns in it
LIFT = 22  # of the cube, which is seen from above [pixels]
FIRST, RATE, ELEVATION = math.radians(-60), math.radians(1.2), math.radians(20)  # a decision
SMALLEST, EASE = 4.0, 0.12  # cube in view [length]; share of the way that it goes with each decision

HAZE, HAZY, FOG = (0.93, 1.05), (0.45, 0.2, 0.0), "#10315c"  # from which nearness on, how much, of what

Ball = tuple[tuple[float, ...], float]


class Orbit(NamedTuple):
    """The cube of space that is in view, seen from all around it in turn."""

    middle: tuple[float, float, float]  # [length]
    edge: float  # [length]
    azimuth: float = FIRST  # from which it is seen, counter-clockwise from +x [rad]
    ball: Ball | None = None  # centre and radius of what hides what is behind it

    @classmethod
    def around(cls, places: np.ndarray, before: Orbit | None, ball: Ball | None) -> Orbit:
        """The view of places (cells, 3), nearer to them than the one `before`."""
        if ball is not None:
            sides = ball[1] * np.array([[-1], [1]])
            places = np.concatenate([places, np.array(ball[0]) + sides])
        low, high = places.min(axis=0), places.max(axis=0)
        middle, edge = (low + high) / 2, max(1.12 * float((high - low).max()) + 1.0, SMALLEST)
        if before is not None:
            middle = before.centre + EASE * (middle - before.centre)
            needed = 2 * float(np.abs(places - middle).max()) + 0.5
            edge = max(before.edge + EASE * (edge - before.edge), needed)
        return cls(tuple(middle.tolist()), edge, ball=ball)

    def turned(self, decisions: float) -> Orbit:
        """The view after so many decisions."""
        return self._replace(azimuth=FIRST + RATE * decisions)

    @property
    def centre(self) -> np.ndarray:
        """The middle (3,) of the cube [length]."""
        return np.array(self.middle)

    @property
    def axes(self) -> np.ndarray:
        """Unit vectors (3, 3): to the right, up, and towards the eye."""
        (s, c), (v, u) = ((math.sin(x), math.cos(x)) for x in (self.azimuth, ELEVATION))
        return np.array([[-s, c, 0.0], [-c * v, -s * v, u], [c * u, s * u, v]])

    def place(self, inside: np.ndarray) -> np.ndarray:
        """Places (..., 3) of those in the cube [edges from its centre]."""
        return self.centre + self.edge * inside

    def below(self, places: np.ndarray) -> np.ndarray:
        """Places (..., 3) on the floor of the cube under others, NaN beside it."""
        inside = (np.abs(places - self.centre)[..., :2] < self.edge / 2).all(axis=-1, keepdims=True)
        floor = np.full_like(places[..., :1], self.centre[2] - self.edge / 2)
        return np.where(inside, np.concatenate([places[..., :2], floor], axis=-1), np.nan)

    def nearness(self, places: np.ndarray) -> np.ndarray:
        """How much (...) larger than at the centre things at places (..., 3) are seen."""
        return 1 / (1 - (places - self.centre) @ self.axes[2] / (AWAY * self.edge))

    def flat(self, places: np.ndarray, *, hiding: bool = True) -> np.ndarray:
        """Complex places (...) of the picture [length at the centre]; NaN where the ball hides them."""
        right, up = np.moveaxis((places - self.centre) @ self.axes[:2].T, -1, 0)
        seen = (right + 1j * up) * self.nearness(places)
        return np.where(self._hidden(places), np.nan, seen) if hiding and self.ball else seen

    def _hidden(self, places: np.ndarray) -> np.ndarray:
        """Whether the straight line (...) from the eye to places (..., 3) meets the ball."""
        assert self.ball is not None
        eye = self.centre + AWAY * self.edge * self.axes[2] - np.array(self.ball[0])
        way = places - np.array(self.ball[0]) - eye
        squared = (way * way).sum(axis=-1)
        part = np.clip(-(way @ eye) / squared, 0, 1)  # at which it comes nearest
        return ((eye + part[..., None] * way) ** 2).sum(axis=-1) < self.ball[1] ** 2

    def angle(self, places: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """In which directions (...) of the picture cells at places (..., 3) swim [rad]."""
        ahead = self.flat(places + 1e-3 * self.edge * direction, hiding=False)
        return np.angle(ahead - self.flat(places, hiding=False))

    def order(self, places: np.ndarray, below: np.ndarray) -> np.ndarray:
        """The cells (cells,) as they are drawn, the farthest first."""
        return np.argsort(self.nearness(places), kind="stable")

    def layers(self, groups: Groups, places: np.ndarray) -> Groups:
        """Groups of cells, each of one colour, from far to near, the far ones as in haze."""
        number = np.digitize(self.nearness(places), HAZE)
        return [
            (_mixed(colour, FOG, haze), each)
            for i, haze in enumerate(HAZY)
            for colour, cells in groups
            if (each := cells & (number == i)).any()
        ]

    def pixels(self, places: np.ndarray) -> np.ndarray:
        """Columns and rows (..., 2) of complex places (...) of the picture."""
        away = np.stack([places.real, -places.imag], axis=-1) * self.scale
        return away + (SIZE - 1) / 2 - np.array([0, LIFT])

    @property
    def scale(self) -> float:
        """Pixels per length at the centre."""
        return SIZE / (ROOM * self.edge)


def _mixed(colour: str, other: str, part: float) -> str:
    red, green, blue = ((1 - part) * a + part * b for a, b in zip(to_rgb(colour), to_rgb(other), strict=True))
    return to_hex((red, green, blue))


class Helices(NamedTuple):
    """The paths of one decision in space: helices between two glances."""

    start: Pose  # (cells, 3), (cells, 4)
    end: np.ndarray  # (cells, 3) where they came [length]
    curvature: np.ndarray  # (cells,) [1 / length]
    torsion: np.ndarray
    speed: np.ndarray  # [length / time]
    duration: np.ndarray  # [time]
    seen: np.ndarray  # (cells,) bool: swum, and in the cell's present life

    @classmethod
    def of(cls, world: World, start: Pose, end: np.ndarray, bend: np.ndarray, *when: np.ndarray) -> Helices:
        """Those of a world's cells, by their curvatures, durations, and whether they are `seen`."""
        assert world.torsions is not None
        torsion, speed = (np.interp(bend, world.curvatures, y) for y in (world.torsions, world.action_speeds))
        return cls(start, end, bend, torsion, speed, *when)

    def places(self, share: np.ndarray) -> np.ndarray:
        """Places (cells, k, 3) at shares (k,) in [0, 1] of the interval; NaN where nothing is seen.

        What flow and noise added to the helix is spread evenly over it.
        """
        shares, pose = np.append(share, 1.0), Pose(*(part[:, None] for part in self.start))
        curvature, torsion, speed = (part[:, None] for part in (self.curvature, self.torsion, self.speed))
        way = along_helix(pose, helix(curvature, torsion, speed * (self.duration[:, None] * shares))).position
        way = way + shares[:, None] * (self.end - way[:, -1])[:, None]
        return np.where(self.seen[:, None, None], way[:, :-1], np.nan)

    def heading(self, share: float, end: np.ndarray) -> np.ndarray:
        """Unit vectors (cells, 3) in which cells head at a share of the interval, who head to `end` then."""
        before, after = np.moveaxis(self.places(np.array([share - 1e-3, share])), 1, 0)
        way = after - before
        length = np.linalg.norm(way, axis=-1, keepdims=True)
        return np.where(length > 0, way / np.where(length > 0, length, 1.0), end)
