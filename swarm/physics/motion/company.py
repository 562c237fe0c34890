"""Company: how cells swim that influence each other, all together, in the flow and in contact.

As in `collocation`, a cell moves along its exact arc and the deviation from it is integrated; the drift by
the others joins the flow's velocity and spin. Contact, which is stiff, is left to `pushes`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from swarm._support.arrays import Array, as_array, join, namespace, outer
from swarm._support.compiler import call_outside, outside
from swarm.physics.crowd.interactions import Contact, Interaction, check_interactions
from swarm.physics.crowd.neighbours import Together, everyone, neighbours, summed
from swarm.physics.flows import Flow, StillWater
from swarm.physics.motion.arc import Motion, Pose, along_arc, arc, components, turned, unit
from swarm.physics.motion.collocation import (
    SUBSTEPS,
    Collocation,
    fastest_change,
    integral,
    velocity_and_spin,
)
from swarm.physics.motion.domain import within

TOLERANCE = 2e-6  # error allowed to the pose after one interval without contact, in float64 [length, rad]
CONVERGED = 1e-8  # change of the pose at which `swim` halves substeps no more [length, rad]
MOST_SUBSTEPS = 4096
SWUM = 1.5  # smallest diameters that a cell swims at most in a substep beside contact,
SPUN = 0.035  # where others spin it by no more than this [rad / time]; else less
STEP, ROUGH = 0.3, 0.8  # stiffness times the length of a Runge–Kutta step of contact
MAX_STEPS = 4000  # Runge–Kutta steps of contact in an interval
CROWDING = 2.0  # dipoles beside a cell, whose scales add up


class Substep(NamedTuple):
    """What is known of a substep before it is integrated."""

    pose: Pose
    motions: Motion  # (2, targets, ..., cells)
    curvature: Array  # (..., cells)
    speed: Array
    step: Array  # its length [time]
    table: Array  # (targets, nodes, ..., cells) weights of the collocation
    alive: Array
    times: Array | None  # (nodes, ..., cells) [time]
    flow: Flow  # as cells meet it that come from where the interval began


@dataclass(frozen=True)
class Strongest:
    """About the largest velocity and spin from flow and interactions, by which schemes are chosen."""

    flow: Flow
    interactions: tuple[Interaction, ...]
    change: float  # how fast interactions change [rad / time]

    thing = "flow and interactions"
    max_shear = property(lambda self: getattr(self.flow, "max_shear", None))
    max_frequency = property(lambda self: fastest_change(self.flow) + self.change)

    def _sum(self, name: str, of_flow: float | None) -> float:
        own = getattr(self.flow, name) if of_flow is None else of_flow
        return own + CROWDING * sum(getattr(each, name, 0.0) for each in self.interactions)

    @property
    def speed_scale(self) -> float:
        """[length / time]."""
        return self._sum("speed_scale", getattr(self.flow, "max_speed", None))

    @property
    def spin_scale(self) -> float:
        """[rad / time]."""
        return self._sum("spin_scale", getattr(self.flow, "max_spin", None))


@dataclass(frozen=True)
class Company:
    """Interactions and flow, with the scheme that integrates them."""

    flow: Flow
    interactions: tuple[Interaction, ...]
    scheme: Collocation

    @classmethod
    def for_interval(
        cls,
        flow: Flow,
        interactions: tuple[Interaction, ...],
        turn: float,
        length: float,
        duration: float,
        spacing: float | None = None,
    ) -> Company:
        """The cheapest scheme for intervals that turn by `turn` [rad] over `length`.

        Raises ValueError where flow, interactions or contact vary too fast for it.
        """
        contacts = [each for each in interactions if isinstance(each, Contact)]
        pushing = sum(each.stiffness for each in contacts)
        if pushing * duration / STEP > MAX_STEPS:
            raise ValueError(
                f"stiffness must be at most {MAX_STEPS * STEP / duration:g}, which takes {MAX_STEPS} steps "
                f"per interval of {duration:g}, got {pushing:g}"
            )
        smooth = tuple(each for each in interactions if not isinstance(each, Contact))
        scales = ((getattr(each, "speed_scale", 0.0), getattr(each, "spin_scale", 0.0)) for each in smooth)
        waves = (spin / speed for speed, spin in scales if speed > 0)
        # a dipole turns twice as fast as its cell, two cells pass at twice their speed, and they may be near
        change = 2.5 * (turn + max(waves, default=0.0) * length) / duration if smooth else 0.0
        strongest = Strongest(flow, smooth, change)
        least = _least_substeps(contacts, smooth, length)
        scheme = Collocation.for_interval(strongest, turn, length, duration, spacing, TOLERANCE, least)
        return cls(flow, interactions, scheme)

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """The stiff ones."""
        return tuple(each for each in self.interactions if isinstance(each, Contact))

    @cached_property
    def smooth(self) -> tuple[Interaction, ...]:
        """The others."""
        return tuple(each for each in self.interactions if not isinstance(each, Contact))

    @cached_property
    def pushes(self) -> tuple[int, ...]:
        """The numbers by which `call_outside` knows what contact does, roughly and as it should be."""
        from swarm.physics.motion.pushes import Pushes  # with what compiles loops

        return tuple(outside(Pushes(self.contacts, self.scheme, step)) for step in (ROUGH, STEP))

    @cached_property
    def sums(self) -> tuple[int | None, ...]:
        """As `pushes`, what each of the smooth interactions does, where loops sum it up."""
        return tuple(summed(each) for each in self.smooth)

    @property
    def sweeps(self) -> int:
        """None are needed where nothing but contact leads off the arcs."""
        return self.scheme.sweeps if self.smooth or not isinstance(self.flow, StillWater) else 1

    def swim(
        self, pose: Pose, curvature: Array, speed: Array, duration: Array, alive: Array, time: Array = None
    ) -> tuple[Pose, Array | None]:
        """The pose after the interval and the path (places, ..., 2) on the way to it, if the scheme has
        outputs; curvature, speed and duration are (..., cells), as are `alive` and the `time` at the
        beginning, which only a flow that changes needs.
        """
        scheme, substeps = self.scheme, self.scheme.substeps
        step = duration / substeps
        motions = scheme.motions(curvature, speed, duration)
        table = outer(as_array(scheme.weights, pose.position), step)
        far = 2.5 * speed * duration  # what two cells may come nearer
        found = (
            everyone(number, pose.position, alive) or neighbours(each, pose.position, far, alive)
            for each, number in zip(self.smooth, self.sums, strict=True)
        )
        pairs = tuple(found)
        flow, path = within(self.flow, pose.position), []
        for number in range(substeps):
            times = None
            if time is not None:
                xp = namespace(step)
                times = xp.stack([time + (number + float(f)) * step for f in scheme.fractions])
            now = Substep(pose, motions, curvature, speed, step, table, alive, times, flow)
            pose, places = self._substep(now, pairs)
            path.append(places)
        return pose, namespace(pose.position).concat(path, axis=0) if scheme.outputs else None

    def _substep(self, now: Substep, pairs: tuple[Together, ...]) -> tuple[Pose, Array]:
        n, xp = self.scheme.nodes, namespace(now.speed)
        heading_x, heading_y = components(now.pose.heading)
        moved_x, moved_y = turned((heading_x, heading_y), *now.motions)  # (2, targets, ..., cells)
        position_x, position_y = components(now.pose.position)
        arc_x, arc_y = moved_x[0, ...] + position_x, moved_y[0, ...] + position_y
        tangent = moved_x[1, ...], moved_y[1, ...]
        along = tangent[0][:n, ...] * now.speed, tangent[1][:n, ...] * now.speed
        x, y, turn = arc_x, arc_y, arc_x[:1, ...] * 0
        for sweep in range(self.sweeps):
            sine, cosine = xp.sin(turn), xp.cos(turn)
            if self.sweeps > 1:
                head = turned((tangent[0][:n, ...], tangent[1][:n, ...]), cosine[:n, ...], sine[:n, ...])
                u, v, spin = self._rates(x[:n, ...], y[:n, ...], head, now, pairs)
                turn = integral(now.table, spin)
                sine, cosine = xp.sin(turn), xp.cos(turn)
                u, v = (
                    rate + change
                    for rate, change in zip(
                        (u, v), turned(along, cosine[:n, ...] - 1, sine[:n, ...]), strict=True
                    )
                )
                x, y = integral(now.table, u) + arc_x, integral(now.table, v) + arc_y
            else:
                u = v = along[0] * 0
            if self.contacts and sweep >= self.sweeps - 2:  # once to feel them where they are, once to end
                cell = position_x, position_y, heading_x, heading_y, now.curvature, now.speed, now.step
                push = self._push(self.pushes[sweep == self.sweeps - 1], now.alive, *cell, u, v, x, y)
                x, y = x + push[0, ...], y + push[1, ...]
        end = turned((tangent[0][-1, ...], tangent[1][-1, ...]), cosine[-1, ...], sine[-1, ...])
        return Pose(join(x[-1, ...], y[-1, ...]), unit(*end)), join(x[n:-1, ...], y[n:-1, ...])

    def _rates(
        self,
        x: Array,
        y: Array,
        head: tuple[Array, Array],
        now: Substep,
        pairs: tuple[Together, ...],
    ) -> tuple[Array, Array, Array]:
        """Velocity and spin (nodes, ..., cells) from the flow and from the others."""
        u, v, spin = velocity_and_spin(now.flow, x, y, now.times)
        for each, found in zip(self.smooth, pairs, strict=True):
            if found is None:
                velocity, turning = each.drift(join(x, y), join(*head), now.alive)
                du, dv = components(velocity)
            else:
                du, dv, turning = found.drift(each, x, y, head)
            u, v, spin = u + du, v + dv, spin + turning
        return u, v, spin

    def _push(self, number: int, alive: Array, *given: Array) -> Array:
        """What `Pushes` finds (2, targets, ..., cells), for any leading axes."""
        xp, shape = namespace(given[0]), alive.shape
        flat = [
            xp.reshape(each, (*each.shape[: each.ndim - len(shape)], -1, shape[-1]))
            for each in (alive, *given)
        ]
        targets = len(self.scheme.targets)
        found = call_outside(number, (2, targets, *flat[0].shape), given[0], *flat)
        return xp.reshape(found, (2, targets, *shape))


def _least_substeps(contacts: list[Contact], smooth: tuple[Interaction, ...], length: float) -> int:
    """Quadrature does not see the kinks of contact: what it errs by is as the square of a substep, and as the
    spin by the others.
    """
    if not contacts:
        return 1
    spin = sum(getattr(each, "spin_scale", 0.0) for each in smooth)
    wanted = length / (SWUM * min(each.diameter for each in contacts)) * max(1.0, spin / SPUN) ** 0.5
    return math.ceil(min(wanted, SUBSTEPS[-1]))


def swim(
    position: Array,
    heading: Array,
    curvature: Array,
    speed: Array,
    duration: Array,
    *,
    flow: Flow | None = None,
    interactions: Sequence[Interaction] = (),
    alive: Array = None,
    time: float = 0.0,
) -> Pose:
    """Where cells are and head after `duration` of constant curvature and speed, in flow and company.

    `position` (..., cells, 2) [length]; `heading` (..., cells) [rad] or unit vectors (..., cells, 2), and so
    returned; `curvature` [1 / length], of any sign and 0 too, `speed` [length / time] and `duration`
    [time] broadcast to (..., cells). `alive` (..., cells) bool marks those that act, all by default; a flow
    that changes begins at `time`. Exact to rounding alone in still water; within 1e-6 per interval of a turn
    in a flow; with interactions substeps are halved until that changes less than 1e-8, but for the kink of
    contact (1e-5). Raises ValueError where that takes more than 4096 of them.
    """
    xp = namespace(position)
    angles = heading.ndim == position.ndim - 1
    start = Pose(position, join(xp.cos(heading), xp.sin(heading)) if angles else heading)
    like = position[..., 0]
    curvature, speed, duration = (
        like * 0 + (as_array(np.asarray(each, float), like) if isinstance(each, (int, float)) else each)
        for each in (curvature, speed, duration)
    )
    flow = StillWater() if flow is None else flow
    given = check_interactions("interactions", interactions)
    if alive is None:
        alive = like == like
    end = _converged(flow, given, start, (curvature, speed, duration), alive, time)
    return Pose(end.position, xp.atan2(end.heading[..., 1], end.heading[..., 0])) if angles else end


def _converged(
    flow: Flow,
    interactions: tuple[Interaction, ...],
    start: Pose,
    arcs: tuple[Array, Array, Array],
    alive: Array,
    time: float,
) -> Pose:
    if not interactions and isinstance(flow, StillWater):
        return along_arc(start, arc(*arcs))
    xp = namespace(start.position)
    curvature, speed, duration = arcs
    began = None if not hasattr(flow, "at") else duration * 0 + time
    precise = CONVERGED if xp.finfo(start.position.dtype).eps < 1e-10 else 1e-4
    if any(isinstance(each, Contact) for each in interactions):
        precise *= 100  # the kink
    radians = float(xp.max(xp.abs(curvature * speed * duration)))
    tried = 1 << max(0, math.ceil(math.log2(1e-9 + radians)))
    before = None
    while tried <= MOST_SUBSTEPS:
        company = Company(flow, interactions, Collocation(5, 5, tried))
        end = company.swim(start, curvature, speed, duration, alive, began)[0]
        if before is not None:
            pairs = zip(end, before, strict=True)
            if float(sum(xp.max(xp.abs(new - old)) for new, old in pairs)) <= precise:
                return end
        before, tried = end, 2 * tried
    raise ValueError(
        f"flow and interactions must vary slowly enough to be followed in {MOST_SUBSTEPS} substeps, got "
        f"{flow!r} and {interactions}"
    )
