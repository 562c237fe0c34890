"""Random worlds, random decisions: what must hold whatever the parameters."""

import functools
import math
import re

import numpy as np
import pytest
import torch
import xarray as xr
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st

import swarm
from swarm.envs.torchrl import SwarmEnv
from swarm.envs.torchrl import worlds as torchrl
from swarm.physics.starts import draw_noise, draw_starts, noise_of
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
    return swarm.GriddedField(data, edges=edges, variable="c"), swarm.GriddedFlow(data, edges=edges)


def numbers(low, high):
    return st.floats(low, high, allow_nan=False)


scales = numbers(0.1, 5.0)
places = st.tuples(numbers(-3, 12), numbers(-3, 12))

FIELDS = st.one_of(
    st.builds(swarm.LinearField, gradient_scale=scales, offset=numbers(-50, 50)),
    st.builds(swarm.RadialField, gradient_scale=scales, egg_radius=scales),
    st.builds(
        swarm.GaussianPlume,
        gradient_scale=scales,
        width=numbers(1, 20),
        egg_position=places,
        egg_radius=st.none() | scales,
    ),
    st.builds(swarm.DiffusingSource, gradient_scale=scales, core=numbers(0.5, 3), egg_position=places),
    st.just(swarm.FunctionField(lambda r: r[..., 0] - 2 * r[..., 1], gradient_scale=2.0, max_gradient=2.24)),
    st.sampled_from(["periodic", "clamped"]).map(lambda edges: gridded(edges)[0]),
)
speeds = numbers(0.01, 0.8)
FLOWS = st.one_of(
    st.just(swarm.StillWater()),
    st.builds(swarm.TaylorGreen, speed_scale=speeds, wavenumber=numbers(0.1, 2)),
    st.builds(swarm.UniformFlow, st.tuples(speeds, speeds)),
    st.builds(swarm.ShearFlow, speed_scale=speeds, height=numbers(1, 20)),
    st.just(swarm.PoiseuilleFlow(walls=(-1.0, 12.0))),
    st.builds(swarm.Vortex, speed_scale=speeds, core=numbers(0.3, 5), centre=places, clockwise=st.booleans()),
    st.just(
        swarm.FunctionFlow(swarm.TaylorGreen().velocity, 0.1, 0.1 * np.pi / 10, max_speed=0.1, max_spin=0.032)
    ),
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


# --- the shared world ---------------------------------------------------------------------------------------

ROOM, STARTS = ((-1.0, 7.0), (-1.0, 7.0)), ((1.0, 5.0), (1.0, 5.0))
ONE_LINE = re.compile(r"[^\n]+ must [^\n]+, got [^\n]+")
eggs = {"egg_position": places, "egg_radius": st.none() | numbers(0.2, 1.0)}
sources = {"strength": scales, "offset": numbers(0, 5)}
SHARED_FIELDS = st.one_of(
    st.builds(swarm.LinearField, gradient_scale=scales, offset=numbers(5, 50)),
    st.builds(swarm.GaussianPlume, gradient_scale=scales, width=numbers(0.5, 5), egg_radius=st.just(0.5)),
    st.builds(
        swarm.ReleasedSource, age=numbers(5, 40), dimensions=st.sampled_from([2, 3]), **eggs, **sources
    ),
    st.builds(
        swarm.ReleasingSource,
        age=numbers(5, 40),
        core=numbers(0.2, 0.45),
        dimensions=st.sampled_from([2, 3]),
        **eggs,
        **sources,
    ),
    st.builds(
        swarm.MovingSource,
        velocity=st.tuples(speeds, speeds),
        position=places,
        core=numbers(0.2, 0.45),
        **sources,
    ),
    st.builds(swarm.ShearedSource, age=numbers(5, 40), core=numbers(0.2, 0.45), **eggs, **sources),
)
SHARED_FLOWS = st.one_of(
    st.just(swarm.StillWater()),
    st.builds(swarm.TaylorGreen, speed_scale=speeds, wavenumber=st.just(math.pi / 4)),
    st.builds(
        swarm.OscillatingTaylorGreen, speed_scale=speeds, phase=numbers(0, 3), frequency=numbers(0.1, 2)
    ),
    st.builds(swarm.DoubleGyre, amplitude=speeds, displacement=numbers(0, 0.4), size=numbers(2, 8)),
)
amounts = st.just(0.0) | numbers(0.001, 0.5)
MEDIA = st.fixed_dictionaries(
    {
        "box": st.just(ROOM),
        "shape": st.sampled_from([(48, 48), (56, 40), (8, 8)]),
        "edges": st.sampled_from(["periodic", "noflux"]),
        "leaving": st.sampled_from(["wrap", "truncate", "follow"]),
        "carried": st.booleans(),
        "kernel": st.sampled_from(["linear", "cubic"]),
        "diffusivity": amounts,
        "uptake": amounts,
        "secretion": amounts,
        "decay": amounts,
        "substeps": st.sampled_from([None, 1, 3]),
    }
)
CONTACTS = st.builds(swarm.Contact, diameter=numbers(0.05, 0.15), stiffness=numbers(100, 300))
DIPOLES = st.builds(
    swarm.Dipole,
    strength=numbers(-0.25, 0.25),
    core=st.just(0.0) | numbers(0.2, 0.5),
    geometry=st.sampled_from(["film", "bulk"]),
    cutoff=st.none() | numbers(0.5, 3),
)
COMPANY = st.one_of(st.just(()), st.tuples(CONTACTS), st.tuples(DIPOLES), st.tuples(CONTACTS, DIPOLES))
SPREADS = st.none() | st.fixed_dictionaries({"speed": numbers(0, 0.35), "curvature": numbers(0, 0.3)})
SHARED = {
    "n_records": st.integers(2, 5),
    "field": SHARED_FIELDS,
    "flow": SHARED_FLOWS,
    "life": numbers(0.5, 6),
    "start_box": st.just(STARTS),
    "speed": numbers(0.5, 1.5),
    "varying_speed": st.booleans(),
    "interval_rule": st.sampled_from(["common", "common", "truncated"]),
    "concentration_noise": NOISE,
    "curvature_noise": NOISE,
    "interactions": COMPANY,
    "medium": st.none() | MEDIA,
    "first_arrivals": st.none() | st.integers(1, 4),
    "block_delay": st.just(0.0) | numbers(0.1, 1),
    "reward": st.sampled_from(["own", "own", "team", "arrival", "eaten"]),
    "binding_rate": st.none() | numbers(0.1, 50),
    "spread": SPREADS,
    "sensor": st.sampled_from(["memory", "memory_with_neighbours", "memory_with_traits", "memory_with_flow"]),
}
SUITS = {  # what a combination needs; three of four are made to fit, the others are refused or happen to fit
    "sensor": lambda given: {
        "memory_with_traits": given["spread"] is not None,
        "memory_with_flow": given["flow"].spin_scale > 0,
    }.get(given["sensor"], True),
    "reward": lambda given: {
        "arrival": given["first_arrivals"] is not None,
        "eaten": given["medium"] is not None and given["medium"]["uptake"] > 0,
    }.get(given["reward"], True),
}


@st.composite
def shared_worlds(draw):
    """Worlds with any of what cells share; what does not go together is refused in one line."""
    given = draw(st.fixed_dictionaries(SHARED))
    if draw(st.integers(0, 3)):
        if getattr(given["field"], "egg_radius", None) is None:
            given["first_arrivals"] = None
        if given["first_arrivals"] is None:
            given["block_delay"] = 0.0
        if given["binding_rate"] is not None:
            given["concentration_noise"] = 0.0
        for name, fits in SUITS.items():
            given[name] = given[name] if fits(given) else {"sensor": "memory", "reward": "own"}[name]
        if given["varying_speed"]:
            given["interval_rule"] = "common"
        if (medium := given["medium"]) is not None:
            medium |= {"shape": (48, 48), "substeps": None}
            medium["edges"] = "periodic" if medium["leaving"] == "wrap" else medium["edges"]
        given["interactions"] = tuple(each for each in given["interactions"] if getattr(each, "core", 1) > 0)
    try:
        return World(**given)
    except (TypeError, ValueError) as error:
        if not ONE_LINE.fullmatch(str(error)):
            raise
        reject()


NEAREST = 3.0  # in a crowd, of the v/μK by which two cells head on come nearer than the diameter


def check_apart(world, state):
    """No pair is much nearer than two that head for each other, pushed by their dipoles too."""
    contacts = [each for each in world.interactions if isinstance(each, swarm.Contact)]
    spread = 1.0 if world.spread is None else world.spread.largest[0]
    fastest = spread * max(world.action_speeds) + sum(
        getattr(each, "speed_scale", 0) for each in world.interactions
    )
    alive = np.flatnonzero(~state.finished)
    apart = np.hypot(*np.moveaxis(state.position[alive, None] - state.position[alive], -1, 0))
    nearest = np.min(apart[~np.eye(len(alive), dtype=bool)], initial=np.inf)
    for each in contacts:
        assert nearest >= each.diameter - NEAREST * fastest / each.stiffness


def check_shared_life(world, cells, seed, decisions):
    """Lives some decisions, and again with the cells in another order."""
    starts = draw_starts(world, cells, seed)
    rng = np.random.default_rng(seed)
    order = rng.permutation(cells)
    noise = noise_of(world)(seed, cells, decisions) if world.has_noise else None
    state, other = (world.start(*(part[row] for part in starts)) for row in (slice(None), order))
    medium, bounds = world.medium, world.observation_bounds
    began = None if medium is None else medium.balance(state.medium)
    for turn in range(decisions):
        action = rng.integers(world.n_actions, size=cells)
        kicks = None if noise is None else noise[:, turn]
        state, outcome = world.step(state, action, kicks)
        other, permuted = world.step(other, action[order], None if noise is None else kicks[order])
        for name, part in state.named("").items():
            assert np.all(np.isfinite(part) | (name == ".arrival_time")), name
        for part in outcome:
            assert np.all(np.isfinite(part))
        assert np.all(np.abs(outcome.observation) <= bounds)
        for one, two in zip((*state[:6], *outcome), (*other[:6], *permuted), strict=True):
            if one.dtype == bool:
                np.testing.assert_array_equal(two, one[order])
            else:
                np.testing.assert_allclose(two, one[order], rtol=1e-6, atol=1e-6 * (1 + np.abs(one).max()))
        if medium is not None:
            held = state.medium
            parts = held.eaten.sum(), held.secreted.sum(), held.decayed, held.outflow
            scale = np.abs(held.grid).sum() * medium.volume + np.abs(parts).sum() + abs(began)
            assert abs(medium.balance(held) - began) <= 1e-12 * scale
        if turn >= 3:  # who was drawn on top of another has been pushed away
            check_apart(world, state)


def check_faces(world, cells, seed, decisions):
    """What NumPy and torch make of the same decisions."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(torchrl, "NUMPY_CELLS", 0)
        tensors = SwarmEnv(2, n_swimmers=cells, dtype="float64", seed=seed, world=world)
    arrays = SwarmEnv(2, n_swimmers=cells, dtype="float64", seed=seed, world=world)
    tensors.restart(), arrays.restart()
    actions = np.random.default_rng(seed).integers(world.n_actions, size=(decisions, 2, cells))
    for action in actions:
        results = [env.advance(torch.as_tensor(action))._asdict() for env in (tensors, arrays)]
        ours, theirs = (
            env.state.named("") | each for env, each in zip((tensors, arrays), results, strict=True)
        )
        for name, part in ours.items():
            one, two = part.double(), theirs[name].double()
            scale = 1 + two.nan_to_num(posinf=0).abs().max()
            assert torch.allclose(one, two, rtol=1e-6, atol=1e-6 * float(scale)), name


CROWDS = st.integers(1, 24), st.integers(0, 2**32)


@pytest.mark.filterwarnings("ignore:medium.carried needs")
@settings(max_examples=40, suppress_health_check=[HealthCheck.filter_too_much])
@given(shared_worlds(), *CROWDS)
def test_what_must_hold_in_every_shared_world(world, cells, seed):
    cells = max(cells, world.first_arrivals or 1)
    check_shared_life(world, cells, seed, min(6, world.max_decisions))


@pytest.mark.filterwarnings("ignore:medium.carried needs")
@settings(max_examples=10, suppress_health_check=[HealthCheck.filter_too_much])
@given(shared_worlds(), *CROWDS)
def test_torch_lives_as_numpy_in_every_shared_world(world, cells, seed):
    check_faces(world, max(cells, world.first_arrivals or 1), seed, min(3, world.max_decisions))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:medium.carried needs")
@settings(max_examples=1000, derandomize=False, suppress_health_check=[HealthCheck.filter_too_much])
@given(shared_worlds(), *CROWDS)
def test_what_must_hold_in_many_shared_worlds(world, cells, seed):
    cells = max(cells, world.first_arrivals or 1)
    check_shared_life(world, cells, seed, min(12, world.max_decisions))
    check_faces(world, cells, seed, min(6, world.max_decisions))
