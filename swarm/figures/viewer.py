"""Watching a swarm as it goes: what is followed from state to state, and the window that shows it."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from swarm._support.checks import check_installed
from swarm.figures.scene import PANEL, SIZE, TRAIL, Camera, Glance, Helices, Orbit, Scene, Segment, Teams
from swarm.physics.motion.arc import Pose
from swarm.physics.world import State, World

SMALLEST_VIEW = 9.0  # [length]
EASE = 0.12  # share of the way to where it should be that the camera goes with each decision
FRAMES = 4  # pictures of a decision in a window


class Viewer:
    """Draws the swarm as it goes; `follow` every state in turn, then take a `picture`.

    The camera follows the cells that are alive. Colours run over all that has been in view, so a swarm that
    climbs comes to brighter places. Cells of several policies are coloured by their `teams`. With
    `window=True` every state that is followed is shown, at `fps` pictures per second (needs pygame).
    """

    def __init__(
        self, world: World, *, window: bool = False, fps: int = 15, teams: Teams | None = None
    ) -> None:
        self.world, self.teams = world, teams
        self.window = Window(SIZE + PANEL, SIZE, fps) if window else None
        self._forget()

    def _forget(self) -> None:
        self.glance: Glance | None = None
        self.trail: deque[Any] = deque(maxlen=TRAIL)
        self.curve: list[tuple[float, float, float, float]] = []  # time; mean, least and largest gain
        self.camera: Any = None  # `Camera`, in space `Orbit`
        self.scene = Scene(self.world, self.teams)

    def follow(self, state: State) -> None:
        """Take in the next state; cells that began a new life leave their trail behind."""
        glance, before = self._look(state), self.glance
        if before is not None:
            moved = glance.time > before.time
            off = glance.position != before.position
            begun = ~moved & (off.any(axis=-1) if off.ndim > 1 else off)
            if begun.all():
                self._forget()
            else:
                self._lengthen(before, glance, moved, begun)
        self.glance = glance
        self.camera = self._aim(glance)
        time, gain = glance.time.max(), glance.gain
        self.curve.append((float(time), float(gain.mean()), float(gain.min()), float(gain.max())))
        if self.window is not None:
            frames = FRAMES if self.trail else 1
            for i in range(frames):
                self.window.show(self.picture((i + 1) / frames))

    def render(self) -> np.ndarray | None:
        """The picture of the latest state; None where a window shows it."""
        if self.window is None:
            return self.picture()
        self.window.show(self.picture())
        return None

    def picture(self, share: float = 1.0) -> np.ndarray:
        """The picture (720, 960, 3) uint8 at a `share` of the latest decision, 1 being its end."""
        if self.glance is None or self.camera is None:
            raise RuntimeError("follow must be given a state first")
        camera = self.camera
        if isinstance(camera, Orbit):
            camera = camera.turned(len(self.curve) - 1 + share)
        return self.scene.picture(camera, self.glance, self.trail, np.array(self.curve), share)

    def close(self) -> None:
        """Close the window."""
        if self.window is not None:
            self.window.close()

    def _look(self, state: State) -> Glance:
        world, in_space = self.world, self.world.dimensions == 3
        gain = world.concentration(state) - state.start_concentration
        race, time = world.race, np.asarray(world.time(state), float)
        closed = race is not None and bool((race.closes(state.arrival_time) <= time.max()).all())
        position = np.asarray(state.position, float)
        return Glance(
            position if in_space else position @ [1, 1j],
            np.asarray(world.direction(state) if in_space else world.heading_angle(state), float),
            np.asarray(world.curvature(state), float),
            time,
            np.asarray(gain, float),
            np.asarray(state.finished),
            None if race is None else np.asarray(world.won(state)),
            closed,
            state.medium,
            np.asarray(state.heading, float) if in_space else None,
        )

    def _lengthen(self, before: Glance, now: Glance, moved: np.ndarray, begun: np.ndarray) -> None:
        """Add what was swum between two glances to the trails."""
        for i, segment in enumerate(self.trail):
            self.trail[i] = segment._replace(seen=segment.seen & ~begun)
        bend, wait = now.curvature, np.where(moved, now.time - before.time, 0.0)
        if self.world.dimensions == 3:
            start = Pose(before.position, before.orientation)
            self.trail.append(Helices.of(self.world, start, now.position, bend, wait, moved))
            return
        turn = bend * np.interp(bend, self.world.curvatures, self.world.action_speeds) * wait
        excess = np.angle(np.exp(1j * (now.heading - before.heading - turn)))  # by flow and noise
        self.trail.append(Segment(before.position, now.position - before.position, turn + excess, moved))

    def _aim(self, glance: Glance) -> Camera | Orbit:
        """Move the camera towards the cells that are alive, at once where it has not been."""
        places = glance.position if glance.finished.all() else glance.position[~glance.finished]
        if places.ndim > 1:
            return Orbit.around(places, self.camera, self.world.egg)
        x, y = places.real, places.imag
        width = max(1.12 * float(max(np.ptp(x), np.ptp(y))) + 1.0, SMALLEST_VIEW)
        ideal = Camera(float(x.min() + x.max()) / 2, float(y.min() + y.max()) / 2, width)
        if self.camera is None:
            return ideal
        moved = Camera(*(old + EASE * (new - old) for old, new in zip(self.camera, ideal, strict=True)))
        needed = 2 * float(max(np.abs(x - moved.x).max(), np.abs(y - moved.y).max())) + 1.0
        return moved._replace(width=max(moved.width, needed))


class Window:
    """Shows pictures of one size on the screen, through pygame.

    Raises ModuleNotFoundError where pygame is missing, OSError where the display cannot be used. Without a
    display pygame keeps the pictures to itself, and `visible` is False.
    """

    def __init__(self, width: int, height: int, fps: int) -> None:
        check_installed('render_mode="human" needs', "pygame", extra="render")
        import pygame

        self.pygame: Any = pygame
        try:
            pygame.display.init()
            self.surface = pygame.display.set_mode((width, height))
        except pygame.error as error:
            raise OSError(f"a window needs a display, got {error}") from None
        self.visible = pygame.display.get_driver() not in ("dummy", "offscreen")
        pygame.display.set_caption("chemoswarm")
        self.clock = pygame.time.Clock()
        self.fps = fps

    def show(self, image: np.ndarray) -> None:
        """Show an image (height, width, 3) uint8, not sooner than the frame rate allows."""
        frame = self.pygame.image.frombuffer(image.tobytes(), image.shape[1::-1], "RGB")
        self.surface.blit(frame, (0, 0))
        self.pygame.event.pump()
        self.pygame.display.flip()
        self.clock.tick(self.fps)

    def close(self) -> None:
        """Close it."""
        self.pygame.display.quit()
