"""Random worlds, random decisions: what must hold whatever the parameters."""

import functools

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from swarm.physics.fields import (
    DiffusingSource,
    FunctionField,
    GaussianPlume,
    GriddedField,
    LinearField,
    RadialField,
)
from swarm.physics.flows import (
    FunctionFlow,
    GriddedFlow,
    PoiseuilleFlow,
    ShearFlow,
    StillWater,
    TaylorGreen,
    UniformFlow,
    Vortex,
)
from swarm.physics.starts import draw_noise, draw_starts
from swarm.physics.world import World


@functools.cache
def gridded(edges):
    """A rough field and flow on a grid of ten by twelve points."""
    rng = np.random.default_rng(0)
    x, y = np.linspace(-3, 13, 10), np.linspace(-4, 14, 12)
    data = xr.Dataset(
        {
            name: (("x", "y"), rng.normal(size=(10, 12)) * size)
            for name, size in (("c", 2), ("u_x", 0.1), ("u_y", 0.1))
        },
        coords={"x": x, "y": y},
    )
    return GriddedField(data, edges=edges, variable="c"), GriddedFlow(data, edges=edges)


def numbers(low, high):
    return st.floats(low, high, allow_nan=False)


scales = numbers(0.1, 5.0)
places = st.tuples(numbers(-3, 12), numbers(-3, 12))

FIELDS = st.one_of(
    st.builds(LinearField, gradient_scale=scales, offset=numbers(-50, 50)),
    st.builds(RadialField, gradient_scale=scales, egg_radius=scales),
    st.builds(
        GaussianPlume,
        gradient_scale=scales,
        width=numbers(1, 20),
        egg_position=places,
        egg_radius=st.none() | scales,
    ),
    st.builds(DiffusingSource, gradient_scale=scales, core=numbers(0.5, 3), egg_position=places),
    st.just(FunctionField(lambda r: r[..., 0] - 2 * r[..., 1], gradient_scale=2.0, max_gradient=2.24)),
    st.sampled_from(["periodic", "clamped"]).map(lambda edges: gridded(edges)[0]),
)
speeds = numbers(0.01, 0.8)
FLOWS = st.one_of(
    st.just(StillWater()),
    st.builds(TaylorGreen, speed_scale=speeds, wavenumber=numbers(0.1, 2)),
    st.builds(UniformFlow, st.tuples(speeds, speeds)),
    st.builds(ShearFlow, speed_scale=speeds, height=numbers(1, 20)),
    st.just(PoiseuilleFlow(walls=(-1.0, 12.0))),
    st.builds(Vortex, speed_scale=speeds, core=numbers(0.3, 5), centre=places, clockwise=st.booleans()),
    st.just(FunctionFlow(TaylorGreen().velocity, 0.1, 0.1 * np.pi / 10, max_speed=0.1, max_spin=0.032)),
    st.sampled_from(["periodic", "clamped"]).map(lambda edges: gridded(edges)[1]),
)
NOISE = st.just(0.0) | numbers(0.001, 0.5)


@st.composite
def worlds(draw):
    flow = draw(FLOWS)
    first, step = draw(numbers(0.5, 6.0)), draw(numbers(0.2, 3.0))
    try:
        return World(
            n_records=draw(st.integers(2, 12)),
            field=draw(FIELDS),
            flow=flow,
            sense_flow=draw(st.booleans()) and flow.spin_scale > 0,
            varying_speed=draw(st.booleans()),
            life=draw(numbers(0.05, 20.0)),
            start_box=((0.0, 9.0), (1.0, 10.0)),
            curvatures=tuple(np.linspace(first, first + step, draw(st.integers(2, 4)))),
            speed=draw(numbers(0.3, 2.0)),
            speeds=(draw(numbers(0.3, 2.0)), draw(numbers(0.3, 2.0))),
            time_step=draw(st.sampled_from([0.005, 0.02, 0.03])),
            interval_rule=draw(st.sampled_from(["truncated", "exact"])),
            concentration_noise=draw(NOISE),
            curvature_noise=draw(NOISE),
            rotational_diffusion=draw(NOISE),
        )
    except ValueError as error:
        # the only things that these parameters can get wrong
        if "time_step" not in str(error) and "flow must vary slowly" not in str(error):
            raise
        reject()


def check_life(world, cells, dtype, seed, decisions):
    """Lives some decisions of random actions and checks, decision by decision, what must hold."""
    starts = draw_starts(world, cells, seed)
    state = world.start(starts.position.astype(dtype), starts.heading.astype(dtype), starts.past)
    rng = np.random.default_rng(seed)
    noise = draw_noise(seed, cells, decisions).astype(dtype) if world.has_noise else None
    bounds = world.observation_bounds
    rounding = 50 * float(np.finfo(dtype).eps)
    scale = np.abs(state.memory[..., 0]).max() + 100 * world.record_scale  # of records, for their rounding
    rewards = np.zeros(cells, dtype)
    first_mean = state.memory[..., 0].mean(axis=-1)
    fastest = max(world.action_speeds) + (getattr(world.flow, "max_speed", None) or 0.0)
    bounded = None not in (getattr(world.flow, "max_speed", None), getattr(world.field, "max_gradient", None))
    for turn in range(decisions):
        action = rng.integers(world.n_actions, size=cells)
        before, time_before = state, world.time(state)
        state, outcome = world.step(state, action, None if noise is None else noise[:, turn])
        alive = ~before.finished
        time = world.time(state)

        for part in (*state.named("").values(), *outcome):
            assert np.all(np.isfinite(part))
        assert outcome.observation.dtype == np.float32
        assert np.all(np.abs(outcome.observation) <= bounds)
        assert np.abs(np.linalg.norm(state.heading, axis=-1) - 1).max() < rounding

        # clocks: monotone, by whole intervals until the last, which ends at the life exactly
        assert np.all(time >= time_before)
        assert np.all(time <= dtype(world.life))
        up = world.clock.is_up(state.clock)
        assert np.all(time[up] == dtype(world.life))
        whole = np.asarray(world.intervals)[action]
        on_the_way = alive & ~up
        np.testing.assert_allclose(
            (time - time_before)[on_the_way], whole[on_the_way], rtol=0, atol=rounding * world.life
        )
        assert np.all((time - time_before)[alive] <= whole[alive] + rounding * world.life + 1e-6 * world.life)

        # rewards telescope to the change of the memory's mean
        rewards = rewards + np.where(alive, outcome.reward, 0)
        change = (state.memory[..., 0].mean(axis=-1) - first_mean) * world.reward_scale * world.n_records
        slack = rounding * scale * world.reward_scale * world.n_records * (turn + 2)
        np.testing.assert_allclose(rewards[alive], change[alive], rtol=0, atol=slack)
        if world.concentration_noise == 0:
            gained = outcome.gain * world.record_scale
            newest_minus_start = state.memory[..., 0, 0] - state.start_concentration * world.record_scale
            np.testing.assert_allclose(gained, newest_minus_start, rtol=0, atol=rounding * scale)
        if bounded:
            reach = fastest * time * world.field.max_gradient
            assert np.all(np.abs(outcome.gain) <= reach * (1 + 1e-6) + rounding * scale / world.record_scale)

        # ends: each for one reason, for good, and where it happened
        assert not np.any(outcome.terminated & outcome.truncated)
        assert np.all(state.finished[before.finished])
        np.testing.assert_array_equal(state.finished[alive], (outcome.terminated | outcome.truncated)[alive])
        still = before.finished
        np.testing.assert_allclose(state.position[still], before.position[still], rtol=0, atol=rounding * 20)
        np.testing.assert_array_equal(time[still], time_before[still])


CELLS = st.one_of(st.just(1), st.integers(2, 60), st.integers(61, 1000))
DTYPES = st.sampled_from([np.float32, np.float64])


@settings(max_examples=50)
@given(worlds(), CELLS, DTYPES, st.integers(0, 2**32))
def test_what_must_hold_in_every_world(world, cells, dtype, seed):
    check_life(world, cells, dtype, seed, min(12, world.max_decisions + 2))


@pytest.mark.slow
@settings(max_examples=1000, derandomize=False)
@given(worlds(), CELLS, DTYPES, st.integers(0, 2**32))
def test_what_must_hold_for_a_hundred_thousand_steps(world, cells, dtype, seed):
    check_life(world, cells, dtype, seed, 100)
