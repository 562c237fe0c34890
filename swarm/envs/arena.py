"""One world and the lives of its cells, in NumPy: what the PettingZoo and Gymnasium faces share."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from swarm._support import streams
from swarm._support.arrays import where_chosen
from swarm._support.checks import check_count, check_name, check_options
from swarm.envs.spaces import state_table, told
from swarm.physics.crowd.medium import MediumState
from swarm.physics.starts import Draws, SpreadStarts, draw_record_noise, draw_starts, noise_of
from swarm.physics.world import Outcome, State, World
from swarm.physics.world.state import check_arrivals

DTYPES = {"float32": np.float32, "float64": np.float64}
POPULATION: streams.Population = "training"

Seed = int | Sequence[int | None] | None


class Arena:
    """`n_swimmers` cells in a world, each with a life of its own.

    Life number `episode[i]` of cell i starts at row i of that episode's starts, so that all faces with the
    same seed see the same lives; where each cell has a seed of its own, at that seed's first row, as it would
    alone. What raises an error leaves everything as it was.
    """

    state: State  # there after the first `reset`, as are `gain` and `action`
    gain: np.ndarray  # (cells,) c(t) − c(0) [concentration]
    action: np.ndarray  # (cells,) each cell's last
    eaten: np.ndarray  # (cells,) in earlier lives, of the medium that goes on [amount]

    def __init__(self, world: World, n_swimmers: int, dtype: str) -> None:
        self.world = world
        self.n_swimmers = check_count("n_swimmers", n_swimmers)
        check_arrivals(world, self.n_swimmers)
        self.dtype: Any = DTYPES[check_name("dtype", dtype, DTYPES)]
        self.seeds: tuple[int, ...] = ()  # one of all cells or one of each; none before the first reset
        self.episode = np.zeros(self.n_swimmers, np.int64)
        self.decision = np.zeros(self.n_swimmers, np.int64)  # of the cell's life
        self._fresh: dict[int, tuple[State, np.ndarray]] = {}
        self._noise: Draws | None = None

    def reset(self, seed: Seed, options: dict[str, Any] | None) -> np.ndarray:
        """Begin a life of every cell; returns the observations (cells, N_T · features).

        `seed` begins with its episode 0; without it the next episode of the seed in use begins, and where
        there is none yet, one is drawn from the operating system. A list gives each cell a seed of its own,
        and where it holds None, its own next episode or a drawn one's first. Poses in `options`: "position"
        (cells, 2) [length], "heading" (cells,) [rad]; in space (cells, 3) and unit quaternions (cells, 4).
        """
        seeds, episode = self._next(seed)
        state, action = self._begin(seeds, episode, check_options(options))
        observation = self.world.observation(state)
        gain = np.zeros(self.n_swimmers, self.dtype)
        self._check_finite(state, observation, gain)

        if seeds != self.seeds:
            self.seeds, self._noise = seeds, None
            self._fresh.clear()
        self.episode = episode
        self.decision = np.zeros(self.n_swimmers, np.int64)
        self.state, self.gain, self.action = state, gain, action
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

    def _next(self, seed: Any) -> tuple[tuple[int, ...], np.ndarray]:
        """The seeds, and the episode of every cell (cells,), that a reset begins."""
        first = np.zeros(self.n_swimmers, np.int64)
        own = len(self.seeds) == self.n_swimmers
        if isinstance(seed, (list, tuple)) or (isinstance(seed, np.ndarray) and seed.ndim):
            if len(seed) != self.n_swimmers:
                raise ValueError(f"seed must be one number or a list of {self.n_swimmers}, got {len(seed)}")
            given = [None if each is None else streams.check_seed(each) for each in seed]
            if any(each is not None for each in given):
                before = self.seeds if own else [streams.entropy() for _ in given]
                seeds = tuple(old if each is None else each for old, each in zip(before, given, strict=True))
                again = own & np.array([each is None for each in given])
                return seeds, np.where(again, self.episode + 1, first)
        elif seed is not None:
            return (streams.check_seed(seed),), first
        if not self.seeds:
            return (streams.entropy(),), first
        return self.seeds, (self.episode if own else first + self.episode.max()) + 1

    def _begin(
        self,
        seeds: tuple[int, ...],
        episode: np.ndarray,
        options: dict[str, Any],
        medium: MediumState | None = None,
    ) -> tuple[State, np.ndarray]:
        """State and last action where each cell's `episode` (cells,) begins, in a medium that goes on."""
        drawn = self._drawn(draw_starts, seeds, episode)
        starts: Any = type(drawn[0])(*map(np.concatenate, zip(*drawn, strict=True)))
        position = self._option(options, "position", starts.position)
        heading = self._option(options, "heading", starts.heading)
        factors = starts.factors.astype(self.dtype) if isinstance(starts, SpreadStarts) else None
        records = self._drawn(draw_record_noise, seeds, episode) if self.world.concentration_noise > 0 else ()
        noise = None if not records else np.concatenate(records).astype(self.dtype)
        state = self.world.start(position, heading, starts.past, factors, noise, medium)
        return state, self.world.action_of(starts.past[:, 0], position)

    def _drawn(self, draw: Callable[..., Any], seeds: tuple[int, ...], episode: np.ndarray) -> list[Any]:
        """What is drawn for the cells of each seed, which are in the same `episode`."""
        cells = self.n_swimmers // len(seeds)
        pairs = zip(seeds, episode[::cells].tolist(), strict=True)
        return [draw(self.world, cells, s, population=POPULATION, episode=e) for s, e in pairs]

    def _begun(
        self, episode: int, options: dict[str, Any], medium: MediumState | None
    ) -> tuple[State, np.ndarray]:
        """What `_begin` gives, kept for cells that get there later where nothing was given."""
        every = np.full(self.n_swimmers, episode)
        if medium is not None or any(options.get(name) is not None for name in ("position", "heading")):
            return self._begin(self.seeds, every, options, medium)
        if episode not in self._fresh:
            self._fresh[episode] = self._begin(self.seeds, every, {})
        return self._fresh[episode]

    def told(self) -> dict[str, np.ndarray]:
        """What infos tell of each cell's present life, see `told`."""
        found = told(self.world, self.state)
        return found | {"eaten": found["eaten"] - self.eaten} if "eaten" in found else found

    def table(self) -> np.ndarray:
        """The state of every cell, see [`state_table`][swarm.envs.spaces.state_table]."""
        return state_table(self.world, self.state, self.world.curvature_of(self.action, self.state.position))

    def _draw(self) -> np.ndarray | None:
        """This decision's random numbers (cells, 3), or None in a world without noise."""
        if not self.world.has_noise:
            return None
        if self._noise is None:
            drawn: Any = noise_of(self.world), (self.n_swimmers,), self.seeds
            self._noise = Draws(*drawn, population=POPULATION, dtype=self.dtype)
        return self._noise.at(self.episode, self.decision)

    # --- checks ---

    def _check_finite(self, state: State, observation: np.ndarray, gain: np.ndarray) -> None:
        """Raises ValueError where a field or flow gave NaN or infinity."""
        # Their squares' sum tells whether any is not finite; what is wrong with a gain is observed too.
        if math.isfinite(np.vdot(observation, observation) + np.vdot(state.position, state.position)):
            return
        found = {"position": state.position, "concentration": gain, "observation": observation}
        for name, values in found.items():
            wrong = ~np.isfinite(values).reshape(self.n_swimmers, -1).all(axis=-1)
            if wrong.any():
                i = int(wrong.argmax())
                place = ", ".join(f"{each:g}" for each in state.position[i])
                raise ValueError(
                    f"field and flow must give finite numbers, got {name} {values[i]} for swimmer_{i} at "
                    f"({place}) from {self.world.field!r} and {self.world.flow!r}"
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
