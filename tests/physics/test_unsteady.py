"""Fields and flows that change with time: their closed forms against independent references."""

import math
import pickle

import numpy as np
import pytest
from scipy import integrate, linalg, special

import swarm
from swarm.physics.fields import Field
from swarm.physics.fields.special import erfc, exponential_integral, scaled_erfc
from tests.reference import array, to_numpy

D = 0.3
SHEAR, STRAIN, TURN = ((0.0, 0.4), (0.0, 0.0)), ((0.1, 0.2), (0.2, -0.1)), ((0.0, -0.5), (0.5, 0.0))
ELLIPSES, NEARLY_SHEAR = ((0.1, -0.5), (0.2, -0.1)), ((1e-6, 0.4), (-1e-9, -1e-6))
LINEAR = {
    "still": ((0.0, 0.0), (0.0, 0.0)),
    "shear": SHEAR,
    "strain": STRAIN,
    "turn": TURN,
    "ellipses": ELLIPSES,
    "nearly": NEARLY_SHEAR,
}
FIELDS = {
    **{f"released_{d}": swarm.ReleasedSource(2.0, D, dimensions=d, offset=1.0) for d in (2, 3)},
    **{f"releasing_{d}": swarm.ReleasingSource(2.0, D, dimensions=d, core=0.5) for d in (2, 3)},
    "moving": swarm.MovingSource(2.0, D, velocity=(0.3, 0.0), position=(-1.0, 0.2), core=0.4),
    **{
        f"{release}_{name}": swarm.ShearedSource(
            2.0, D, egg_position=(0.3, -0.2), velocity_gradient=gradient, release=release, core=0.5
        )
        for name, gradient in LINEAR.items()
        for release in ("at_once", "steadily")
    },
    "steadily_shear_3": swarm.ShearedSource(2.0, D, dimensions=3, velocity_gradient=SHEAR),
}
FLOWS = [
    swarm.OscillatingTaylorGreen(),
    swarm.OscillatingTaylorGreen(0.4, 1.3, phase=2.0, frequency=0.7),
    swarm.DoubleGyre(),
    swarm.DoubleGyre(0.3, 0.4, frequency=2.0, size=5.0),
]
each_field = pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
each_flow = pytest.mark.parametrize("flow", FLOWS, ids=lambda flow: type(flow).__name__)


@pytest.fixture
def places():
    return np.random.default_rng(0).normal(0, 2, (60, 2))


def slopes(function, places, step):
    """Values, gradients (..., 2) and Laplacians by central differences of sixth order."""
    weights, second = np.array([45, -9, 1]) / 60, np.array([270, -27, 2]) / 180
    middle, gradient, laplacian = function(places), [], 0.0
    for axis in np.eye(2):
        ahead, back = ([function(places + sign * n * step * axis) for n in (1, 2, 3)] for sign in (1.0, -1.0))
        gradient.append(sum(w * (a - b) for w, a, b in zip(weights, ahead, back, strict=True)) / step)
        bend = sum(w * (a + b - 2 * middle) for w, a, b in zip(second, ahead, back, strict=True))
        laplacian = laplacian + bend / step**2
    return middle, np.stack(gradient, axis=-1), laplacian


def rate(part, name, time, place, step=1e-2):
    """∂/∂t of a field or flow by central differences of sixth order."""
    values = [getattr(part.at(time + n * step), name)(place) for n in (-3, -2, -1, 1, 2, 3)]
    return sum(w * v for w, v in zip((-1, 9, -45, 45, -9, 1), values, strict=True)) / (60 * step)


# --- special functions ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-12), ("float32", 3e-6)])
def test_special_functions_are_scipys(xp, dtype, tolerance):
    x = np.concatenate([np.geomspace(1e-12, 80, 3001), [1.0, 2.0, 2.0 + 1e-15]]).astype(dtype)
    around = np.linspace(-6, 9, 3001).astype(dtype)
    for own, known, at in (
        (exponential_integral, special.exp1, x),
        (erfc, special.erfc, around),
        (scaled_erfc, special.erfcx, np.concatenate([[0.0], x]).astype(dtype)),
    ):
        found = own(array(xp, at, getattr(xp, dtype)))
        assert found.dtype == getattr(xp, dtype)
        exact = known(at.astype(float))
        # in single precision e^{−x²} cannot be better than its exponent
        bound = tolerance * (1 if dtype == "float64" else 1 + at**2)
        assert (np.abs(to_numpy(found) / exact - 1) <= bound).all()
    far = np.array([1e3, np.inf])
    np.testing.assert_array_equal([exponential_integral(far), erfc(far), erfc(-far) - 2], 0)


# --- sources ----------------------------------------------------------------------------------------------


def kernel(x, y, age, d):
    return np.exp(-(x * x + y * y) / (4 * D * age)) / (4 * math.pi * D * age) ** (d / 2)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("distance", [0.0, 1e-9, 0.1, 0.7, 3.0, 12.0])
def test_a_releasing_source_is_the_integral_of_all_that_it_released(d, distance):
    field, time = FIELDS[f"releasing_{d}"], 7.0
    exact, _ = integrate.quad(lambda s: 2.0 * kernel(distance, 0, s, d), 0.5**2 / (2 * D), 17.0, epsrel=1e-12)
    found = field.at(time).concentration(np.array([0.6, 0.8]) * distance)
    assert found == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.3, -0.4), (30.0, 0.0)])
def test_a_moving_source_is_the_integral_of_all_that_it_released(places, velocity):
    field = swarm.MovingSource(2.0, D, velocity=velocity, core=0.5)
    for x, y in (*places[:8], (0.0, 0.0), (1e-8, 0.0), (-40.0, 0.1), (40.0, 0.0)):

        def past(log, x=x, y=y):
            s = math.exp(log)
            return 2.0 * s * kernel(x + velocity[0] * s, y + velocity[1] * s, s, 3)

        exact, _ = integrate.quad(past, math.log(0.5**2 / (2 * D)), 60, epsabs=0, epsrel=1e-10, limit=500)
        assert field.concentration(np.array([x, y])) == pytest.approx(exact, rel=1e-7, abs=1e-30)


def exact_covariance(gradient, ages):
    """Σ (ages, 2, 2), from one matrix exponential (Van Loan 1978)."""
    a, still = np.array(gradient), np.zeros((2, 2))
    both = linalg.expm(np.block([[-a, 2 * D * np.eye(2)], [still, a.T]]) * ages[:, None, None])
    return np.swapaxes(both[:, 2:, 2:], 1, 2) @ both[:, :2, 2:]


@pytest.mark.parametrize("name", LINEAR)
def test_a_cloud_in_a_linear_flow_has_the_covariance_of_its_equation(xp, name):
    field, ages = FIELDS[f"at_once_{name}"], np.array([0.01, 0.5, 1.0, 2.3, 4.9, 25.0])
    exact = exact_covariance(LINEAR[name], ages)
    xx, xy, yy = (to_numpy(each) for each in field.covariance(array(xp, ages)))
    np.testing.assert_allclose(
        np.stack([xx, xy, yy]), exact[:, [0, 0, 1], [0, 1, 1]].T, rtol=1e-9, atol=1e-12
    )
    if name == "shear":
        shear = 2 * D * ages * (1 + (0.4 * ages) ** 2 / 3), 0.4 * D * ages**2, 2 * D * ages
        np.testing.assert_allclose([xx, xy, yy], shear, rtol=1e-14)
    if name == "turn":
        np.testing.assert_allclose(
            [xx, xy, yy], [2 * D * ages, 0 * ages, 2 * D * ages], rtol=1e-13, atol=1e-13
        )


@pytest.mark.parametrize(
    ("name", "age", "tolerance"), [*((name, 30.0, 1e-5) for name in LINEAR), ("ellipses", 330.0, 1e-2)]
)
def test_an_egg_in_a_linear_flow_is_the_integral_of_all_that_it_released(places, name, age, tolerance):
    low, high = math.log(0.5**2 / (2 * D)), math.log(age)
    nodes, weights = np.polynomial.legendre.leggauss(600)
    ages, weights = np.exp(low + (high - low) * 0.5 * (nodes + 1)), weights * 0.5 * (high - low)
    sigma = exact_covariance(LINEAR[name], ages)
    square = np.einsum("pi,sij,pj->ps", places, np.linalg.inv(sigma), places)
    density = 2.0 * ages * np.exp(-0.5 * square) / (2 * math.pi * np.sqrt(np.linalg.det(sigma)))
    for d, along in ((2, 1.0), (3, np.sqrt(4 * math.pi * D * ages))):
        field = swarm.ShearedSource(2.0, D, dimensions=d, velocity_gradient=LINEAR[name], core=0.5)
        exact = (density / along) @ weights
        found = field.at(age - 10).concentration(places)
        np.testing.assert_allclose(found, exact, rtol=tolerance, atol=0.1 * tolerance * exact.max())


# of a sheared egg in bulk fluid the Laplacian does not follow from the plane
@pytest.mark.parametrize("name", [name for name in FIELDS if name != "steadily_shear_3"])
def test_what_is_released_is_carried_and_spreads(name, places):
    """∂c/∂t = D∇²c − u·∇c + what the core releases."""
    field = FIELDS[name]
    time, x = 3.0, places + 0.05
    here = x - (field.position if field is FIELDS["moving"] else field.egg_position)
    _, gradient, laplacian = slopes(field.at(time).concentration, x, 0.03)
    if field is FIELDS["moving"]:  # symmetric round its way
        laplacian = laplacian + gradient[:, 1] / here[:, 1]
        behind = here - [0.3 * (time - 0.4**2 / (2 * D)), 0.0]
        released = 2.0 * np.exp(-np.sum(behind**2, -1) / (2 * 0.4**2)) / (2 * math.pi * 0.4**2) ** 1.5
    else:
        square = np.sum(here**2, axis=-1)
        if field.dimensions == 3:  # symmetric round the egg
            laplacian = laplacian + np.sum(here * gradient, axis=-1) / square
        released = 0.0
        if hasattr(field, "core") and getattr(field, "release", "steadily") == "steadily":
            young = np.full(len(x), 0.5**2 / (2 * D))
            released = 2.0 * kernel(*here.T, young, field.dimensions)
            if hasattr(field, "covariance"):
                once = {"release": "at_once", "age": young[0], "velocity_gradient": field.velocity_gradient}
                released = swarm.ShearedSource(2.0, D, **once).concentration(here)
    current = here @ np.array(getattr(field, "velocity_gradient", ((0, 0), (0, 0)))).T
    expected = D * laplacian - np.sum(current * gradient, axis=-1) + released
    found = rate(field, "concentration", time, x)
    assert np.abs(found - expected).max() < 2e-5 * np.abs(D * laplacian).max()


@pytest.mark.parametrize("name", [name for name in FIELDS if "3" not in name and name != "moving"])
def test_nothing_that_was_released_is_lost(name):
    field, axis = FIELDS[name], np.arange(-80, 80, 0.5)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1)
    mass = (field.concentration(grid) - field.offset).sum() * 0.5**2
    once = name.startswith(("released", "at_once"))
    assert mass == pytest.approx(2.0 * (1.0 if once else 10.0 - 0.5**2 / (2 * D)), rel=1e-6)


@each_field
def test_gradients_and_rates_stay_within_the_stated_bounds(field, places):
    here = np.concatenate([places, 0.3 * places, 0.1 * places])
    steepest = fastest = 0.0
    for time in (0.0, 0.5, 3.0, 30.0, 300.0):
        place = here + (
            np.multiply(field.velocity, time) + field.position if hasattr(field, "velocity") else 0
        )
        gradient = slopes(field.at(time).concentration, place, 1e-3)[1]
        steepest = max(steepest, np.linalg.norm(gradient, axis=-1).max())
        fastest = max(fastest, np.abs(rate(field, "concentration", time, place)).max())
    assert 0.3 * field.max_gradient < steepest <= field.max_gradient * (1 + 1e-6)
    assert 0.1 * field.max_rate < fastest <= field.max_rate * (1 + 1e-6)


@pytest.mark.parametrize(
    "name", ["released_2", "releasing_2", "releasing_3", "moving", "at_once_ellipses", "steadily_strain"]
)
def test_a_field_is_seen_at_any_time(xp, name):
    field = FIELDS[name]
    assert isinstance(field.at(3.0), Field)
    for dtype in (xp.float32, xp.float64):
        for shape in ((), (3,), (2, 3), (0,)):
            place = array(xp, np.full((*shape, 2), 1.5), dtype)
            for time in (0, 5.0, np.float64(5.0), array(xp, np.full(shape[-1:], 5.0))):
                found = field.at(time).concentration(place)
                assert found.shape == shape
                assert found.dtype == dtype
            np.testing.assert_array_equal(
                to_numpy(field.concentration(place)), to_numpy(field.at(0).concentration(place))
            )
    place, times = array(xp, np.full((2, 3, 2), 1.5)), [0.0, 1.0, 7.0]
    together = to_numpy(field.at(array(xp, times)).concentration(place))
    alone = [to_numpy(field.at(time).concentration(place))[0, 0] for time in times]
    np.testing.assert_allclose(together, [alone, alone], rtol=1e-12)
    assert len(set(alone)) == 3
    view = field.at(1.0)
    assert view.offset == field.offset
    assert (view.gradient_scale, view.max_gradient) == (field.gradient_scale, field.max_gradient)
    assert not hasattr(view, "at")
    assert swarm.fields.describe(view) is None
    again = pickle.loads(pickle.dumps(view))
    assert to_numpy(again.concentration(place))[0, 0] == alone[1]


def test_the_typical_gradient_is_that_at_the_distance():
    for d in (2, 3):
        steady = swarm.ReleasingSource(dimensions=d, distance=3.0)
        gradient = slopes(steady.at(1e9).concentration, np.array([0.0, 3.0]), 1e-2)[1]
        assert np.linalg.norm(gradient) == pytest.approx(steady.gradient_scale, rel=1e-3)
        once = swarm.ReleasedSource(dimensions=d, distance=3.0)
        times = np.linspace(0, 200, 4001)[:, None]
        rows = slopes(
            lambda r, f=once, times=times: f.at(times).concentration(r), np.array([[0.0, 3.0]]), 1e-2
        )[1]
        assert np.abs(rows).max() == pytest.approx(once.gradient_scale, rel=1e-4)
    assert swarm.ShearedSource(gradient_scale=0.7).gradient_scale == 0.7


@pytest.mark.parametrize("rate", [1e-4, 1.0, 10.0])
@pytest.mark.parametrize("release", ["steadily", "at_once"])
def test_the_most_strained_cloud_is_finite(xp, rate, release):
    a = ((0.6 * rate, 0.8 * rate), (0.8 * rate, -0.6 * rate))
    field = swarm.ShearedSource(velocity_gradient=a, release=release)
    place = array(xp, [[0.0, 0.0], [2.0, 1.0], [-30.0, 50.0]], xp.float32)
    for time in (0.0, 100.0, 1e4):
        found = to_numpy(field.at(time).concentration(place))
        assert np.isfinite(found).all()
        assert found.min() >= 0
    assert 0 < field.max_rate < math.inf
    assert 0 < field.max_gradient < math.inf


# --- flows ------------------------------------------------------------------------------------------------


@each_flow
def test_a_flow_swings_as_fast_as_it_says(flow):
    (left, right), (low, high) = getattr(flow, "box", ((-9, 9), (-9, 9)))
    places = np.random.default_rng(0).uniform((left, low), (right, high), (400, 2))
    fastest = []
    for time in (0.0, 1.7, 11.0):
        changing = np.linalg.norm(rate(flow, "velocity", time, places), axis=-1)
        fastest.append(changing.max() / flow.max_speed)
        again = flow.at(time + 2 * math.pi / flow.frequency).velocity(places)
        np.testing.assert_allclose(again, flow.at(time).velocity(places), atol=1e-12)
    assert 0.2 * flow.max_frequency < max(fastest) <= flow.max_frequency


@each_flow
def test_a_flow_is_seen_at_any_time(xp, flow):
    for dtype in (xp.float32, xp.float64):
        place = array(xp, np.full((2, 3, 2), 0.4), dtype)
        frozen = flow.at(array(xp, [0.0, 1.0, 7.0]))
        assert frozen.velocity(place).shape == (2, 3, 2)
        assert frozen.velocity(place).dtype == frozen.spin(place).dtype == dtype
        one = to_numpy(flow.at(7).velocity(place))[0, 0]
        np.testing.assert_allclose(to_numpy(frozen.velocity(place))[1, 2], one, rtol=1e-6)
        np.testing.assert_array_equal(to_numpy(flow.spin(place)), to_numpy(flow.at(0.0).spin(place)))


def test_oscillating_vortices_are_taylor_greens_moved_along(places):
    flow, time = FLOWS[1], 2.2
    moved = places - [2.0 * math.sin(0.7 * time) / 1.3, 0.0]
    known = swarm.TaylorGreen(0.4, 1.3).velocity(moved)
    np.testing.assert_allclose(flow.at(time).velocity(places), known, atol=1e-14)


def test_the_double_gyre_is_the_published_one(xp):
    """Shadden, Lekien & Marsden 2005, example 1: ψ = A sin(π f) sin(π y), A = 0.1, ε = 0.25, ω = 2π/10."""
    x, y = np.random.default_rng(0).uniform(0, (2.0, 1.0), (200, 2)).T
    for time in (0.0, 2.5, 6.1):
        a = 0.25 * math.sin(2 * math.pi / 10 * time)
        f, slope = a * x**2 + (1 - 2 * a) * x, 2 * a * x + 1 - 2 * a
        u = -math.pi * 0.1 * np.sin(math.pi * f) * np.cos(math.pi * y)
        v = math.pi * 0.1 * np.cos(math.pi * f) * np.sin(math.pi * y) * slope
        place = np.stack([x, y], axis=-1)
        found = to_numpy(swarm.DoubleGyre().at(time).velocity(array(xp, place)))
        np.testing.assert_allclose(found, np.stack([u, v], axis=-1), rtol=0, atol=1e-15)
        large = swarm.DoubleGyre(size=20.0).at(time).velocity(20.0 * place)
        np.testing.assert_allclose(large, found, rtol=0, atol=1e-14)
    inside = swarm.DoubleGyre().inside(array(xp, [[0.0, 1.0], [2.1, 0.5], [1.0, -0.1], [1.9, 0.9]]))
    np.testing.assert_array_equal(to_numpy(inside), [True, False, False, True])


# --- parameters -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: swarm.ReleasedSource(age=0.0), "age must be a finite number above 0, got 0"),
        (lambda: swarm.ReleasingSource(core=0), "core must be a finite number above 0, got 0"),
        (lambda: swarm.ReleasingSource(dimensions=1), r"dimensions must be 2 \(a film\) or 3 .*, got 1"),
        (lambda: swarm.ReleasingSource(dimensions=2.5), "dimensions must be a whole number .*, got 2.5"),
        (lambda: swarm.ShearedSource(age=0.1), r"age must be above core²/2D = 0\.833333, .*, got 0\.1"),
        (lambda: swarm.ReleasingSource(age=0.1), r"age must be above core²/2D = 0\.833333, .*, got 0\.1"),
        (lambda: swarm.ShearedSource(release="slowly"), "release must be one of at_once, steadily, got"),
        (lambda: swarm.ShearedSource(velocity_gradient=((1, 0), (0, 1))), "velocity_gradient must be .* a"),
        (lambda: swarm.ShearedSource(velocity_gradient=3.0), "velocity_gradient must be .*, got 3.0"),
        (lambda: swarm.MovingSource(velocity=1.0), "velocity must be two finite numbers"),
        (lambda: swarm.DoubleGyre(displacement=0.5), "displacement must be below 0.5, .*, got 0.5"),
        (lambda: swarm.OscillatingTaylorGreen(frequency=0), "frequency must be a finite number above 0"),
    ],
)
def test_errors_name_the_parameter_the_rule_and_the_value(make, message):
    with pytest.raises((TypeError, ValueError), match=f"^{message}"):
        make()
