"""Cells that move each other: the coupled equations, and what a crowd must not feel.

Laws of pairs, and decisions against DOP853, are in `benchmarks/exact_pairs.py` and `exact_crowds.py`.
"""

import ast
import subprocess
import sys

import numpy as np
import pytest

import swarm
from swarm.physics.crowd.neighbours import near_pairs, neighbours
from swarm.physics.starts import draw_starts
from swarm.physics.world import World

CONTACT, DENSE = swarm.Contact(0.1, 100.0), ((0.0, 1.0), (0.0, 1.0))


LIVES = """
import sys
if sys.argv[1] == "plain":
    sys.modules["numba"] = None
import numpy as np, swarm
dipoles = [swarm.Dipole(0.2, 0.25), swarm.Dipole(0.25, 0.25, "bulk")]
world = swarm.World(interactions=[swarm.Contact(0.1, 100.0), *dipoles], start_box=((0, 1), (0, 1)))
state = world.start(*swarm.draw_starts(world, 8, 0))
state = state._replace(finished=np.arange(8) == 3)
for _ in range(2):
    state, _ = world.step(state, np.arange(8) % 2)
print(state.position.tolist(), "numba" in sys.modules and sys.modules["numba"] is not None)
"""


def test_cells_live_alike_where_loops_are_not_compiled():
    pytest.importorskip("numba")
    lives = []
    for how in ("plain", "compiled"):
        command = [sys.executable, "-c", LIVES, how]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        position, compiled = said.rsplit(maxsplit=1)
        assert compiled == str(how == "compiled")
        lives.append(np.array(ast.literal_eval(position)))
    np.testing.assert_allclose(*lives, rtol=0, atol=1e-10)


def crowd(cells, seed=0, **parameters):
    world = World(life=20.0, **parameters)
    return world, draw_starts(world, cells, seed)


def live(world, starts, decisions=5, seed=0):
    state = world.start(*starts)
    rng = np.random.default_rng(seed)
    for _ in range(decisions):
        state, _ = world.step(state, rng.integers(2, size=len(starts.heading)))
    return state


def test_no_pair_ends_nearer_than_four_fifths_of_the_diameter():
    world, starts = crowd(60, interactions=CONTACT, start_box=((0, 2), (0, 2)))
    state = world.start(*starts)
    rng = np.random.default_rng(1)
    for turn in range(30):
        state, _ = world.step(state, rng.integers(2, size=60))
        if turn > 3:
            distances = np.hypot(*np.moveaxis(state.position[:, None] - state.position, -1, 0))
            assert distances[~np.eye(60, dtype=bool)].min() > 0.8 * CONTACT.diameter


def test_another_order_of_the_cells_permutes_what_happens():
    world, starts = crowd(30, interactions=["contact", "dipole"], start_box=((0, 3), (0, 3)))
    order = np.random.default_rng(2).permutation(30)
    state, other = world.start(*starts), world.start(*(part[order] for part in starts))
    action = np.random.default_rng(3).integers(2, size=30)
    for _ in range(2):
        state, other = world.step(state, action)[0], world.step(other, action[order])[0]
    np.testing.assert_allclose(other.position, state.position[order], rtol=0, atol=1e-8)


@pytest.mark.parametrize("cells", [20, 200])
def test_two_far_crowds_do_not_feel_each_other(cells):
    interactions = [CONTACT, swarm.Dipole(0.2, 0.25, cutoff=2.0)]
    world, starts = crowd(cells, interactions=interactions, start_box=((0, 8), (0, 8)))
    position = np.concatenate([starts.position, starts.position + 1000.0])
    both = [position, np.tile(starts.heading, 2), np.tile(starts.past, (2, 1))]
    state, alone = world.start(*both), world.start(*starts)
    action = np.ones(cells, int)
    for _ in range(3):
        state, alone = world.step(state, np.tile(action, 2))[0], world.step(alone, action)[0]
    np.testing.assert_allclose(state.position[:cells], alone.position, rtol=0, atol=1e-10)
    np.testing.assert_allclose(state.position[cells:] - 1000, alone.position, rtol=0, atol=1e-8)


def test_lists_of_neighbours_find_what_all_pairs_find():
    dipole, rng = swarm.Dipole(0.2, 0.25, cutoff=1.0), np.random.default_rng(0)
    position, heading = rng.uniform(0, 9, (2, 300, 2)), rng.uniform(-3, 3, (2, 300))
    heading, alive = np.stack([np.cos(heading), np.sin(heading)], -1), rng.random((2, 300)) < 0.9
    pairs = neighbours(dipole, position, np.full((2, 300), 0.2), alive)
    velocity, spin = dipole.drift(position, heading, alive)
    x, y, ahead, aside = (
        part[None, ...] for part in (*np.moveaxis(position, -1, 0), *np.moveaxis(heading, -1, 0))
    )
    u, v, turning = pairs.drift(dipole, x, y, (ahead, aside))
    for ours, theirs in ((u[0], velocity[..., 0]), (v[0], velocity[..., 1]), (turning[0], spin)):
        np.testing.assert_allclose(np.where(alive, ours, 0), np.where(alive, theirs, 0), rtol=0, atol=1e-12)
    rows = np.stack(near_pairs(position, 0.7, alive), axis=-1)
    found = {frozenset(pair) for pair in rows.tolist()}
    flat, row = position.reshape(-1, 2), np.repeat([0, 1], 300)
    near = np.hypot(*np.moveaxis(flat[:, None] - flat, -1, 0)) <= 0.7
    near &= (row[:, None] == row) & alive.reshape(-1)[:, None] & alive.reshape(-1)
    expected = {frozenset(pair) for pair in np.argwhere(np.triu(near, 1)).tolist()}
    assert found == expected


@pytest.mark.parametrize(
    ("cells", "box", "reach"), [(1, 1, 1), (40, 3, 0.7), (40, 1, 5), (90, 10, 0.9), (90, 0, 1), (200, 1e4, 9)]
)
def test_contact_finds_all_pairs_that_are_near(cells, box, reach):
    from swarm.physics.motion.pushes import pairs_of_few, pairs_of_many

    rng = np.random.default_rng(cells)
    x, y = rng.uniform(0, box, (2, cells))
    x[::2] += 1e6 * (box > 100)
    alive = rng.random(cells) < 0.8
    near = (np.hypot(x[:, None] - x, y[:, None] - y) <= reach) & alive[:, None] & alive
    for pairs in (pairs_of_few, pairs_of_many):
        found = sorted(map(sorted, pairs(alive, x, y, float(reach)).tolist()))
        assert found == np.argwhere(np.triu(near, 1)).tolist()


def test_who_has_finished_neither_acts_nor_moves():
    world, starts = crowd(12, interactions=["contact", "dipole"], start_box=DENSE)
    state = world.start(*starts)
    gone = np.arange(12) < 4
    state, alone = state._replace(finished=gone), world.start(*(part[4:] for part in starts))
    action = np.ones(12, int)
    after, only = world.step(state, action)[0], world.step(alone, action[4:])[0]
    np.testing.assert_allclose(after.position[4:], only.position, rtol=0, atol=1e-12)


def test_batched_worlds_and_torch_live_as_one_world_in_numpy():
    torch = pytest.importorskip("torch")
    world, starts = crowd(24, interactions=["contact", "dipole"], start_box=((0, 3), (0, 3)))
    position, heading, past = (part.reshape(2, 12, *part.shape[1:]) for part in starts)
    action = np.random.default_rng(0).integers(2, size=(4, 2, 12))
    batch = world.start(position, heading, past)
    tensors = world.start(*(torch.as_tensor(part) for part in (position, heading, past)))
    ones = [world.start(position[i], heading[i], past[i]) for i in range(2)]
    for turn in action:
        batch, tensors = world.step(batch, turn)[0], world.step(tensors, torch.as_tensor(turn))[0]
        ones = [world.step(one, turn[i])[0] for i, one in enumerate(ones)]
    for i, one in enumerate(ones):
        np.testing.assert_allclose(batch.position[i], one.position, rtol=0, atol=1e-9)
        np.testing.assert_allclose(tensors.position[i].numpy(), one.position, rtol=0, atol=1e-9)


def test_jax_lives_as_numpy_compiled_and_over_worlds():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    world, starts = crowd(24, interactions=["contact", "dipole"], start_box=((0, 3), (0, 3)))
    batch = [part.reshape(2, 12, *part.shape[1:]) for part in starts]
    action = np.ones((2, 12), int)
    found = jax.jit(jax.vmap(lambda *given: world.step(world.start(*given[:-1]), given[-1])[0].position))
    expected = world.step(world.start(*batch), action)[0].position
    np.testing.assert_allclose(found(*batch, action), expected, rtol=0, atol=1e-9)


def test_one_cell_and_ten_thousand():
    dipole = swarm.Dipole(0.2, 0.25, cutoff=2.0)
    for cells, size in ((1, 10), (10_000, 160)):
        world, starts = crowd(cells, interactions=[CONTACT, dipole], start_box=((0, size), (0, size)))
        assert np.isfinite(live(world, starts, 1).position).all()
    lonely, starts = crowd(1, interactions=[CONTACT, dipole])
    still = World(life=20.0)
    np.testing.assert_allclose(
        live(lonely, starts).position, live(still, starts).position, rtol=0, atol=1e-12
    )


def test_users_bring_their_own_interaction():
    class Wind:
        def drift(self, position, heading, alive):
            return np.broadcast_to([0.1, 0.0], position.shape), 0.0 * position[..., 0]

    world, starts = crowd(3, interactions=Wind())
    calm = World(life=20.0)
    moved = live(world, starts, 5).position - live(calm, starts, 5).position
    np.testing.assert_allclose(moved, np.tile([0.1 * 5 * world.intervals[0], 0.0], (3, 1)), atol=1e-9)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"interactions": swarm.Contact(0.1, 1e6)}, "stiffness must be at most .*, got 1e[+]06"),
        ({"interactions": swarm.Dipole(0.1, 0.0)}, "core must be above 0 .*, got Dipole"),
        ({"interactions": "contact", "varying_speed": True}, "interval_rule must be 'common' .*"),
        ({"interactions": 3}, "interactions must be objects with drift.*, got 3"),
        (
            {"interactions": "contacts"},
            "interactions must be one of .*contact, dipole, .*'contacts'; did",
        ),
        (
            {"interactions": {"type": "contact", "diameter": -1}},
            "interactions 'contact': diameter .* got -1",
        ),
        (
            {"interactions": {"type": "dipole", "geometry": "flat"}},
            "interactions 'dipole': geom.*'flat'",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(parameters, message):
    with pytest.raises((TypeError, ValueError), match=f"^{message}") as error:
        World(**parameters)
    assert "\n" not in str(error.value)


def test_cells_of_unlike_speeds_decide_together_by_the_common_rule():
    world = World(interactions="contact", varying_speed=True, interval_rule="common")
    assert len(set(world.intervals)) == 1
    assert world.intervals == World(interval_rule="common").intervals
