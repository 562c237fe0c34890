"""Collocation: the deviation from the exact arc in a flow, at all Gauss nodes of a substep at once.

A cell moves as ṙ = v t + u(r), θ̇ = v κ + ω₀(r) with constant curvature κ and speed v (paper: equations of
motion).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from swarm._support.arrays import as_array, join, namespace, outer, stacked
from swarm._support.compiler import alongside, by_piece
from swarm.physics.flows import Flow, StillWater
from swarm.physics.motion.arc import Motion, Pose, along_arc, arc, components, turned, unit
from swarm.physics.motion.clock import frozen

Array = Any

TOLERANCE = 1e-6  # error allowed to the pose after one interval in a flow, in float64 [length, rad]
MIN_SWEEPS = 2  # one would leave the turn to the path without flow
SUBSTEPS = (*range(1, 16), *(round(16 * 1.25**i) for i in range(19)))  # tried, in this order


@dataclass(frozen=True)
class Collocation:
    """Picard sweeps on the deviation from the exact arc, which is exact without flow.

    The deviation (d, φ) of position and heading obeys d' = v [t(θ + φ) − t(θ)] + u, φ' = ω₀ along the arc;
    both are integrated by the Gauss–Legendre collocation of `nodes` points.
    """

    nodes: int
    sweeps: int
    substeps: int
    outputs: int = 0  # evenly spaced places within a substep where the path is wanted too

    largest_turn: ClassVar[float] = math.inf  # by the flow, in a substep [rad]

    @classmethod
    def for_interval(
        cls,
        flow: Any,
        turn: float,
        length: float,
        duration: float,
        spacing: float | None = None,
        tolerance: float = TOLERANCE,
        least: int = 1,
    ) -> Collocation:
        """The cheapest scheme that keeps a tolerance over an interval that turns by `turn` [rad] over
        `length`.

        Sweeps leave out less and less, nodes cost more with the angle they must follow, and what one of them
        cannot do is cut into substeps, at `least` so many. Of `flow` only the scales and bounds are asked.
        With a `spacing` [time] the path is given at least that often. Raises ValueError where the flow's
        scales ask for more than a thousand substeps.
        """
        cheapest, spun = None, _most(flow, "spin") * duration
        for substeps in (each for each in SUBSTEPS if each >= least):
            if spun / substeps > cls.largest_turn:
                continue
            if cheapest is not None and substeps * 3 * MIN_SWEEPS > cheapest[0]:
                break
            for nodes, sweeps in itertools.product(range(3, 7), range(MIN_SWEEPS, 7)):
                cost = substeps * sweeps * (nodes + 3)  # three: what a sweep costs however few the nodes
                if cheapest is None or cost < cheapest[0]:
                    error = error_estimate(flow, turn, length, duration, nodes, sweeps, substeps)
                    cheapest = (cost, nodes, sweeps, substeps) if error <= tolerance else cheapest
        if cheapest is None:
            raise ValueError(
                f"{getattr(flow, 'thing', 'flow')} must vary slowly enough to be followed in {SUBSTEPS[-1]} "
                f"substeps per interval of {duration:g}, got speed_scale = {flow.speed_scale:g} and "
                f"spin_scale = {flow.spin_scale:g}"
            )
        _, nodes, sweeps, substeps = cheapest
        outputs = 0 if spacing is None else math.ceil(duration / substeps / spacing - 1e-9)
        return cls(nodes, sweeps, substeps, outputs)

    @cached_property
    def fractions(self) -> np.ndarray:
        """Places of the nodes within a substep, in (0, 1)."""
        return (np.polynomial.legendre.leggauss(self.nodes)[0] + 1) / 2

    @cached_property
    def targets(self) -> np.ndarray:
        """Where the path is computed, as fractions of a substep: the nodes, the outputs, the end."""
        return np.concatenate([self.fractions, np.arange(self.outputs) / max(self.outputs, 1), [1.0]])

    @cached_property
    def weights(self) -> np.ndarray:
        """Integrals (targets, nodes) of the nodes' Lagrange polynomials from 0 to each target."""
        return self.integrals(self.targets)

    def integrals(self, ends: np.ndarray) -> np.ndarray:
        """Integrals (ends, nodes) of the nodes' Lagrange polynomials from 0 to each end."""
        powers = np.arange(self.nodes)
        return (ends[:, None] ** (powers + 1) / (powers + 1)) @ self._polynomials

    @cached_property
    def _polynomials(self) -> np.ndarray:
        """Coefficients (powers, nodes) of the nodes' Lagrange polynomials."""
        return np.linalg.inv(self.fractions[:, None] ** np.arange(self.nodes))

    def motions(self, curvature: Any, speed: Array, duration: Array) -> Any:
        """Motions (2, targets, ...) along the arc from the start of a substep to each target."""
        xp = namespace(duration)
        step = duration / self.substeps
        by_target = [arc(curvature, speed, float(target) * step) for target in self.targets]
        return Motion(*(xp.stack(parts, axis=1) for parts in zip(*by_target, strict=True)))

    def swim(
        self,
        pose: Pose,
        motions: Any,
        speed: Array,
        duration: Array,
        weights: Array,
        flow: Flow,
        time: Array = None,
    ) -> tuple[Pose, Array | None]:
        """The pose after the interval and the path (substeps · outputs, ..., 2), if it has outputs.

        `motions` comes from `self.motions`, `weights` is `self.weights` as an array of the pose's library;
        while torch compiles, both may be in pieces. The interval begins at `time` (..., cells) [time], which
        only a flow that changes needs.
        """
        step = duration / self.substeps
        table = outer(weights, step)  # (targets, nodes, ...)
        path = []
        for number in range(self.substeps):
            times = None if time is None else [time + (number + float(f)) * step for f in self.fractions]
            pose, places = self._substep(pose, motions, speed, table, flow, times)
            path.append(places)
        return pose, namespace(pose.position).concat(path, axis=0) if self.outputs else None

    def _substep(
        self,
        pose: Pose,
        motions: Any,
        speed: Array,
        table: Array,
        flow: Flow,
        times: list[Array] | None,
    ) -> tuple[Pose, Array | None]:
        start = *components(pose.position), *components(pose.heading), speed
        position_x, position_y, *heading, speed = alongside(motions.ahead, *start)
        n = self.nodes
        moved_x, moved_y = turned(tuple(heading), *motions)  # (2, targets, ...)
        arc_x, arc_y = moved_x[0, ...] + position_x, moved_y[0, ...] + position_y  # (targets, ...)
        tangent_x, tangent_y = moved_x[1, ...], moved_y[1, ...]
        along_x, along_y = tangent_x[:n, ...] * speed, tangent_y[:n, ...] * speed
        x, y = arc_x[:n, ...], arc_y[:n, ...]
        when = None if times is None else stacked(x, times)
        for sweep in range(self.sweeps):
            last = sweep == self.sweeps - 1
            flow_x, flow_y, spin = velocity_and_spin(flow, x, y, when)
            turn = integral(table if last else table[:n, ...], spin)  # φ (targets, ...)
            xp = namespace(turn)
            sine, cosine = xp.sin(turn), xp.cos(turn)
            rise, fall = sine[:n, ...], cosine[:n, ...] - 1
            rate_x = fall * along_x - rise * along_y + flow_x
            rate_y = fall * along_y + rise * along_x + flow_y
            # in the end the outputs and the end, else the nodes
            wanted = slice(n, None) if last else slice(n)
            x = integral(table[wanted, ...], rate_x) + arc_x[wanted, ...]
            y = integral(table[wanted, ...], rate_y) + arc_y[wanted, ...]
        end = turned((tangent_x[-1, ...], tangent_y[-1, ...]), cosine[-1, ...], sine[-1, ...])
        path = join(x[:-1, ...], y[:-1, ...]) if self.outputs else None
        return Pose(join(x[-1, ...], y[-1, ...]), unit(*end)), path


def integral(weights: Array, rate: Array) -> Array:
    """Σ weights (targets, nodes, ...) · rate (nodes, ...), in the same order however many cells there are."""
    rates = alongside(weights, *(rate[node, ...] for node in range(rate.shape[0])))
    total = weights[:, 0, ...] * rates[0]
    for node in range(1, len(rates)):
        total = total + weights[:, node, ...] * rates[node]
    return total


def velocity_and_spin(flow: Flow, x: Array, y: Array, time: Array = None) -> tuple[Array, Array, Array]:
    """u_x, u_y and ω₀ (...) at the places (x, y) and times (...); at one go where the flow knows how."""

    def both(x: Array, y: Array, *time: Array) -> tuple[Array, Array, Array]:
        now = frozen(flow, *time) if time else flow
        if hasattr(now, "velocity_and_spin"):
            u, v, spin = now.velocity_and_spin(x, y)
            return u, v, spin
        position = join(x, y)
        return (*components(now.velocity(position)), now.spin(position))

    u, v, spin = by_piece(both, x, y) if time is None else by_piece(both, x, y, time)
    return u, v, spin


def velocity_and_vorticity(flow: Flow, x: Array, y: Array, z: Array, time: Array = None) -> tuple[Array, ...]:
    """The six components (...) of velocity and vorticity at the places (x, y, z) and times (...), as
    `velocity_and_spin`.
    """
    now: Any = flow if time is None else frozen(flow, time)
    if hasattr(now, "velocity_and_vorticity"):
        return tuple(now.velocity_and_vorticity(x, y, z))
    position = join(x, y, z)
    return *components(now.velocity(position)), *components(now.vorticity(position))


def fastest_change(flow: Flow) -> float:
    """How fast a flow changes with time at a place [rad / time]: its `max_frequency`, else as it spins."""
    stated = getattr(flow, "max_frequency", None)
    return stated if stated is not None else flow.spin_scale if hasattr(flow, "at") else 0.0


def _most(flow: Flow, quantity: str) -> float:
    """The bound of a flow's speed or spin, its scale where it states none."""
    stated = getattr(flow, f"max_{quantity}", None)
    return getattr(flow, f"{quantity}_scale") if stated is None else stated


def error_estimate(
    flow: Flow, turn: float, length: float, duration: float, nodes: int, sweeps: int, substeps: int
) -> float:
    """About the largest error of the pose [length, rad] that a scheme leaves after an interval, from the
    flow's scales.

    Calibrated against DOP853 on Taylor–Green flows of wavenumbers 0.01 to 100 and speeds 1e-8 to 3, chaotic
    ones among them, in which neighbouring paths part within an interval.
    """
    fastest = _most(flow, "speed")
    spin = max(_most(flow, "spin"), getattr(flow, "max_shear", None) or 0.0)  # it may strain without spinning
    # it changes over a length of about speed/spin, if it does not say that it does so over a shorter one
    wavenumber = max(spin / fastest if fastest > 0 else 0.0, getattr(flow, "max_wavenumber", 0.0))
    step, speed = duration / substeps, length / duration
    shift = (fastest + 0.5 * speed * spin * step) * step  # the deviation from the arc
    # Gauss quadrature of a wave with as many radians as the arc and the flow turn through
    radians = turn / substeps + (math.sqrt(2) * wavenumber * (speed + fastest) + fastest_change(flow)) * step
    gauss = math.factorial(nodes) ** 4 / ((2 * nodes + 1) * math.factorial(2 * nodes) ** 3)
    quadrature = 0.5 * max(shift, spin * step) * gauss * radians ** (2 * nodes)
    for _ in range(sweeps):  # Picard: what is left of the deviation after each sweep
        angle = 0.5 * step * wavenumber * spin * shift
        shift = 0.5 * step * (speed * angle + spin * shift)
    # Neighbouring paths part, and an early error grows with them; the bound is for what no number can hold.
    growth = math.exp(min(0.45 * spin * duration, 700.0))
    return growth * substeps * max(quadrature, 0.4 * shift, 0.4 * angle)


def swim(pose: Pose, curvature: Array, speed: Array, duration: Array, flow: Flow | None = None) -> Pose:
    """The pose after `duration` (negative: before) with constant curvature and speed, all (..., cells).

    Exact to rounding without flow; within `TOLERANCE` per interval in a flow, in float64.
    """
    if flow is None or isinstance(flow, StillWater):
        return along_arc(pose, arc(curvature, speed, duration))
    xp = namespace(pose.position)
    length = float(xp.max(xp.abs(speed * duration)))
    scheme = Collocation.for_interval(
        flow, float(xp.max(xp.abs(curvature * speed * duration))), length, float(xp.max(xp.abs(duration)))
    )
    curvature, speed, duration = xp.broadcast_arrays(curvature, speed, duration)
    weights = as_array(scheme.weights, pose.position)
    motions = scheme.motions(curvature, speed, duration)
    return scheme.swim(pose, motions, speed, duration, weights, flow)[0]
