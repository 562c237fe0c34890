"""The picture: what stands still is drawn once, the swimmers and the numbers over it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from swarm.figures.scene.easel import DARK, FAINT, LEFT, RIGHT, Easel, signed
from swarm.figures.scene.glance import TRAIL, Camera, Glance, Segment, Teams, contact_of, places_behind
from swarm.figures.scene.orbit import Helices, Orbit
from swarm.figures.scene.volume import Volume
from swarm.figures.scene.water import Water
from swarm.figures.style import ON_DARK, in_style, plain, team_colours
from swarm.physics.world import World

CURVE = (190, 290)  # rows of the curve of gains
FIRST_TEAM, TEAM = 436, 24  # row of the name of a team, and from one to the next [pixels]
TAIL = 1.1  # decisions that a flagellum reaches back
WAVE, BEAT, BEND = 0.8, 0.8, 0.04  # of a flagellum: decisions a wave, waves a decision, height [length]
Sight = Camera | Orbit
Path = Segment | Helices
SHADOW, GOLD, HEAD, RESTING = "#05080f", "#ffcc6b", "#ffffff", "#99a8bd"


class Scene:
    """Draws pictures (720, 960, 3) uint8 of one world, its cells steered by one policy or by `teams`.

    Colours run over all values that have been in view. What stands still while the cells swim is drawn once
    for every place of the camera, or where it changes, for every time.
    """

    def __init__(self, world: World, teams: Teams | None = None) -> None:
        self.world, self.teams = world, teams
        self.seen: tuple | None = None  # for which the backdrop is drawn
        self.contact = contact_of(world)
        names = [] if teams is None else list(teams.names)
        self.tints = dict(enumerate(ON_DARK[each] for each in team_colours(names)))
        lower = TEAM * len(self.tints) + 34 if self.tints else 0
        with in_style(DARK):
            self.easel = Easel()
            self.water = (Water if world.dimensions == 2 else Volume)(world, self.easel, lower)
            shown = "flow speed" if self.water.shows_flow else "concentration"
            labels = [(52, "time"), (130, "mean gain"), (340, "swimming"), (416 + lower, shown)]
            labels += [(FIRST_TEAM - TEAM, "steered by")] if names else []
            for row, label in labels:
                self.easel.write(LEFT, row, label, fontsize=13, color=FAINT)
            for i, name in enumerate(names):
                row = FIRST_TEAM + TEAM * i
                dot = Line2D([LEFT + 6], [row - 5], color=self.tints[i], marker="o", markersize=11)
                self.easel.draw(dot, markeredgecolor=HEAD, markeredgewidth=1.0)
                text = name if len(name) <= 22 else "…" + name[-21:]
                self.easel.write(LEFT + 20, row, plain(text), fontsize=13)
            self.paper = self.backdrop = self.easel.kept()

    def picture(
        self, camera: Sight, glance: Glance, trail: Sequence[Path], curve: np.ndarray, share: float = 1.0
    ) -> np.ndarray:
        """The cells of a `glance`, `share` of whose latest segment is swum, and their `trail` (oldest first).

        `curve` (decisions, 4) holds time and the mean, least and largest gain.
        """
        seen: Any = camera, glance.closed, float(glance.time.max()) if self.water.changes else None
        with in_style(DARK):
            if seen != self.seen:
                self.easel.restore(self.paper)
                self.water.draw(camera, glance)
                self.seen, self.backdrop = seen, self.easel.kept()
            self.easel.restore(self.backdrop)
            self._draw_swimmers(camera, glance, trail, len(curve) + share, share)
            self._draw_numbers(curve, glance)
        return self.easel.image()

    def _draw_swimmers(
        self, camera: Sight, glance: Glance, trail: Sequence[Path], clock: float, share: float
    ) -> None:
        """Fading trails, flagella that beat, and heads; `clock` counts decisions."""
        place, heading = glance.position, glance.heading
        if trail:
            oldest = len(trail) - 1 + share
            swum = places_behind(trail, share, np.linspace(0, oldest, 8 * len(trail) + 1))
            lines, age = camera.pixels(camera.flat(swum)), np.linspace(0, oldest, 2 * len(trail))
            fading = (1 - age / TRAIL) ** 1.5 * np.clip(0.25 + age / TAIL, 0, 1)  # less under the flagellum
            if isinstance(camera, Orbit):
                self.easel.fade(camera.pixels(camera.flat(camera.below(swum))), HEAD, 0.16 * fading, 1.2)
            for colour, cells in camera.layers(self._by_team() or [(GOLD, np.ones(len(place), bool))], place):
                self.easel.fade(lines[cells], colour, 0.16 * fading, 6.0)
                self.easel.fade(lines[cells], colour, 0.85 * fading, 1.6)
            back = np.linspace(0, min(TAIL, oldest), 25)
            tail = camera.flat(places_behind(trail, share, back))
            phase = back / WAVE - BEAT * clock + 0.38 * np.arange(len(tail))[:, None]  # each its own
            bent = BEND * np.minimum(1, back / 0.5) * np.sin(2 * np.pi * phase)
            along = np.exp(1j * np.angle(np.gradient(tail, axis=1)))
            self.easel.fade(camera.pixels(tail + 1j * along * bent), HEAD, np.linspace(1, 0.2, 12), 1.8)
            latest = trail[-1]
            seen = latest.seen.reshape(-1, *(1,) * (place.ndim - 1))
            place = np.where(seen, latest.places(np.array([share]))[:, 0], place)
            heading = latest.heading(share, heading)
        self._draw_heads(camera, glance, place, camera.angle(place, heading))

    def _draw_heads(self, camera: Sight, glance: Glance, place: np.ndarray, angle: np.ndarray) -> None:
        """Heads over their disks, those at rest below; who has won sits at the egg, and bright."""
        resting, heads = glance.finished, np.full(len(place), HEAD, dtype=object)
        if glance.won is not None and self.world.egg is not None:
            (x, y), radius = self.world.egg
            away = glance.position - complex(x, y)
            inwards = np.where(away == 0, 1.0, away / np.maximum(np.abs(away), 1e-12))
            place = np.where(glance.won, complex(x, y) + radius * inwards, place)
            angle = np.where(glance.won, np.angle(-inwards), angle)
            resting = glance.finished & ~glance.won
            heads[glance.won] = GOLD
        for tint, cells in self._by_team():
            heads[cells] = tint
        across, wide = 2 * min(max(0.11 * camera.scale, 4.0), 7.0), self.contact * camera.scale
        if wide > across:  # disks that push each other apart, where they are seen
            disks = camera.pixels(place[~glance.finished | glance.finished.all()])
            size = np.full(len(disks), wide)
            look = {"facecolors": (HEAD, 0.12), "edgecolors": (HEAD, 0.55), "linewidths": 1.0}
            self.easel.ellipses(disks, size, size, 0 * size, **look)
        first = camera.order(place, resting)
        length = np.full(len(first), across)
        length = length * camera.nearness(place[first])
        colours = np.where(resting, RESTING, heads)[first].tolist()
        places, tilt = camera.pixels(camera.flat(place[first])), np.degrees(angle[first])
        rim = {"facecolors": colours, "edgecolors": SHADOW, "linewidths": 1.2}
        self.easel.ellipses(places, length, 0.62 * length, tilt, **rim)

    def _by_team(self) -> list[tuple[str, np.ndarray]]:
        """The colour of each team, and which cells are its."""
        if self.teams is None:
            return []
        return [(tint, self.teams.steered_by == number) for number, tint in self.tints.items()]

    def _draw_numbers(self, curve: np.ndarray, glance: Glance) -> None:
        """Time, gain, how many swim; mean gain over time between the least and the largest of all cells."""
        time, mean, least, largest = curve.T
        finished, write = glance.finished, self.easel.write
        write(LEFT, 84, f"{time[-1]:.2f}", fontsize=27, weight="bold")
        write(LEFT, 162, signed(f"{mean[-1]:+z.2f}"), fontsize=27, weight="bold", color=GOLD)
        write(LEFT, 366, f"{int((~finished).sum())} of {len(finished)}", fontsize=18)
        if glance.won is not None and self.world.race is not None:
            came, needed = int(glance.won.sum()), self.world.race.arrivals
            late = f" +{came - needed}" if came > needed else ""  # but before the egg closed
            write(LEFT + 104, 340, "closed egg" if glance.closed else "at the egg", fontsize=13, color=FAINT)
            write(LEFT + 104, 366, f"{min(came, needed)} of {needed}{late}", fontsize=18, color=GOLD)
            for i, (_, cells) in enumerate(self._by_team()):
                wins = str(int((glance.won & cells).sum()))
                write(RIGHT, FIRST_TEAM + TEAM * i, wins, fontsize=13, color=GOLD, ha="right")
        ends = min(float(least.min()), 0.0), max(float(largest.max()), 1e-9)
        x = np.interp(time, (0, max(time[-1], 1e-9)), (LEFT, RIGHT))
        zero, mean, least, largest = (np.interp(y, ends, CURVE[::-1]) for y in (0.0, mean, least, largest))
        self.easel.draw(Line2D([LEFT, RIGHT], [zero, zero], color=FAINT, linewidth=0.6))
        band = np.stack([np.append(x, x[::-1]), np.append(largest, least[::-1])], axis=-1)
        self.easel.draw(Polygon(band, color=GOLD, alpha=0.25, linewidth=0))
        self.easel.draw(Line2D(x, mean, color=GOLD, linewidth=1.8))
