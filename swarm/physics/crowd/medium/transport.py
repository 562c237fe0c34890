"""Transport on a grid: diffusion exactly, advection spectrally and to the last molecule.

Along each axis of n nodes a function is a sum of n waves, of a Fourier series where the box is periodic and
of a cosine series where nothing passes its walls. Waves decay by diffusion as exp(−D k² t); as matrices they
serve every array library and device, compilers too, which know no complex numbers.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from swarm._support.arrays import namespace

Array = Any

ADVECTION_LIMIT = math.sqrt(3)  # of |k u| Δt in `advected`: the third-order Taylor polynomial is stable


class Waves(NamedTuple):
    """Waves along one axis, in one array library, precision and device."""

    basis: Array  # (n, n) a wave in each column, orthonormal at the nodes
    squares: Array  # (n,) k² [1 / length²]
    slope: Array  # (n, n): takes what flows at the nodes to its derivative there [1 / length]


def waves(nodes: int, length: float, *, periodic: bool) -> Waves:
    """The waves along an axis of a box, in NumPy; columns of `slope` sum to 0, so that nothing is lost."""
    number, identity = np.arange(nodes), np.eye(nodes)
    if periodic:
        k = 2 * math.pi / length * ((number + 1) // 2)  # 1, cos, sin, cos, sin, …
        angle = k * (number[:, None] + 0.5) * (length / nodes)
        basis = np.where(number % 2, np.cos(angle), np.sin(angle))
        basis[:, 0] = 1.0
        if nodes % 2 == 0:  # the shortest wave, which is as good as 0 at all nodes as a cosine
            basis[:, -1] = (-1.0) ** number
        frequency = 2 * math.pi / length * np.arange(nodes // 2 + 1)
        frequency[-1] *= nodes % 2  # its derivative vanishes at the nodes
        slope = np.fft.irfft(1j * frequency[:, None] * np.fft.rfft(identity, axis=0), nodes, axis=0)
    else:
        k = math.pi / length * number
        angle = k * (number[:, None] + 0.5) * (length / nodes)
        basis = np.cos(angle)
        slope = (np.cos(angle) * k) @ np.sin(angle).T * (2 / nodes)  # what flows is a series of sines
    return Waves(basis / np.linalg.norm(basis, axis=0), k**2, slope)


def propagator(along: Waves, rate: float, duration: Array) -> Array:
    """Matrix (..., n, n) that spreads by diffusivity `rate` during `duration` (...)."""
    xp = namespace(along.basis)
    decay = xp.exp((-rate * duration)[..., None] * along.squares)
    matrix = (along.basis * decay[..., None, :]) @ xp.matrix_transpose(along.basis)
    excess = xp.sum(matrix, axis=-2, keepdims=True) - 1  # rounding must not add up over a life
    return matrix - excess / matrix.shape[-1]


def diffused(grid: Array, spread: tuple[Array, Array]) -> Array:
    """A grid (..., nx, ny) spread by the matrices of both axes; its sum stays."""
    return spread[0] @ grid @ namespace(grid).matrix_transpose(spread[1])


def advected(grid: Array, velocity: Array, along: Array, across: Array, duration: Array) -> Array:
    """A grid (..., nx, ny) after ∂c/∂t = −∇·(u c) with a steady `velocity` (2, ..., nx, ny); its sum stays.

    `along` and `across` are the slopes of both axes. Of third order in the `duration` (...), stable up to
    `ADVECTION_LIMIT`.
    """
    xp = namespace(grid)
    across, moved = xp.matrix_transpose(across), grid
    for part in (3, 2, 1):  # Horner's scheme of the exponential function
        rate = along @ (velocity[0, ...] * moved) + (velocity[1, ...] * moved) @ across
        moved = grid - (duration / part)[..., None, None] * rate
    return moved
