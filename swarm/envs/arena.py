"""One world and the lives of its cells, in NumPy: what the PettingZoo and Gymnasium faces share."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from gymnasium.logger import warn

from swarm._support import streams
from swarm._support.arrays import where_chosen
from swarm._support.checks import check_count, check_installed, check_name
from swarm.physics.crowd.medium import MediumState
from swarm.physics.starts import Draws, SpreadStarts, Starts, draw_record_noise, draw_starts, noise_of
from swarm.physics.world import Outcome, State, World

RENDER_MODES = ["human", "rgb_array"]
RENDER_FPS = 15
DTYPES = {"float32": np.float32, "float64": np.float64}
POPULATION: streams.Population = "training"

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
    """The world that is given, or one of the parameters; raises TypeError or ValueError on unknown ones."""
    if world is None:
        for name in parameters:
            check_name("parameter", name, World.defaults())
        return World(**parameters)
    if parameters:
        raise TypeError(f"world must be given alone, got {sorted(parameters)} besides")
    if not isinstance(world, World):
        raise TypeError(f"world must be a World, got {world!r}")
    return world


def told(world: World, state: State) -> dict[str, Any]:
    """What is told of each cell (..., cells) beside its gain: what it has `eaten` [amount] in a medium; in a
    race its `arrival_time` [time], infinite before, and whether it has `won`.
    """
    found = {} if state.medium is None else {"eaten": state.medium.eaten}
    if state.arrival_time is not None:
        found |= {"arrival_time": state.arrival_time, "won": world.won(state)}
    return found


def begins_together(world: World) -> bool:
    """Whether no cell can begin its next life before all do: where they race, or share what changes with time
    by itself or moves with them.
    """
    moves = not world.is_steady or (world.medium is not None and world.medium.leaving == "follow")
    return world.first_arrivals is not None or (world.is_shared and moves)


def no_medium() -> AttributeError:
    """What a world without a medium raises where it is asked for its medium."""
    return AttributeError("medium must be a parameter of the world, got medium=None")


class Arena:
    """`n_swimmers` cells in a world, each with a life of its own.

    Life number `episode[i]` of cell i starts at row i of that episode's starts, so that all faces with the
    same seed see the same lives. What raises an error leaves everything as it was.
    """

    state: State  # there after the first `reset`, as are `gain` and `action`
    gain: np.ndarray  # (cells,) c(t) − c(0) [concentration]
    action: np.ndarray  # (cells,) each cell's last
    eaten: np.ndarray  # (cells,) in earlier lives, of the medium that goes on [amount]

    def __init__(self, world: World, n_swimmers: int, dtype: str) -> None:
        self.world = world
        self.n_swimmers = check_count("n_swimmers", n_swimmers)
        self.dtype: Any = DTYPES[check_name("dtype", dtype, DTYPES)]
        self.seed: int | None = None
        self.episode = np.zeros(self.n_swimmers, np.int64)
        self.decision = np.zeros(self.n_swimmers, np.int64)  # of the cell's life
        self._fresh: dict[int, tuple[State, np.ndarray]] = {}
        self._noise: Draws | None = None

    def reset(self, seed: int | None, options: dict[str, Any] | None) -> np.ndarray:
        """Begin a life of every cell; returns the observations (cells, N_T · features).

        `seed` begins with its episode 0; without it the next episode of the seed in use begins, and where
        there is none yet, one is drawn from the operating system. Poses may be given:
        `options["position"]` (cells, 2) [length], `options["heading"]` (cells,) [rad]; other options are
        ignored.
        """
        if seed is not None:
            seed, episode = streams.check_seed(seed), 0
        elif self.seed is not None:
            seed, episode = self.seed, int(self.episode.max()) + 1
        else:  # the global generators stay as they are
            seed, episode = int(np.random.SeedSequence().generate_state(1, np.uint64)[0]), 0
        starts = self._starts(seed, episode)
        options = options or {}
        position = self._option(options, "position", starts.position)
        heading = self._option(options, "heading", starts.heading)
        noise = self._record_noise(seed, episode)
        state = self.world.start(position, heading, starts.past, self._factors(starts), noise)
        observation = self.world.observation(state)
        gain = np.zeros(self.n_swimmers, self.dtype)
        self._check_finite(state, observation, gain)

        if seed != self.seed:
            self.seed = seed
            self._noise = None
            self._fresh.clear()
        self.episode = np.full(self.n_swimmers, episode)
        self.decision = np.zeros(self.n_swimmers, np.int64)
        self.state, self.gain, self.action = state, gain, starts.past[:, 0]
        self.eaten = np.zeros(self.n_swimmers, self.dtype)
        return observation

    def step(self, action: np.ndarray) -> Outcome:
        """One decision of every cell; a finished cell stays where it is."""
        state, outcome = self.world.step(self.state, action, self._draw())
        if state.medium is not None:  # in which others go on eating where a cell has finished
            outcome = outcome._replace(gain=np.where(self.state.finished, self.gain, outcome.gain))
        self._check_finite(state, outcome.observation, outcome.gain)
        self.state, self.gain, self.action = state, outcome.gain, action
        self.decision = self.decision + 1
        return outcome

    def restart(self, cells: np.ndarray, options: dict[str, Any] | None = None) -> np.ndarray:
        """Begin the next life of the chosen `cells` (a mask), at their poses in the options where there are
        any, as in `reset`; returns the observations of all.
        """
        episode = self.episode + cells
        state, action, everyone = self.state, self.action, bool(cells.all())
        for number in np.unique(episode[cells]):
            begun, past = self._begun(int(number), options or {}, None if everyone else state.medium)
            mask = cells & (episode == number)
            merge = functools.partial(where_chosen, mask)
            others = state._replace(medium=None)
            state = begun._replace(medium=None).each(merge, others)._replace(medium=begun.medium)
            action = np.where(mask, past, action)
        observation = self.world.observation(state)
        gain = np.where(cells, 0.0, self.gain).astype(self.dtype)
        self._check_finite(state, observation, gain)
        if state.medium is not None:
            self.eaten = np.where(cells, state.medium.eaten, self.eaten)
        self.state, self.gain, self.action, self.episode = state, gain, action, episode
        self.decision = np.where(cells, 0, self.decision)
        for number in [number for number in self._fresh if number <= episode.min()]:
            del self._fresh[number]
        return observation

    def _starts(self, seed: int, episode: int) -> Starts:
        return draw_starts(self.world, self.n_swimmers, seed, population=POPULATION, episode=episode)

    def _begun(
        self, episode: int, options: dict[str, Any], medium: MediumState | None
    ) -> tuple[State, np.ndarray]:
        """State and last action of all cells at the beginning of an episode, in a medium that goes on."""
        given = medium is not None or any(options.get(name) is not None for name in ("position", "heading"))
        if given or episode not in self._fresh:
            assert self.seed is not None
            starts = self._starts(self.seed, episode)
            position = self._option(options, "position", starts.position)
            heading = self._option(options, "heading", starts.heading)
            further = self._factors(starts), self._record_noise(self.seed, episode)
            begun = self.world.start(position, heading, starts.past, *further, medium), starts.past[:, 0]
            if given:
                return begun
            self._fresh[episode] = begun
        return self._fresh[episode]

    def _record_noise(self, seed: int, episode: int) -> np.ndarray | None:
        cells = self.n_swimmers
        noise = draw_record_noise(self.world, cells, seed, population=POPULATION, episode=episode)
        return None if noise is None else noise.astype(self.dtype)

    def _factors(self, starts: Starts) -> np.ndarray | None:
        given: Any = starts
        return given.factors.astype(self.dtype) if isinstance(given, SpreadStarts) else None

    def told(self) -> dict[str, np.ndarray]:
        """What infos tell of each cell's present life, see `told`."""
        found = told(self.world, self.state)
        return found | {"eaten": found["eaten"] - self.eaten} if "eaten" in found else found

    def table(self) -> np.ndarray:
        """x, y [length], heading in [−π, π] [rad] and curvature [1 / length] of every cell (cells, 4)."""
        curvature = np.asarray(self.world.curvatures, self.dtype)[self.action]
        return np.column_stack([self.state.position, self.world.heading_angle(self.state), curvature])

    def _draw(self) -> np.ndarray | None:
        """This decision's random numbers (cells, 3), or None in a world without noise."""
        if not self.world.has_noise:
            return None
        if self._noise is None:
            assert self.seed is not None
            cells, seeds = (self.n_swimmers,), (self.seed,)
            self._noise = Draws(noise_of(self.world), cells, seeds, population=POPULATION, dtype=self.dtype)
        return self._noise.at(self.episode, self.decision)

    # --- checks ---

    def _check_finite(self, state: State, observation: np.ndarray, gain: np.ndarray) -> None:
        """Raises ValueError where a field or flow gave NaN or infinity."""
        # The sum of their squares tells whether any is not finite; what is wrong with a gain is observed too.
        if math.isfinite(np.vdot(observation, observation) + np.vdot(state.position, state.position)):
            return
        found = {"position": state.position, "concentration": gain, "observation": observation}
        for name, values in found.items():
            wrong = ~np.isfinite(values).reshape(self.n_swimmers, -1).all(axis=-1)
            if wrong.any():
                i = int(wrong.argmax())
                x, y = state.position[i]
                raise ValueError(
                    f"field and flow must give finite numbers, got {name} {values[i]} for swimmer_{i} at "
                    f"({x:g}, {y:g}) from {self.world.field!r} and {self.world.flow!r}"
                )

    def _option(self, options: dict[str, Any], name: str, drawn: np.ndarray) -> np.ndarray:
        """The option as an array like `drawn`, which is returned where there is no such option."""
        if options.get(name) is None:
            return drawn.astype(self.dtype)
        rule = f"options[{name!r}] must be finite numbers of shape {drawn.shape}"
        try:
            values = np.array(options[name])
            if values.dtype.kind not in "iuf":
                raise TypeError
        except (TypeError, ValueError):
            raise TypeError(f"{rule}, got {options[name]!r}") from None
        if values.shape != drawn.shape:
            raise ValueError(f"{rule}, got shape {values.shape}")
        wrong = ~np.isfinite(values)
        if wrong.any():
            i = int(np.argwhere(wrong)[0][0])
            raise ValueError(f"{rule}, got {values[i]} for swimmer_{i}")
        return values.astype(self.dtype)


class Watched:
    """What the faces of an arena share: how many decisions a life may have, and pictures of it."""

    arena: Arena
    world: World

    @property
    def medium(self) -> Any:
        """The medium's grid as an `xarray.DataArray` (x, y) with the nodes' places [concentration]: the whole
        field where it is carried, else its deviation from the world's field. Raises AttributeError in a world
        without a medium, RuntimeError before the first reset.
        """
        check_installed("labelled grids need", "xarray", extra="results")
        import xarray as xr

        medium = self.world.medium
        if medium is None:
            raise no_medium()
        if self.arena.seed is None:
            raise RuntimeError("reset must be called first")
        held = self.arena.state.medium
        x, y = (np.asarray(axis) for axis in medium.mesh.coordinates(held.origin))
        labels = {"units": "concentration", "long_name": "whole field" if medium.carried else "deviation"}
        return xr.DataArray(held.grid.copy(), {"x": x, "y": y}, ("x", "y"), "medium", labels)

    def _set_up(self, max_cycles: int | None, render_mode: str | None) -> None:
        self.max_cycles = None if max_cycles is None else check_count("max_cycles", max_cycles)
        self.render_mode = (
            None if render_mode is None else check_name("render_mode", render_mode, RENDER_MODES)
        )
        self._viewer: Any = None

    def _follow(self) -> None:
        """Show the viewer, where there is one, where the cells are now."""
        if self.render_mode is not None:
            self._watch().follow(self.arena.state)

    def _picture(self) -> np.ndarray | None:
        if self.render_mode is None:
            warn('render: make the environment with render_mode="rgb_array" or "human" to see something')
            return None
        return self._watch().render(self.arena.state)

    def _watch(self) -> Any:
        from swarm.figures.viewer import Viewer

        if self._viewer is None:
            self._viewer = Viewer(self.world, window=self.render_mode == "human", fps=RENDER_FPS)
        return self._viewer

    def _close(self) -> None:
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None

    def __getstate__(self) -> dict[str, Any]:
        """Everything but pictures and windows."""
        return self.__dict__ | {"_viewer": None}
