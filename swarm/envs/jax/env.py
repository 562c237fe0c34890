"""The JAX face: a world whose lives begin, go on and begin again inside compiled code."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap

from swarm._support.arrays import join, where_chosen
from swarm._support.checks import check_count, check_name, optional
from swarm.envs.face import make_world, with_parameters
from swarm.envs.spaces import action_space, observation_space, of_shape, told
from swarm.physics.motion.arc import Pose, components
from swarm.physics.motion.swimmer import Way
from swarm.physics.starts import draw_starts
from swarm.physics.world import State, World
from swarm.physics.world.state import check_arrivals

Array = Any

DTYPES = {"float32": jnp.float32, "float64": jnp.float64}


class EnvState(NamedTuple):
    """All that `JaxSwarmEnv` carries from one decision to the next."""

    cells: State  # (cells, ...)
    decision: Array  # () int32: decisions of the present life
    gain: Array  # (cells,) c(t) − c(0) [concentration]


class Step(NamedTuple):
    """What a decision led to; of a cell that had finished before, reward and flags are 0."""

    observation: Array  # (cells, N_T · features) float32
    state: EnvState
    reward: Array  # (cells,)
    terminated: Array  # (cells,) bool: reached the egg in this decision, or the race is over
    truncated: Array  # (cells,) bool: out of time, or left the domain, in this decision
    info: dict[str, Array]


class JaxSwarmEnv:
    """A world of `n_swimmers` cells as functions that `jit`, `vmap` and `scan` take; arguments as
    `swarm.parallel_env`, with `dtype` "float32" or, where `jax_enable_x64` is on, "float64".

        env = JaxSwarmEnv(40, flow="taylor_green")
        observation, state = jax.vmap(env.reset)(jax.random.split(key, 1024))
        observation, state, reward, terminated, truncated, info = jax.vmap(env.step)(keys, state, action)

    A cell that has finished waits until all of its world have; then the world begins anew in the same step,
    as in Gymnasium's "SameStep": the observation is the new life's first, `info["final_observation"]` the old
    one's last. `info` has beside it, of the life before, `gain` (cells,) [concentration]; `valid`, who was
    alive before the decision, and `finished`, whose life is over after it (cells,) bool; in a medium `eaten`;
    in a race `arrival_time`, `won`.

    Starts, noise and spread have the distributions of the other faces, but are drawn by `jax.random` from the
    key: the same key gives the same life, no seed of another face does. `vmap` makes one call of all worlds
    at once, in which new lives are computed only where one begins. Raises what the other faces raise, and
    TypeError where a field, flow, sensor or reward cannot be traced by JAX.
    """

    @with_parameters
    def __init__(
        self,
        n_swimmers: int = 40,
        *,
        dtype: str = "float32",
        max_cycles: int | None = None,
        world: World | None = None,
        **parameters: Any,
    ) -> None:
        self.world = make_world(world, parameters)
        self.n_swimmers = check_count("n_swimmers", n_swimmers)
        check_arrivals(self.world, n_swimmers)
        self.max_cycles = optional(check_count)("max_cycles", max_cycles)
        self.dtype = DTYPES[check_name("dtype", dtype, DTYPES)]
        if dtype == "float64" and not jax.config.jax_enable_x64:
            raise ValueError("dtype must be 'float32' unless jax_enable_x64 is on, got 'float64'")
        self.single_observation_space = observation_space(self.world)
        self.single_action_space = action_space(self.world)
        self._reset, self._step = _whole(self._begun), _whole(self._stepped)
        draw_starts(self.world, self.n_swimmers, 0)  # raises where the box leaves no room
        self._check_traced()

    @property
    def max_steps(self) -> int:
        """Decisions of the longest life."""
        longest = self.world.max_decisions
        return longest if self.max_cycles is None else min(longest, self.max_cycles)

    @functools.partial(jax.jit, static_argnums=0)
    def reset(self, key: Array) -> tuple[Array, EnvState]:
        """Begin a life of every cell; returns the observation (cells, N_T · features) and the state."""
        return self._reset(_typed(key))

    @functools.partial(jax.jit, static_argnums=0)
    def step(self, key: Array, state: EnvState, action: Array) -> Step:
        """One decision of every cell, `action` (cells,) whole numbers 0 … m − 1, or curvatures (cells,) or
        (cells, 1) where these are the actions; where all have finished, the next life begins. Raises
        TypeError for an action of another kind, ValueError of another shape; its values are not looked at.
        """
        return self._step(_typed(key), state, of_shape(self.world, action, (self.n_swimmers,)))

    @functools.partial(jax.jit, static_argnums=0)
    def step_env(self, key: Array, state: EnvState, action: Array) -> Step:
        """`step` that leaves finished worlds as they are; it can be differentiated."""
        return self._advanced(_typed(key), state, of_shape(self.world, action, (self.n_swimmers,)))

    def render(self, state: EnvState) -> np.ndarray:
        """A picture (720, 960, 3) uint8 of one world."""
        from swarm.figures.viewer import Viewer

        viewer = Viewer(self.world)
        viewer.follow(state.cells.each(np.asarray))
        return viewer.picture()

    # --- arrays with any leading axes: worlds ---------------------------------------------------------------

    def _begun(self, key: Array) -> tuple[Array, EnvState]:
        """The beginning of worlds, of a key each (...)."""
        cells = self.world.start(**_each(self._starts, key))
        gain = jnp.zeros_like(cells.start_concentration)
        return self.world.observation(cells), EnvState(cells, jnp.zeros(key.shape, jnp.int32), gain)

    def _stepped(self, key: Array, state: EnvState, action: Array) -> Step:
        step = self._advanced(key, state, action)
        over = jnp.all(step.info["finished"], axis=-1)

        def begin(kept: tuple[Array, EnvState]) -> tuple[Array, EnvState]:
            fresh = self._begun(_each(lambda one: jax.random.fold_in(one, 1), key))
            return jax.tree.map(functools.partial(where_chosen, over), fresh, kept)

        last = step.observation, step.state
        observation, after = jax.lax.cond(jnp.any(over), begin, lambda kept: kept, last)
        info = step.info | {"final_observation": step.observation}
        return step._replace(observation=observation, state=after, info=info)

    def _advanced(self, key: Array, state: EnvState, action: Array) -> Step:
        world, alive = self.world, ~state.cells.finished
        noise = _each(lambda one: self._noise(jax.random.fold_in(one, 0)), key) if world.has_noise else None
        cells, outcome = world.step(state.cells, action, noise, self._way(state.cells, action, noise))
        decision = state.decision + 1
        terminated, truncated = outcome.terminated & alive, outcome.truncated & alive
        if self.max_cycles is not None:
            late = (decision >= self.max_cycles)[..., None]
            truncated = truncated | (late & alive & ~terminated)
            cells = cells._replace(finished=cells.finished | truncated)
        gain = outcome.gain if world.medium is None else jnp.where(alive, outcome.gain, state.gain)
        reward = jnp.where(alive, outcome.reward, jnp.zeros_like(outcome.reward))
        info = {"gain": gain, "valid": alive, "finished": cells.finished} | told(world, cells)
        after = EnvState(cells, decision, gain)
        return Step(outcome.observation, after, reward, terminated, truncated, info)

    def _way(self, cells: State, action: Array, noise: Array) -> Way:
        """The way of an action, swum where anybody lives.

        Its numbers leave a branch one by one: else XLA swims anew for each that is later read off them.
        """

        def swum() -> tuple[Array, ...]:
            pose, path, _ = self.world.way(cells, action, noise)
            return *components(pose.position), *components(pose.heading), path

        def stood() -> tuple[Array, ...]:
            way = jax.eval_shape(swum)[-1]
            path = None if way is None else jnp.broadcast_to(cells.position, way.shape)
            return *components(cells.position), *components(cells.heading), path

        *columns, path = jax.lax.cond(_all_over(cells.finished), stood, swum)
        place, heading = columns[: self.world.dimensions], columns[self.world.dimensions :]
        interval = self.world.way(cells, action, noise).interval
        return Way(Pose(join(*place), join(*heading)), path, interval)

    # --- draws of one world ---------------------------------------------------------------------------------

    def _starts(self, key: Array) -> dict[str, Array]:
        """What `World.start` takes; poses are uniform where cells may begin."""
        world, cells, size = self.world, self.n_swimmers, self.world.dimensions
        sides = (*world.box, (-np.pi, np.pi))[:3]  # in the plane the heading's too
        low, high = np.asarray(sides, self.dtype).T

        def drawn(key: Array, columns: int = 0) -> tuple[Array, Array]:
            uniform = jax.random.uniform(key, (cells, 3 + columns), self.dtype)
            return low + (high - low) * uniform[:, :3], uniform[:, 3:]

        def again(carry: tuple[Array, Array]) -> tuple[Array, Array]:
            key, now = jax.random.split(carry[0])
            bad = self._is_no_start(carry[1][:, :size])
            return key, jnp.where(bad[:, None], drawn(now)[0], carry[1])

        pose, past = drawn(key, world.n_records)
        if world.egg is not None or world.domains:
            first = jax.random.fold_in(key, 0), pose
            pose = jax.lax.while_loop(lambda c: jnp.any(self._is_no_start(c[1][:, :size])), again, first)[1]
        found = {"position": pose[:, :size], "heading": pose[:, -1]}
        if size == 3:
            rotation = jax.random.normal(jax.random.fold_in(key, 3), (cells, 4), self.dtype)
            found["heading"] = rotation / jnp.linalg.norm(rotation, axis=-1, keepdims=True)
        found["past"] = jnp.floor(past * world.n_actions).astype(jnp.int32)
        if world.spread is not None:
            normal = jax.random.normal(jax.random.fold_in(key, 1), (cells, 2), self.dtype)
            found["factors"] = world.spread.factors(normal)
        if world.concentration_noise > 0:
            shape = (cells, world.n_records)
            found["noise"] = jax.random.normal(jax.random.fold_in(key, 2), shape, self.dtype)
        return found

    def _is_no_start(self, position: Array) -> Array:
        bad = jnp.zeros(position.shape[:-1], bool)
        if self.world.egg is not None:
            centre, radius = self.world.egg
            away = position - np.asarray(centre, self.dtype)
            bad = jnp.linalg.norm(away, axis=-1) <= radius
        for inside in self.world.domains:
            bad = bad | ~inside(position)
        return bad

    def _noise(self, key: Array) -> Array:
        """What `World.step` takes as noise."""
        noise = jax.random.normal(key, (self.n_swimmers, 3), self.dtype)
        if self.world.binding_rate is None:
            return noise
        uniform = jax.random.uniform(jax.random.fold_in(key, 1), (self.n_swimmers, 1), self.dtype)
        return jnp.concatenate([noise, uniform], axis=-1)

    def _check_traced(self) -> None:
        """Raises TypeError where JAX cannot trace a decision, or states would change their types."""
        kind = self.dtype if self.world.is_continuous else jnp.int32
        key, action = jax.random.key(0), jax.ShapeDtypeStruct((self.n_swimmers,), kind)
        parts = ", ".join(f"{name}={getattr(self.world, name)!r}" for name in ("field", "flow"))
        rule = f"world must compute with JAX's arrays alone, got {parts}"
        try:
            _, state = jax.eval_shape(self.reset, key)
            after = jax.eval_shape(self.step_env, key, state, action).state
            jax.eval_shape(self.step, key, state, action)
        except Exception as error:  # of whatever library was given a tracer
            raise TypeError(f"{rule} ({type(error).__name__}: {str(error).splitlines()[0]})") from error
        wrong = [
            (a, b) for a, b in zip(*map(jax.tree.leaves, (state, after)), strict=True) if a.dtype != b.dtype
        ]
        if wrong:
            raise TypeError(f"{rule} (a decision makes {wrong[0][1].dtype} of {wrong[0][0].dtype})")


def _typed(key: Array) -> Array:
    """A key of the new kind, whichever is given; raises TypeError for what is none."""
    dtype = getattr(key, "dtype", None)
    if dtype is None or not (
        jnp.issubdtype(dtype, jax.dtypes.prng_key) or (key.ndim and dtype == jnp.uint32)
    ):
        got = key if dtype is None else f"{key.shape} of {dtype}"
        raise TypeError(f"key must be one of jax.random, as jax.random.key(0) makes it, got {got}")
    return key if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else jax.random.wrap_key_data(key)


def _each(function: Callable[[Array], Any], key: Array) -> Any:
    """What a function of one key gives of keys (...)."""
    for _ in range(key.ndim):
        function = jax.vmap(function)
    return function(key)


@custom_vmap
def _all_over(finished: Array) -> Array:
    """Whether all cells of all worlds have finished: one answer, which `vmap` does not multiply."""
    return jnp.all(finished)


@_all_over.def_vmap
def _(size: int, batched: Any, finished: Array) -> tuple[Array, bool]:
    return _all_over(finished), False


def _whole(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` of arrays with any leading axes, which `vmap` calls once, with one axis more."""
    mapped = custom_vmap(function)

    def rule(size: int, batched: Any, *given: Any) -> tuple[Any, Any]:
        def lengthened(array: Array, there: bool) -> Array:
            return array if there else jnp.broadcast_to(array, (size, *array.shape))

        found = mapped(*jax.tree.map(lengthened, given, tuple(batched)))
        return found, jax.tree.map(lambda _: True, found)

    mapped.def_vmap(rule)
    return mapped
