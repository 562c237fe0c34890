"""Exact solutions of the medium: what cells eat and secrete, diffusion, a flow."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import exp1, k0

from benchmarks.exact_solutions import law
from swarm.physics.crowd.medium import Medium, MediumState
from swarm.physics.fields import FunctionField, LinearField
from swarm.physics.flows import ShearFlow, StillWater

DECISION = 0.38  # ΔT of four records
EVERYWHERE = FunctionField(lambda position: 1.0 + 0.0 * position[..., 0], gradient_scale=1.0)
NOWHERE = FunctionField(lambda position: 0.0 * position[..., 0], gradient_scale=1.0)


def lived(
    medium: Medium,
    field: Any,
    path: Callable[[float], np.ndarray],
    duration: float,
    *,
    interval: float = DECISION,
    substeps: int = 5,
    flow: Any = None,
) -> tuple[MediumState, np.ndarray]:
    """The medium after cells have followed a path, and what each ate per time in the last decision."""
    state, flow = medium.start(field, path(0.0)), flow or StillWater()
    alive, count = np.ones(len(path(0.0)), bool), round(duration / interval)
    interval, before = duration / count, state.eaten
    for i in range(count):
        before, time = state.eaten, i * interval
        places = np.stack([path(time + (j + 0.5) * interval / substeps) for j in range(substeps)])
        state = medium.step(state, lambda _: field, lambda _: flow, places, interval, alive, time)
    return state, (state.eaten - before) / interval


def from_(medium: Medium, state: MediumState, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (nodes, 2) of all nodes from a position, in meshes too."""
    offset = medium.mesh.places(state.origin) - position
    return offset, np.hypot(*offset.T) / medium.mesh.spacing[0]


@law("Uniform cells, uniform field: exp(−n k t/H)", "c", 1e-12)
def uniform() -> float:
    """A cell at every node."""
    medium = Medium(shape=(16, 16), uptake=0.0116, thickness=0.7)
    places = medium.mesh.places(np.zeros(2))
    state, _ = lived(medium, EVERYWHERE, lambda _: places, 20 * DECISION)
    rate = len(places) / math.prod(medium.mesh.size) * medium.uptake / medium.thickness
    sensed = medium.sense(state, places, 1.0)
    return float(np.abs(sensed / math.exp(-rate * 20 * DECISION) - 1).max())


def frozen_sink(kernel: str, offset: tuple[float, float], meshes: float = 2.0) -> float:
    """Error beyond two meshes, of a cell `offset` meshes from a corner of one, images in the edges too."""
    medium = Medium(
        box=((0, 5), (0, 5)), shape=(64, 64), uptake=0.0116, decay=0.1, kernel=kernel, edges="periodic"
    )
    position = np.array([[2.5, 2.5]]) + np.array(offset) * medium.mesh.spacing
    state, flux = lived(medium, EVERYWHERE, lambda _: position, 120.0, interval=1.0, substeps=8)
    offsets, distance = from_(medium, state, position)
    far, length = distance > meshes, math.sqrt(medium.diffusivity / medium.decay)
    images = [(5.0 * i, 5.0 * j) for i in range(-2, 3) for j in range(-2, 3)]
    depletion = sum(k0(np.hypot(*(offsets[far] + image).T) / length) for image in images)
    exact = 1 - flux[0] / (2 * math.pi * medium.diffusivity) * depletion
    return float(np.abs(1 + state.grid.reshape(-1)[far] - exact).max())


PLACES = ((0.0, 0.0), (0.5, 0.5), (0.5, 0.0), (0.3, 0.1), (0.2, 0.4))


@law("Frozen steady sink with turnover: c∞ − (J/2πD) K₀(r/ℓ), beyond 2 meshes, cubic kernel", "c∞", 1e-3)
def frozen_sink_cubic() -> float:
    """Worst of several places within a mesh."""
    return max(frozen_sink("cubic", place) for place in PLACES)


@law("The same, linear kernel", "c∞", 2.5e-3)
def frozen_sink_linear() -> float:
    """Worst of several places within a mesh."""
    return max(frozen_sink("linear", place) for place in PLACES)


def jitter(kernel: str) -> float:
    """By how much what a frozen cell senses depends on its place within a mesh."""
    medium = Medium(box=((0, 5), (0, 5)), shape=(64, 64), uptake=0.0116, decay=0.1, kernel=kernel)
    sensed = []
    for place in PLACES:
        position = np.array([[2.5, 2.5]]) + np.array(place) * medium.mesh.spacing
        state, _ = lived(medium, EVERYWHERE, lambda _, there=position: there, 20.0)
        sensed.append(float(medium.sense(state, position, 1.0)[0]))
    return max(sensed) - min(sensed)


@law("What a frozen cell senses does not depend on its place within a mesh", "c∞", 2e-3)
def jitter_cubic() -> float:
    """With the kernel as shipped."""
    return jitter("cubic")


@law("The same, linear kernel", "c∞", 0.05)
def jitter_linear() -> float:
    """With two nodes per axis."""
    return jitter("linear")


def moving_sink(nodes: int, *, beyond: float | None = None, angle: float = 0.0) -> float:
    """Error beyond six meshes, or beyond a distance, of a cell that has swum through most of a box."""
    medium = Medium(box=((0, 10), (0, 5)), shape=(nodes, nodes // 2), uptake=0.0116, edges="noflux")
    heading, start = np.array([math.cos(angle), math.sin(angle)]), np.array([[1.0, 2.013]])
    substeps = medium.substeps_for(StillWater(), 1.0, DECISION)
    duration = 21 * DECISION
    state, flux = lived(medium, EVERYWHERE, lambda t: start + heading * t, duration, substeps=substeps)
    offsets, distance = from_(medium, state, start + heading * duration)
    r, ahead = np.hypot(*offsets.T), offsets @ heading
    far = ((distance > 6) if beyond is None else (r > beyond)) & (ahead > -4)
    x = r / (2 * medium.diffusivity)  # v = 1; in front both factors together, which alone are too large
    depletion = (
        np.exp(-ahead / (2 * medium.diffusivity) - x) * k0(np.minimum(x, 600)) * np.exp(np.minimum(x, 600))
    )
    exact = flux[0] / (2 * math.pi * medium.diffusivity) * depletion
    return float(np.abs(-state.grid.reshape(-1) - exact)[far].max())


@law("Moving sink: c∞ − (J/2πD) exp(−vξ/2D) K₀(vr/2D), beyond 6 meshes", "c∞", 1.5e-3)
def moving_sink_any_way() -> float:
    """Along the mesh and across it."""
    return max(moving_sink(128), moving_sink(128, angle=0.2))


class Puff:
    """A Gaussian of a covariance, with one unit of amount per thickness."""

    gradient_scale = 1.0

    def __init__(self, covariance: np.ndarray) -> None:
        self.inverse, self.area = (
            np.linalg.inv(covariance),
            2 * math.pi * math.sqrt(np.linalg.det(covariance)),
        )

    def concentration(self, position: np.ndarray) -> np.ndarray:
        """Of a puff at the origin."""
        return np.exp(-0.5 * np.einsum("...i,ij,...j", position, self.inverse, position)) / self.area


def spread(edges: str, shear: float, nodes: int = 128) -> float:
    """Error of a carried puff, relative to its highest concentration."""
    medium = Medium(
        box=((-10, 10), (-5, 5)), shape=(nodes, nodes // 2), diffusivity=0.05, carried=True, edges=edges
    )
    d, first, duration = medium.diffusivity, 2.0, 10.0

    def puff(t: float) -> Puff:
        xx, xy, yy = 2 * d * t * (1 + (shear * t) ** 2 / 3), d * shear * t * t, 2 * d * t
        return Puff(np.array([[xx, xy], [xy, yy]]))

    flow = ShearFlow(speed_scale=shear, height=1.0) if shear else StillWater()
    state, _ = lived(medium, puff(first), lambda _: np.zeros((1, 2)), duration, substeps=4, flow=flow)
    exact = puff(first + duration).concentration(medium.mesh.places(state.origin))
    return float(np.abs(state.grid.reshape(-1) - exact).max() / exact.max())


@law("Puff released at once: M/(4πDt) exp(−r²/4Dt)", "its maximum", 1e-3)
def released_puff() -> float:
    """Periodic and not."""
    return max(spread(edges, 0.0) for edges in ("periodic", "noflux"))


@law("Puff in shear: σ_xx = 2Dt(1 + γ²t²/3), σ_xy = γDt², σ_yy = 2Dt", "its maximum", 1e-3)
def sheared_puff() -> float:
    """Periodic and not, where it vanishes at the edges."""
    return max(spread(edges, 0.2) for edges in ("periodic", "noflux"))


@law("Secreting cell: (q/4πDH) E₁(r²/4Dt), from 3 meshes to √(4Dt)", "c", 1e-3)
def secreting_cell() -> float:
    """A cell between nodes."""
    medium = Medium(box=((-3, 3), (-3, 3)), shape=(192, 192), secretion=0.5, edges="noflux", thickness=0.8)
    position, duration = np.array([[0.3, 0.2]]) * medium.mesh.spacing, 20.0
    state, _ = lived(medium, NOWHERE, lambda _: position, duration, substeps=8)
    offsets, distance = from_(medium, state, position)
    square = (offsets**2).sum(-1) / (4 * medium.diffusivity * duration)
    near = (distance > 3) & (square < 1)
    scale = medium.secretion / (4 * math.pi * medium.diffusivity * medium.thickness)
    return float(np.abs(state.grid.reshape(-1)[near] / (scale * exp1(square[near])) - 1).max())


def circles(time: float, cells: int = 40) -> np.ndarray:
    """Cells (cells, 2) on circles of curvature 4 which drift at a tenth of their speed, in 10 × 10."""
    numbers = np.random.default_rng(0).uniform(0, 1, (3, cells))
    angle = 4 * time + 2 * math.pi * numbers[2]
    centre = np.stack([10 * numbers[0], 1 + 4 * numbers[1] + 0.1 * time], axis=-1)
    return centre + 0.25 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


@law("Conservation over a life of 200: grid + eaten + decayed − secreted + outflow", "eaten", 1e-12)
def conservation() -> float:
    """40 cells in a deviation that wraps or is followed, and in what a flow carries."""
    busy: dict[str, Any] = {"shape": (64, 64), "uptake": 0.0116, "secretion": 0.002, "decay": 0.01}
    worst = 0.0
    for extra in ({"leaving": "wrap"}, {"leaving": "follow", "edges": "noflux"}, {"carried": True}):
        medium = Medium(**busy, **extra)
        state = medium.start(LinearField(), circles(0.0))
        before = medium.balance(state)
        state, _ = lived(medium, LinearField(), circles, 200.0, substeps=2)
        lost = np.abs(medium.balance(state) - before) / max(np.abs(state.eaten.sum()), np.abs(before))
        worst = max(worst, float(lost))
    return worst


@law("Substeps as shipped (5) against 4 times as many: what 40 circling cells sense", "c∞", 2e-3)
def substeps() -> float:
    """The largest difference of what cells sense."""
    medium = Medium(uptake=0.0116)
    shipped = medium.substeps_for(StillWater(), 1.0, DECISION)
    sensed = []
    for count in (shipped, 4 * shipped):
        state, _ = lived(medium, EVERYWHERE, circles, 30.0, substeps=count)
        sensed.append(medium.sense(state, circles(30.0), 1.0))
    return float(np.abs(sensed[0] - sensed[1]).max())
