"""The adaptive cell: curvature follows a signal to whose level the cell adapts, as biologists model sperm.

Output a and sensitivity p answer to the signal s = c/c_k (Friedrich and Jülicher, PNAS 104, 13256, 2007):

    σ ȧ = p s − a,        μ ṗ = p (1 − a),        κ = κ̄ + g (a − 1).

At any constant signal a returns to 1; to a small change of it, of angular frequency ω about the level s₀, it
answers with χ = (1/s₀) iωμ/(1 + iωμ − σμω²).
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, look_up, namespace
from swarm._support.checks import (
    Checked,
    check_flag,
    check_name,
    check_number,
    check_pair,
    optional,
    parameter,
)
from swarm.physics.motion.swimmer import Way
from swarm.physics.world import State, World
from swarm.policies import continuous

Array = Any

MODES = ("linear", "on_off")
MOST = 60.0  # of |ln p|: a signal that stays away must not overflow
QUICKEST = 0.3  # σω that is taken by default in space, at least
MOST_STEPS = 100_000  # in a decision: with more no life would end
RADIANS = 0.5  # that the quickest part of the response turns through in a step, at most


class Adaptation(NamedTuple):
    """What an adaptive cell carries."""

    output: Array  # (..., cells) a
    sensitivity: Array  # (..., cells) ln p, p [1 / length]
    owed: Array  # (..., cells) curvature that earlier decisions rounded off [1 / length]


def check_gain(name: str, value: Any) -> float | tuple[float, float]:
    """One gain above 0, or two."""
    if isinstance(value, tuple | list):
        return check_pair(name, value, rule="a number above 0, or two", above=0.0)
    return check_number(name, value, above=0.0)


@dataclass(frozen=True)
class AdaptiveSteering(Checked):
    """Steers by an adaptive response to the concentration.

    `mode` "linear" is κ = κ̄ + g (a − 1), held within [κ₁, κ_m] unless `clip=False`; "on_off" takes κ_m where
    a > 1, else κ₁. Sampled, the signal is what the last two records tell and runs evenly between them, and an
    action is the curvature nearest to the wanted one and to what earlier decisions rounded off. `continuous`,
    the curvature follows all the time, and the signal is the concentration where the cell is: with the noise
    of a record for the interval that it ends, with the bindings of each step where they are counted. Two
    gains with a `decision` are those below and above a signal of this level, to which 1/p has adapted
    (decision making: Kromer et al., PLOS Comput. Biol. 14 (2018) e1006109). None takes σ = 3/ω, sampled less
    ΔT/2, by which decisions are late, μ = 1/ω and g = 80 κ̄ of the world, ω = v κ̄.

    In space, sampled only, torsion goes with curvature as in the actions (Jikeli et al., Nat. Commun. 6
    (2015) 7985): κ = κ̄ ∓ g (a − 1) by the world's `response_sign`, ω = v w̄ and σ = (1 − tan(ωΔT/2))/ω, at
    least 0.3/ω, which brings the output into phase with the signal half an interval later. Raises TypeError
    or ValueError that names the parameter and its rule.
    """

    deterministic: ClassVar[bool] = True
    relaxation: float | None = parameter(None, optional(check_number), above=0.0)  # σ [time]
    adaptation: float | None = parameter(None, optional(check_number), above=0.0)  # μ [time]
    gain: float | tuple[float, float] | None = parameter(None, optional(check_gain))  # g [1 / length]
    mode: str = parameter("linear", check_name, known=MODES)
    clip: bool = parameter(True, check_flag)
    decision: float | None = parameter(None, optional(check_number), above=0.0)  # level of s [length]
    continuous: bool = parameter(False, check_flag)

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.gain, tuple) != (self.decision is not None):
            raise ValueError(f"decision must go with two gains, got {self.decision} with gain={self.gain}")
        if self.mode == "on_off" and self.decision is not None:
            raise ValueError(f"decision must go with mode='linear', got {self.decision:g} with 'on_off'")

    def begin(self, world: World, state: State) -> Adaptation:
        """Adapted to the mean of the records that life begins with."""
        if self.continuous:
            continuous.check_alone(world)
        self.steps(world)  # raises where they are too many
        xp = namespace(state.memory)
        level = xp.mean(state.memory[..., 0], axis=-1) / world.mean_curvature
        one = xp.ones_like(level)
        return Adaptation(one, -xp.log(xp.clip(level, math.exp(-MOST), None)), xp.zeros_like(level))

    def act_carrying(
        self, world: World, state: State, uniform: Array, carry: Adaptation
    ) -> tuple[Array, Adaptation]:
        """Actions (..., cells) of sampled steering, and what is carried on."""
        if self.continuous:
            raise ValueError(
                "continuous steering must be in a population test, a sweep or a film, got a decision"
            )
        xp = namespace(state.memory)
        newest, before = (state.memory[..., i, 0] / world.mean_curvature for i in (0, 1))
        intervals = as_array(np.asarray(world.clock.intervals), newest)
        length = intervals[0] if world.is_continuous else look_up(intervals, world.last_action(state))
        response = output, sensitivity = self._response(world, length, before, newest, carry)
        steering = output if world.response_sign > 0 else 2 - output
        wanted = self.curvature(world, steering, self.gain_at(world, sensitivity))
        if world.is_continuous:
            return wanted, Adaptation(*response, carry.owed)
        spacing = world.curvatures[1] - world.curvatures[0]
        wanted = xp.clip(wanted, world.curvatures[0], world.curvatures[-1]) + carry.owed
        action = xp.clip(xp.round((wanted - world.curvatures[0]) / spacing), 0, world.n_actions - 1)
        owed = xp.clip(wanted - (world.curvatures[0] + spacing * action), -spacing / 2, spacing / 2)
        return xp.astype(action, xp.int32), Adaptation(*response, owed)

    def times(self, world: World) -> tuple[float, float]:
        """σ and μ [time]."""
        unit = 1 / (world.mean_turning * max(world.action_speeds))
        late = 0.0 if self.continuous else 0.5 * max(world.clock.intervals)
        relaxation = (
            3 * unit - late if world.dimensions == 2 else unit * max(QUICKEST, 1 - math.tan(late / unit))
        )
        return self.relaxation or relaxation, self.adaptation or unit

    def swim(self, world: World, state: State, noise: Array, carry: Adaptation) -> tuple[Way, Adaptation]:
        """The way (..., cells) of continuous steering to the next decision, and what is carried on."""
        way, output, sensitivity = continuous.swim(self, world, state, noise, carry[:2])
        return way, Adaptation(output, sensitivity, carry.owed)

    def levels(self, world: World, gain: Array) -> tuple[Array, ...]:
        """Outputs (...), rising, at which the curvature has a kink or jumps."""
        one = 0 * gain + 1
        if self.mode == "on_off":
            return (one,)
        ends = (world.curvatures[0], world.curvatures[-1]) if self.clip else ()
        return tuple(one + (end - world.mean_curvature) / gain for end in ends)

    def curvature(self, world: World, output: Array, gain: Array, region: Array = None) -> Array:
        """κ (..., cells) of an output [1 / length]; region counts the `levels` below it."""
        xp = namespace(output)
        wanted = world.mean_curvature + gain * (output - 1)
        if self.mode == "linear" and not self.clip:
            return wanted
        if region is None:
            region = sum(xp.astype(output > level, xp.int32) for level in self.levels(world, gain))
        low, high = (xp.full_like(output, end) for end in (world.curvatures[0], world.curvatures[-1]))
        top = 1 if self.mode == "on_off" else 2
        return xp.where(region == 0, low, xp.where(region == top, high, wanted))

    def susceptibility(self, world: World, level: float) -> complex:
        """χ of the output at the frequency v κ̄, in space v w̄, and the signal's `level` s₀ [1 / length]."""
        relaxation, adaptation = self.times(world)
        turning = world.mean_turning * max(world.action_speeds)
        lag = 1j * turning * adaptation
        return lag / (1 + lag - relaxation * adaptation * turning**2) / level

    def drift(self, world: World, level: float, slope: float = 1.0) -> tuple[float, float]:
        """How quickly circles drift along the gradient and to its right [length / time], to first order in
        the gain, where the signal is `level` at the centre and rises by `slope` per length:
        −(v g r₀² |∇s| |χ|/2) sin(arg χ) and (v g r₀² |∇s| |χ|/2) cos(arg χ), r₀ = 1/κ̄.
        """
        if world.dimensions != 2:
            raise ValueError("drift must be asked for in the plane, got a world in space")
        response = self.susceptibility(world, check_number("level", level, above=0.0))
        gain = float(self.gain_at(world, np.asarray(-math.log(level))))
        size = 0.5 * max(world.action_speeds) * gain * slope * abs(response) / world.mean_curvature**2
        return -size * math.sin(cmath.phase(response)), size * math.cos(cmath.phase(response))

    def gain_at(self, world: World, sensitivity: Array) -> Array:
        """g (..., cells) of cells with this ln p [1 / length]."""
        xp, gain = namespace(sensitivity), self.gain or 80 * world.mean_curvature
        if not isinstance(gain, tuple) or self.decision is None:
            return xp.full_like(sensitivity, gain)
        low, high = (xp.full_like(sensitivity, each) for each in gain)
        return xp.where(sensitivity < -math.log(self.decision), high, low)

    def rates(self, world: World, signal: Array, output: Array, sensitivity: Array) -> tuple[Array, Array]:
        """Of a and ln p (..., cells) [1 / time]; a concentration below 0 counts as 0."""
        relaxation, adaptation = self.times(world)
        xp = namespace(output)
        sensed = xp.exp(xp.clip(sensitivity, -MOST, MOST)) * xp.clip(signal, 0, None)
        return (sensed - output) / relaxation, (1 - output) / adaptation

    def _response(
        self, world: World, length: Array, before: Array, newest: Array, carry: Adaptation
    ) -> tuple[Array, Array]:
        """a and ln p (..., cells) after an interval in which the signal runs evenly, by Runge–Kutta steps."""
        xp = namespace(newest)
        count = self.steps(world)
        step, state = length / count, (carry.output, carry.sensitivity)
        for number in range(count):
            rates: Any = (0.0, 0.0)
            total: Any = (0.0, 0.0)
            for part, weight in ((0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6)):
                at = [each + part * step * rate for each, rate in zip(state, rates, strict=True)]
                signal = before + (number + part) / count * (newest - before)
                rates = self.rates(world, signal, *at)
                total = [sum_ + weight * rate for sum_, rate in zip(total, rates, strict=True)]
            output, sensitivity = (each + step * rate for each, rate in zip(state, total, strict=True))
            state = output, xp.clip(sensitivity, -MOST, MOST)
        return state

    def steps(self, world: World) -> int:
        """How many steps an interval takes."""
        quickest = max(
            world.mean_turning * max(world.action_speeds), *(1 / time for time in self.times(world))
        )
        quickest = max(quickest, world.flow.spin_scale, world.curvatures[-1] * world.fastest)
        steps = max(world.clock.intervals) * quickest / RADIANS
        if world.egg is not None and self.continuous:  # the path is looked at between steps
            steps = max(steps, max(world.clock.intervals) / world.time_step)
        if not steps <= MOST_STEPS:
            rule = f"relaxation and adaptation must leave at most {MOST_STEPS} steps per decision"
            raise ValueError(f"{rule}, got {self.times(world)}")
        return math.ceil(steps - 1e-9)
