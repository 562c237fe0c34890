"""What faces have in common: the parameters of a world, and for those of an arena its state and pictures."""

from __future__ import annotations

import copy
import inspect
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from gymnasium.logger import warn

from swarm._support.checks import check_count, check_installed, check_name, optional
from swarm.envs.arena import Arena
from swarm.physics.world import State, World

RENDER_MODES = ("human", "rgb_array")
RENDER_FPS = 15
WAITING = 512  # states at most that wait until somebody asks for a picture

Face = TypeVar("Face", bound=Callable[..., Any])


def with_parameters(face: Face) -> Face:
    """A decorator: the signature shows the parameters of a world that its `**parameters`, the last, take."""
    signature = inspect.signature(face)
    *named, _ = signature.parameters.values()
    kind = inspect.Parameter.KEYWORD_ONLY
    further = [
        inspect.Parameter(name, kind, default=default)
        for name, default in World.defaults().items()
        if name not in signature.parameters
    ]
    face.__signature__ = signature.replace(parameters=[*named, *further])  # type: ignore[attr-defined]
    return face


def make_world(world: World | None, parameters: dict[str, Any]) -> World:
    """The world that is given, or one of the parameters; raises TypeError on unknown ones."""
    if world is None:
        for name in parameters:
            try:
                check_name("parameter", name, World.defaults())
            except ValueError as error:  # in Python's words too: some libraries try what they may give
                raise TypeError(f"{error} (unexpected keyword argument '{name}')") from None
        return World(**parameters)
    if parameters:
        raise TypeError(f"world must be given alone, got {sorted(parameters)} besides")
    if not isinstance(world, World):
        raise TypeError(f"world must be a World, got {world!r}")
    return world


def no_medium() -> AttributeError:
    """What a world without a medium raises where it is asked for its medium."""
    return AttributeError("medium must be a parameter of the world, got medium=None")


class Watched:
    """A face of an arena: how many decisions a life may have, where the cells are, and pictures of them."""

    metadata: dict[str, Any] = {"render_modes": [*RENDER_MODES], "render_fps": RENDER_FPS}
    arena: Arena
    world: World
    _viewer: Any = None

    def _set_up(
        self, world: World, n_swimmers: int, max_cycles: int | None, render_mode: str | None, dtype: str
    ) -> None:
        self.world, self.arena = world, Arena(world, n_swimmers, dtype)
        self.metadata = copy.deepcopy(self.metadata)  # to which wrappers add
        self.max_cycles = optional(check_count)("max_cycles", max_cycles)
        self.render_mode = optional(check_name)("render_mode", render_mode, known=RENDER_MODES)
        self._unseen: deque[State] = deque(maxlen=WAITING)  # by the viewer: following costs more than a step

    def _check_begun(self) -> None:
        if not self.arena.seeds:
            raise RuntimeError("reset must be called first")

    def state(self) -> np.ndarray:
        """Every cell (cells, 4), also those that have finished: x, y [length], heading [rad] from −π to π
        and its last curvature [1 / length]; in space (cells, 7) x, y, z and the unit quaternion w, x, y, z.
        Raises RuntimeError before the first reset.
        """
        self._check_begun()
        return self.arena.table()

    @property
    def medium(self) -> Any:
        """The medium's grid as an `xarray.DataArray` (x, y) with the nodes' places [concentration]: the whole
        field where it is carried, else its deviation from the world's field. Raises AttributeError in a world
        without a medium, RuntimeError before the first reset.
        """
        check_installed("labelled grids need", "xarray", extra="results")
        import xarray as xr

        if (medium := self.world.medium) is None:
            raise no_medium()
        self._check_begun()
        held = self.arena.state.medium
        x, y = map(np.asarray, medium.mesh.coordinates(held.origin))
        labels = {"units": "concentration", "long_name": "whole field" if medium.carried else "deviation"}
        return xr.DataArray(held.grid.copy(), {"x": x, "y": y}, ("x", "y"), "medium", labels)

    def render(self) -> Any:
        """The picture (height, width, 3) uint8 with "rgb_array"; "human" shows it in a window."""
        self._check_begun()
        if self.render_mode is None:
            warn('render: make the environment with render_mode="rgb_array" or "human" to see something')
            return None
        return self._watch().render()

    def close(self, **kwargs: Any) -> None:
        """Close the window, if there is one."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None
        super().close(**kwargs)  # type: ignore[misc]

    def _follow(self) -> None:
        """Show the viewer, where there is one, where the cells are now."""
        if self.render_mode is not None:
            self._unseen.append(self.arena.state)
            if self.render_mode == "human" or self.world.medium is not None:  # grids would fill the memory
                self._watch()

    def _watch(self) -> Any:
        from swarm.figures.viewer import Viewer

        if self._viewer is None:
            self._viewer = Viewer(self.world, window=self.render_mode == "human", fps=RENDER_FPS)
        while self._unseen:
            self._viewer.follow(self._unseen.popleft())
        return self._viewer

    def __getstate__(self) -> dict[str, Any]:
        """Everything but pictures and windows."""
        return self.__dict__ | {"_viewer": None}
