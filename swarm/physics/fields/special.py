"""Special functions that the array API lacks, of arrays of any library: E₁, erfc and e^{x²} erfc.

Each is its behaviour at infinity times a polynomial in 1 − 2h/(x + h), which maps x ≥ 0 to [−1, 1), near 0 a
power series: right to 1e-12 of its value in float64, in float32 to rounding of the exponent. The polynomials
interpolate continued fractions at Chebyshev points (erfc: Shepherd & Laframboise 1981, Math. Comp. 36, 249).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from swarm._support.arrays import Array, namespace, polynomial

DEGREE = 20  # of the polynomials; a higher one only adds rounding
TERMS = 200  # of the continued fractions, which are exact to rounding with half of them
SPLIT, E1_HALF, ERFC_HALF = 2.0, 4.0, 3.75  # E₁ by its power series below SPLIT; h of E₁ and of erfc


def exponential_integral(x: Array) -> Array:
    """E₁(x) = ∫ from x to ∞ of e^{−t}/t dt (...) for x > 0 (...), DLMF 6.2.1."""
    xp = namespace(x)
    near, far = xp.clip(x, None, SPLIT), xp.clip(x, SPLIT, None)
    series = near * polynomial(_SERIES, near) - np.euler_gamma - xp.log(near)
    return xp.where(x < SPLIT, series, xp.exp(-far) / far * polynomial(_E1, _mapped(far - SPLIT, E1_HALF)))


def scaled_erfc(x: Array) -> Array:
    """e^{x²} erfc(x) (...) for x ≥ 0 (...)."""
    return polynomial(_ERFC, _mapped(x, ERFC_HALF)) / (1 + 2 * x)


def erfc(x: Array) -> Array:
    """The complementary error function 2/√π ∫ from x to ∞ of e^{−t²} dt (...) of x (...), DLMF 7.2.2."""
    xp = namespace(x)
    size = xp.abs(x)
    above = xp.exp(-size * size) * scaled_erfc(size)
    return xp.where(x < 0, 2 - above, above)


def _mapped(x: Array, half: float) -> Array:
    """0, `half` and ∞ become −1, 0 and 1."""
    return 1 - 2 * half / (x + half)


def _interpolated(function: Callable[[np.ndarray], np.ndarray], half: float) -> list[float]:
    """Coefficients of the polynomial in `_mapped` x that interpolates a function of x ≥ 0."""
    series = Chebyshev.interpolate(lambda place: function(half * (1 + place) / (1 - place)), DEGREE)
    return series.convert(kind=Polynomial).coef.tolist()


def _far_e1(x: np.ndarray) -> np.ndarray:
    """y e^y E₁(y) at y = SPLIT + x, DLMF 6.9.1 contracted."""
    y, rest = SPLIT + x, np.zeros_like(x)
    for n in range(TERMS, 0, -1):
        rest = n * n / (y + 2 * n + 1 - rest)
    return y / (y + 1 - rest)


def _far_erfc(x: np.ndarray) -> np.ndarray:
    """(1 + 2x) e^{x²} erfc(x), by Python's own erfc where DLMF 7.9.1 converges slowly."""
    rest = np.zeros_like(x)
    for n in range(TERMS, 0, -1):
        rest = 0.5 * n / (x + rest)
    near = [math.exp(min(each, 2.0) ** 2) * math.erfc(min(each, 2.0)) for each in x]
    return (1 + 2 * x) * np.where(x < 2, near, 1 / (math.sqrt(math.pi) * (x + rest)))


_SERIES = [-((-1) ** k) / (k * math.factorial(k)) for k in range(1, 26)]  # (E₁ + ln x + γ)/x, DLMF 6.6.2
_E1 = _interpolated(_far_e1, E1_HALF)
_ERFC = _interpolated(_far_erfc, ERFC_HALF)
