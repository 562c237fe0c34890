"""The medium: what is eaten, secreted, spread and carried is accounted for, on every array library alike.

Exact solutions are in `test_exact.py`.
"""

import dataclasses
import math
import warnings

import numpy as np
import pytest

from benchmarks.exact_medium import EVERYWHERE, Puff, circles, lived, moving_sink
from swarm.physics.crowd.medium import Medium, MediumState, check_medium
from swarm.physics.crowd.medium.mesh import Mesh
from swarm.physics.fields import FunctionField, GaussianPlume, LinearField, RadialField
from swarm.physics.flows import OscillatingTaylorGreen, ShearFlow, StillWater, TaylorGreen, UniformFlow
from swarm.physics.world import World
from tests.reference import array, to_numpy

BOX = ((0.0, 10.0), (0.0, 8.0))
VORTICES = TaylorGreen(speed_scale=0.3, wavenumber=math.pi / 4)  # repeats in 8 × 8
SWINGING = OscillatingTaylorGreen(0.3, math.pi / 4, phase=1.0, frequency=2.0)
KINDS = [
    {},
    {"kernel": "linear", "edges": "noflux", "decay": 0.1},
    {"leaving": "wrap", "secretion": 0.3},
    {"leaving": "follow", "edges": "noflux", "secretion": 0.3, "decay": 0.1},
    {"carried": True, "decay": 0.1, "box": ((0.0, 8.0), (0.0, 8.0))},
    {"carried": True, "leaving": "follow", "shape": (12, 15)},
]


class Rising:
    """A field that rises with time, c = (2 + y/5) (1 + t/10)."""

    gradient_scale = 0.2

    def __init__(self, time=0.0):
        self.time = time

    def at(self, time):
        return Rising(time)

    def concentration(self, position):
        return (2 + position[..., 1] / 5) * (1 + self.time / 10)


def medium_of(**kind):
    return Medium(**{"box": BOX, "shape": (20, 16), "uptake": 0.4, "thickness": 0.8, **kind})


def crowd(batch=(), cells=5, substeps=3):
    """Places (substeps, *batch, cells, 2), some outside the box, and who is alive."""
    generator = np.random.default_rng(2)
    first = generator.uniform(-1, 9, (*batch, cells, 2))
    steps = generator.normal(0, 0.2, (substeps, *batch, cells, 2))
    alive = generator.random((*batch, cells)) > 0.2
    return first + np.cumsum(steps, axis=0), alive


def decisions(medium, places, alive, duration=0.4, time=1.0, field=None, flow=None):
    """The state after two decisions at the same places."""
    field, flow = field or Rising(), flow or SWINGING
    state = medium.start(field, places[0, ...])
    for i in range(2):
        state = medium.step(state, field.at, flow.at, places, duration, alive, time + i * duration)
    return state


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_every_library_and_batch_gives_the_same(xp, kind):
    medium, (places, alive) = medium_of(**kind), crowd((2, 3))
    duration = np.array([[0.4, 0.2, 0.0], [0.4, 0.4, 0.1]])
    together = decisions(
        medium, array(xp, places), array(xp, alive), array(xp, duration), array(xp, 2 * duration)
    )
    sensed = medium.sense(together, array(xp, places[-1]), array(xp, places[-1, ..., 0]))
    for index in np.ndindex(2, 3):
        length = float(duration[index])
        alone = decisions(medium, places[(slice(None), *index)], alive[index], length, 2 * length)
        for name, number, expected in zip(MediumState._fields, together, alone, strict=True):
            number = to_numpy(number)[index]
            np.testing.assert_allclose(number, expected, rtol=1e-12, atol=1e-12, err_msg=name)
        there = medium.sense(alone, places[-1][index], places[-1][index][:, 0])
        np.testing.assert_allclose(to_numpy(sensed)[index], there, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("cells", [1, 40, 10_000])
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_the_order_of_cells_does_not_matter_and_nothing_is_lost(kind, cells):
    medium, (places, alive) = medium_of(**kind), crowd(cells=cells)
    order = np.random.default_rng(0).permutation(cells)
    state, other = (decisions(medium, p, a) for p, a in ((places, alive), (places[:, order], alive[order])))
    np.testing.assert_allclose(other.grid, state.grid, rtol=0, atol=1e-13)
    np.testing.assert_allclose(other.eaten, state.eaten[order], rtol=0, atol=1e-13)
    before = medium.balance(medium.start(Rising(), places[0]))
    assert medium.balance(state) == pytest.approx(before, rel=1e-12, abs=1e-12 * state.eaten.sum())
    assert (state.eaten[~alive] == 0).all()
    assert (state.eaten > 0).sum() > 0.5 * cells


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_precision_of_positions_is_kept(xp, dtype):
    for kind in KINDS:
        places, alive = crowd()
        state = decisions(medium_of(**kind), array(xp, places, getattr(xp, dtype)), array(xp, alive))
        assert all(number.dtype == getattr(xp, dtype) for number in state)


def order_of(medium, flow, field):
    """Order in which the error falls with the substeps."""

    def path(time):
        angle = 3 * time + np.array([0.0, 2.0, 4.0])
        return np.stack([4 + np.cos(angle), 4 + 0.7 * np.sin(angle)], axis=-1)

    results = {}
    for substeps in (8, 16, 128):
        state = medium.start(field, path(0.0))
        places = np.stack([path((i + 0.5) / substeps) for i in range(substeps)])
        state = medium.step(state, field.at, flow.at, places, 1.0, np.ones(3, bool), 0.0)
        results[substeps] = np.concatenate([state.grid.ravel(), state.eaten])
    coarse, fine = (np.abs(results[n] - results[128]).max() for n in (8, 16))
    return math.log2(coarse / fine)


@pytest.mark.parametrize("carried", [False, True])
def test_splitting_is_of_second_order(carried):
    medium = Medium(
        box=((0, 8), (0, 8)), shape=(16, 16), uptake=0.5, secretion=0.4, decay=0.3, diffusivity=0.2,
        carried=carried,
    )  # fmt: skip
    assert 1.9 < order_of(medium, SWINGING, Rising()) < 2.2


def test_the_error_of_a_moving_sink_falls_with_the_spacing():
    coarse, middle, fine = (moving_sink(nodes, beyond=0.5) for nodes in (64, 128, 192))
    assert coarse > 2 * middle > 3 * fine


def test_what_cells_sense_is_what_they_would_eat_and_exact_on_a_slope(xp):
    for kernel in ("linear", "cubic"):
        medium = Medium(shape=(32, 32), edges="noflux", carried=True, kernel=kernel)
        places = array(xp, np.random.default_rng(0).uniform(1, 9, (50, 2)))
        state = medium.start(LinearField(), places)
        sensed = to_numpy(medium.sense(state, places, None))
        np.testing.assert_allclose(sensed, to_numpy(places)[:, 1] + 20, rtol=1e-13)
    eats = Medium(shape=(32, 32), uptake=1e-9, diffusivity=0.0)
    places = to_numpy(places)
    state = eats.step(
        eats.start(Rising(), places), Rising().at, StillWater, places[None], 1.0, np.ones(50, bool)
    )
    np.testing.assert_allclose(state.eaten, 1e-9 * Rising(0.5).concentration(places), rtol=1e-7)


def test_however_many_eat_nothing_falls_below_zero():
    medium = Medium(shape=(16, 16), uptake=1e3, diffusivity=0.0, carried=True)
    places = np.full((4, 100, 2), 5.1)
    state = medium.step(
        medium.start(EVERYWHERE, places[0]), None, lambda _: StillWater(), places, 1.0, np.ones(100, bool)
    )
    assert -1e-14 < state.grid.min() < 1e-12  # to rounding
    assert np.ptp(state.eaten) < 1e-12 * state.eaten.max()


def test_space_that_wraps_is_the_same_everywhere():
    medium = Medium(shape=(20, 20), uptake=0.3, leaving="wrap")
    shifted = {}
    for meshes in (0, 7, 20, -33):
        state, _ = lived(medium, EVERYWHERE, lambda t, shift=0.5 * meshes: circles(t, 5) + shift, 3.0)
        shifted[meshes] = np.roll(state.grid, (-meshes, -meshes), (0, 1))
    for grid in shifted.values():
        np.testing.assert_allclose(grid, shifted[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("carried", [False, True])
def test_a_grid_that_follows_sees_what_a_large_one_sees(carried):
    def path(time):
        return np.array([[0.0, 1.0], [0.5, -1.0]]) + np.array([1.0, 0.3]) * time

    common = {"uptake": 0.5, "edges": "noflux", "carried": carried}
    large = Medium(box=((-10, 20), (-10, 15)), shape=(120, 100), **common)
    following = Medium(box=((-4, 4), (-4, 4)), shape=(32, 32), leaving="follow", **common)
    field = LinearField(offset=40.0)
    states = [lived(medium, field, path, 8.0)[0] for medium in (large, following)]
    background = field.concentration(path(8.0))
    sensed = [m.sense(s, path(8.0), background) for m, s in zip((large, following), states, strict=True)]
    np.testing.assert_allclose(sensed[1], sensed[0], rtol=1e-4)
    moved = states[1].origin - following.start(field, path(0.0)).origin
    np.testing.assert_allclose(moved / 0.25, np.round(moved / 0.25), rtol=0, atol=1e-9)
    np.testing.assert_allclose(moved, [8.0, 2.4], rtol=0, atol=0.25)
    assert states[1].outflow != 0


def test_who_has_left_the_box_does_not_eat_and_ends():
    medium, places = Medium(shape=(16, 16), uptake=0.3), np.array([[5.0, 5.0], [10.1, 5.0], [5.0, -0.1]])
    assert medium.inside(places).tolist() == [True, False, False]
    state, _ = lived(medium, EVERYWHERE, lambda _: places, 2.0)
    assert (state.eaten > 0).tolist() == [True, False, False]


def test_coordinates_are_those_of_the_centres_of_meshes():
    mesh = Medium(box=((0, 2), (1, 2)), shape=(4, 2), kernel="linear").mesh
    assert isinstance(mesh, Mesh)
    x, y = mesh.coordinates(np.array([0.0, 1.0]))
    assert x.tolist() == [0.25, 0.75, 1.25, 1.75]
    assert y.tolist() == [1.25, 1.75]
    assert mesh.places(np.array([0.0, 1.0]))[1].tolist() == [0.25, 1.75]


BAD = [
    *(
        ({"box": box}, f"box must have two sides, of lengths above 0 that are finite, got {box}")
        for box in (((0, 0), (0, 1)), ((0, 1),) * 3, ((-1e308, 1e308), (0, 1)))
    ),
    ({"shape": (8, 0)}, "shape must be two whole numbers of nodes (nx, ny), got (8, 0)"),
    ({"shape": (3, 8)}, "shape must be at least 4 nodes along each axis for the kernel 'cubic', got (3, 8)"),
    ({"edges": "periodc"}, "did you mean 'periodic'?"),
    ({"uptake": -1.0}, "uptake must be a finite number of at least 0, got -1.0"),
    ({"secretion": float("nan")}, "secretion must be a finite number of at least 0, got nan"),
    ({"thickness": 0}, "thickness must be a finite number above 0, got 0"),
    ({"substeps": 0}, "substeps must be a whole number of at least 1, got 0"),
    ({"leaving": "wrap", "edges": "noflux"}, "leaving='wrap' must go with edges='periodic', got"),
    ({"uptak": 1.0}, "did you mean 'uptake'?"),
]


@pytest.mark.parametrize(("values", "message"), BAD, ids=lambda value: str(value))
def test_a_bad_parameter_is_named(values, message):
    with pytest.raises((TypeError, ValueError)) as error:
        check_medium("medium", values)
    assert message in str(error.value)
    assert "medium" in str(error.value)


def test_a_mapping_describes_a_medium():
    plain = {"box": [[0, 10], [0, 10]], "shape": [64, 64], "edges": "noflux", "uptake": 0.0116}
    medium = check_medium("medium", plain)
    assert medium == Medium(box=((0, 10), (0, 10)), shape=(64, 64), edges="noflux", uptake=0.0116)
    assert check_medium("medium", medium) is medium
    assert check_medium("medium", dataclasses.asdict(medium)) == medium
    with pytest.raises(TypeError, match="medium must be a Medium or a mapping"):
        check_medium("medium", "periodic")


CELLS = {"start_box": ((1, 9), (1, 7)), "interval": 0.38, "speed": 1.0, "curvature": 5.0}
GOOD = {"box": BOX, "shape": (128, 128)}
CARRIED = {"carried": True, "box": ((0, 8), (0, 8))}


def named(value):
    """A name that is the same in every process."""
    return str(value).partition(" at 0x")[0][:60]


UNFIT = [
    ({"box": ((0, 8), (0, 8))}, {}, "box must contain the start box"),
    ({"leaving": "follow"}, {}, "box must be at least twice as wide as the start box"),
    ({"shape": (32, 64)}, {}, "shape must put nodes at most 0.2 apart, the radius of the tightest"),
    ({"shape": (4000, 64)}, {"interval": 3.0}, "shape must be so coarse that 1000 substeps"),
    ({"uptake": 1.0}, {"field": LinearField(offset=-3.0)}, "uptake must be 0 where the field is negative"),
    ({}, {"field": FunctionField(lambda p: np.log(p[..., 0] - 1), 1.0)}, "box must lie where the field is"),
    ({"carried": True, "substeps": 1}, {"flow": TaylorGreen(3.0)}, "substeps must be at least"),
    ({"substeps": 1001}, {}, "substeps must be at most 1000, got 1001"),
    ({"substeps": 5, "shape": (10**6, 10**6)}, {}, "shape must be of nodes that fit into memory, got"),
    (
        {"carried": True, "edges": "noflux"},
        {"field": GaussianPlume(width=0.06, egg_position=(4.0, 4.0), egg_radius=None)},
        "shape must resolve the field's gradient",
    ),
]


@pytest.mark.parametrize(
    ("given", "spread", "rule"),
    [
        (
            {"shape": (64, 64)},
            {"curvature": 0.1},
            "at most 0.153846 apart, the radius of the tightest circle",
        ),
        ({"shape": (9000, 128)}, {"speed": 0.3}, "so coarse that 1000 substeps of a decision are enough"),
    ],
)
def test_a_medium_must_suit_the_fastest_and_the_tightest_of_unlike_cells(given, spread, rule):
    World(medium=given, n_records=2)
    with pytest.raises(ValueError, match=rf"^medium.shape must .*{rule}.*, got"):
        World(medium=given, n_records=2, spread=spread)


@pytest.mark.parametrize(("kind", "parts", "message"), UNFIT, ids=named)
def test_a_medium_that_does_not_suit_its_world_is_refused(kind, parts, message):
    parts = {"field": LinearField(), "flow": StillWater(), **CELLS, **parts}
    with np.errstate(all="ignore"), pytest.raises(ValueError, match="medium") as error:
        Medium(**{**GOOD, **kind}).check(**parts)
    assert message in str(error.value)
    assert "got" in str(error.value)
    assert "\n" not in str(error.value)


PATCH = GaussianPlume(width=0.5, egg_position=(4.0, 4.0))
EDGES = [
    ({}, PATCH, ShearFlow(), None),
    ({}, RadialField(), VORTICES, "needs a field that goes on beyond periodic edges"),
    ({"edges": "noflux"}, RadialField(), TaylorGreen(wavenumber=math.pi / 4), "needs a field that vanishes"),
    ({"edges": "noflux"}, RadialField(), StillWater(), None),
    ({}, FunctionField(lambda p: 2 + np.sin(p[..., 0] * math.pi / 4), 1.0), UniformFlow(), None),
    ({}, GaussianPlume(width=2.0, egg_position=(4.0, 4.0)), ShearFlow(), "needs a field that vanishes"),
]


@pytest.mark.parametrize(("kind", "field", "flow", "message"), EDGES, ids=named)
def test_what_meets_itself_at_the_edges_is_warned_of(kind, field, flow, message):
    medium = Medium(**{**GOOD, **CARRIED, **kind})
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        medium.check(field, flow, **{**CELLS, "start_box": ((1, 7), (1, 7))})
    assert len(found) == (message is not None)
    assert message is None or message in str(found[0].message)


def test_substeps_are_as_many_as_a_cell_passes_meshes_and_as_advection_needs():
    medium = Medium()
    assert medium.substeps_for(StillWater(), 1.0, 0.38) == 5
    assert dataclasses.replace(medium, substeps=2).substeps_for(StillWater(), 1.0, 0.38) == 2
    carried = Medium(shape=(32, 32), carried=True, diffusivity=0.0)
    fast = UniformFlow((3.0, 4.0))
    count = carried.substeps_for(fast, 0.0, 0.38)
    places = np.full((count, 1, 2), 5.0)
    state = carried.start(Puff(np.eye(2)), places[0])
    state = state._replace(grid=np.random.default_rng(0).normal(size=state.grid.shape))
    for _ in range(30):
        state = carried.step(state, None, lambda _: fast, places, 0.38, np.ones(1, bool))
    assert np.abs(state.grid).max() < 5


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:`torch.jit:DeprecationWarning")  # torch's compiler uses it itself
@pytest.mark.parametrize("kind", KINDS[2:5:2], ids=str)
def test_torch_compiles_a_decision_in_one_piece(kind):
    torch = pytest.importorskip("torch")
    medium, (places, alive) = medium_of(**kind), crowd((2,))
    places, alive = torch.as_tensor(places), torch.as_tensor(alive)
    duration = torch.as_tensor([0.4, 0.3], dtype=torch.float64)
    state = decisions(medium, places, alive, duration, duration)

    def step(state, places, duration, alive):
        return medium.step(state, Rising().at, SWINGING.at, places, duration, alive, duration)

    compiled = torch.compile(step, fullgraph=True, dynamic=False)
    arguments = (state, places, duration, alive)
    for number, expected in zip(compiled(*arguments), step(*arguments), strict=True):
        np.testing.assert_allclose(number, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_py_pde_finds_the_same():
    pde = pytest.importorskip("pde", reason="py-pde is not installed")
    nodes, duration = 64, 2.0
    medium = Medium(
        box=((0, 8), (0, 8)), shape=(nodes, nodes), diffusivity=0.05, decay=0.1, carried=True, uptake=0.025
    )
    cell = np.array([[3.05, 5.02]])
    field = FunctionField(
        lambda p: 2 + np.sin(p[..., 0] * math.pi / 4) * np.cos(p[..., 1] * math.pi / 4), 1.0
    )
    state, _ = lived(medium, field, lambda _: cell, duration, flow=VORTICES)
    grid = pde.CartesianGrid([(0, 8), (0, 8)], nodes, periodic=True)
    seen = medium.mesh.footprint(cell, np.zeros(2))
    kernel = np.zeros(nodes * nodes)
    np.add.at(kernel, seen.index, seen.weight)
    kernel = pde.ScalarField(grid, kernel.reshape(nodes, nodes) / medium.volume * medium.uptake)
    places = medium.mesh.places(np.zeros(2))
    u, v = (pde.ScalarField(grid, each.reshape(nodes, nodes)) for each in VORTICES.velocity(places).T)
    equation = pde.PDE(
        {"c": "0.05 * laplace(c) - d_dx(u * c) - d_dy(v * c) - (0.1 + k) * c"},
        consts={"u": u, "v": v, "k": kernel},
        bc="periodic",
    )
    start = pde.ScalarField(grid, field.concentration(places).reshape(nodes, nodes))
    found = equation.solve(start, duration, dt=5e-3, solver="runge-kutta", tracker=None, backend="numpy")
    error = np.abs(state.grid - found.data)  # of 2; theirs are differences of second order
    assert error.max() < 2e-2
    assert error[np.hypot(*(places - cell).T).reshape(nodes, nodes) > 0.5].max() < 3e-3
