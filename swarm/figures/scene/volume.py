"""What cells in space swim in: the far walls of a cube, coloured as the water is, its scales, and the egg."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from PIL import Image

from swarm.figures.scene.easel import FAINT, INK, SIZE, nice_step, signed
from swarm.figures.scene.glance import Glance
from swarm.figures.scene.orbit import Orbit
from swarm.figures.scene.water import Water, concentration_at, levels_of, speed_at, velocity_at

NODES = 48  # of a wall along each side
GRADIENT = "#f0e442"
ARROW = (58.0, 60.0, 46.0)  # column, row and length of the arrow along the gradient [pixels]
TICK, NUMBER, NAME = 6.0, 19.0, 46.0  # how far they reach beyond an edge [pixels]
AXES, HALF = np.arange(3), np.array([-0.5, 0.5])
SIDE = (np.arange(NODES) + 0.5) / NODES - 0.5  # of a wall, its nodes [edges from the middle]
TO_EDGES = np.interp(np.arange(NODES), (0, 1, NODES - 2, NODES - 1), (-0.5, SIDE[1], SIDE[-2], 0.5))


class Volume(Water):
    """Draws what is behind the cells; colours run over all values that have been on its walls."""

    def draw(self, camera: Any, glance: Glance) -> None:
        """Everything but the cells."""
        time, far = float(glance.time.max()), np.where(camera.axes[2] > 0, -0.5, 0.5)
        walls = [camera.place(_wall(far, axis, _mesh(SIDE))) for axis in range(3)]
        held = [concentration_at(self.world, time, wall) for wall in walls]
        shown = [speed_at(self.world, time, wall) for wall in walls] if self.shows_flow else held
        known = np.concatenate([each[np.isfinite(each)] for each in shown])
        if len(known):
            self._widen(0.0 if self.shows_flow else float(known.min()), float(known.max()))
        for axis in range(3):
            self._draw_wall(camera, far, axis, shown[axis])
        for axis in range(3):
            self._draw_wall_levels(camera, far, axis, held)
        if self.world.in_flow:
            self._draw_flow(camera, time)
        self._draw_scales(camera, far)
        self._draw_gradient(camera, time)
        if self.world.egg is not None:
            centre, radius = np.array(self.world.egg[0]), self.world.egg[1]
            spot = camera.pixels(camera.flat(centre, hiding=False))
            self._draw_egg(spot, 2 * radius * camera.scale * float(camera.nearness(centre)), glance.closed)
        self._draw_bar()

    def _draw_wall(self, camera: Orbit, far: np.ndarray, axis: int, shown: np.ndarray) -> None:
        """A wall in the colours of what is shown (nodes, nodes)."""
        part = (shown - self.span[0]) / max(float(np.ptp(self.span)), 1e-12)
        colours = self.colours(np.clip(np.nan_to_num(part), 0, 1), bytes=True)
        colours[~np.isfinite(shown)] = 0
        corners = _seen(camera, _wall(far, axis, _mesh(HALF)))
        seen, texture = corners.reshape(4, 2) + 0.5, NODES * (_mesh(HALF).reshape(4, 2) + 0.5)
        shape = (SIZE, SIZE), Image.Transform.PERSPECTIVE, _homography(seen, texture)
        image = Image.fromarray(colours).transform(*shape, Image.Resampling.BILINEAR)
        self.easel.show(np.asarray(image), 0, 0)

    def _draw_wall_levels(self, camera: Orbit, far: np.ndarray, axis: int, held: list[np.ndarray]) -> None:
        """Lines of equal concentration, the same levels on all walls."""
        low, high = min(map(np.nanmin, held)), max(map(np.nanmax, held))
        found = levels_of(held[axis], TO_EDGES, float(low), float(high))
        seen = [_seen(camera, _wall(far, axis, line)) for line, _ in found]
        self.easel.lines(seen, "#ffffff", [opacity for _, opacity in found], 1.0)

    def _draw_flow(self, camera: Orbit, time: float) -> None:
        """Streaks that brighten in the direction of the flow, on places that stand still in the cube."""
        step = nice_step(camera.edge / 3)
        low, high = (np.round((camera.centre + side * camera.edge) / step) for side in HALF)
        sides = [step * np.arange(*each) for each in zip(low, high + 1, strict=True)]
        places = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 3)
        flow = velocity_at(self.world, time, places)
        streak = flow[:, None] * (0.7 * step / max(float(np.linalg.norm(flow, axis=-1).max()), 1e-12))
        lines = places[:, None] + streak * np.linspace(-0.5, 0.5, 9)[:, None]
        self.easel.fade(camera.pixels(camera.flat(lines)), INK, np.linspace(0, 0.5, 8), 1.2)

    def _draw_scales(self, camera: Orbit, far: np.ndarray) -> None:
        """The edges of the walls, and along three edges in front numbers and names of the axes."""
        corners = [np.where(axis == AXES, -far, far) for axis in range(3)]
        edges = [[corner, far] for corner in corners]
        edges += [[corners[i], corners[i] + corners[j] - far] for i in range(3) for j in range(3) if i != j]
        lines = [_seen(camera, np.stack(edge)) for edge in edges]
        self.easel.lines(lines, FAINT, [0.8] * 3 + [0.45] * 6, 0.8)
        step, middle = nice_step(camera.edge / 4), _seen(camera, np.zeros(3))
        for axis in range(3):
            edge = _in_front(camera, far, axis)
            at = _seen(camera, np.where(axis == AXES, 0.0, edge))
            away = at - middle if axis < 2 else np.array([-1.0, 0.0])
            out = away / np.hypot(*away)
            low, high = camera.centre[axis] + camera.edge * HALF
            for value in step * np.arange(math.ceil(low / step), math.floor(high / step) + 1):
                part = (value - camera.centre[axis]) / camera.edge
                if abs(part) < 0.46:  # beyond, another edge has its numbers
                    spot = _seen(camera, np.where(axis == AXES, part, edge))
                    self.easel.draw(Line2D(*np.stack([spot, spot + TICK * out]).T, color=FAINT, linewidth=1))
                    self._label(spot + NUMBER * out, signed(f"{value:g}"), fontsize=12, color=FAINT)
            self._label(at + NAME * out, "xyz"[axis], fontsize=14, style="italic")

    def _label(self, spot: np.ndarray, text: str, **options: Any) -> None:
        self.easel.write(spot[0], spot[1], text, ha="center", va="center_baseline", **options)

    def _draw_gradient(self, camera: Orbit, time: float) -> None:
        """An arrow along the gradient of the concentration in the middle of the cube."""
        steps = 1e-3 * camera.edge * np.eye(3)
        found = [concentration_at(self.world, time, camera.centre + sign * steps) for sign in (1, -1)]
        slope = found[0] - found[1]
        size = float(np.linalg.norm(slope))
        if not size > 0:
            return
        (x, y, length), (right, up, _) = ARROW, camera.axes @ slope / size
        way = length * np.array([right, -up])
        start, tip = np.array([x, y]) - way / 2, np.array([x, y]) + way / 2
        back, aside = tip - 0.28 * way, 0.13 * length * np.array([up, right])
        self.easel.draw(Line2D(*np.stack([start, back]).T, color=GRADIENT, linewidth=2.2))
        self.easel.draw(Line2D(*np.stack([back + aside, tip, back - aside]).T, color=GRADIENT, linewidth=2.2))
        self.easel.write(x + 0.6 * length, y + 5, "∇c", color=GRADIENT, fontsize=14)


def _mesh(side: np.ndarray) -> np.ndarray:
    """Places (k, k, 2) of a wall, by rows of the second axis that it spans."""
    return np.stack(np.meshgrid(side, side), axis=-1)


def _seen(camera: Orbit, inside: np.ndarray) -> np.ndarray:
    """Columns and rows (..., 2) of places (..., 3) in the cube."""
    return camera.pixels(camera.flat(camera.place(inside), hiding=False))


def _wall(far: np.ndarray, axis: int, places: np.ndarray) -> np.ndarray:
    """Places (..., 3) in the cube of places (..., 2) on the far wall across an axis."""
    return np.insert(places, axis, far[axis], axis=-1)


def _in_front(camera: Orbit, far: np.ndarray, axis: int) -> np.ndarray:
    """Where the edge along an axis lies that bears its numbers: below in front, or the leftmost upright."""
    if axis < 2:
        return np.where(AXES == 2, far, -far)
    sides = [np.array([sign * far[0], -sign * far[1], 0.0]) for sign in (1, -1)]
    return min(sides, key=lambda side: float(camera.axes[0] @ side))


def _homography(seen: np.ndarray, texture: np.ndarray) -> list[float]:
    """Pillow's coefficients that map pixels (4, 2) of the picture to those (4, 2) of a texture."""
    rows, values = [], []
    for (x, y), (u, v) in zip(seen, texture, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        values += [u, v]
    found: list[float] = np.linalg.solve(np.array(rows), np.array(values)).tolist()
    return found
