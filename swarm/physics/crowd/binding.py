"""Binding: a cell counts the molecules that bind to it, and so senses a concentration by chance.

During an interval n ~ Poisson(λ_b ∫c dt) molecules bind, and what is sensed is c = n/(λ_b ΔT).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from swarm._support.arrays import as_array, is_torch, namespace, polynomial

Array = Any

LARGEST_EXACT = 100.0  # mean up to which numbers are Poisson's; above they are normal
_NUMBERS = np.arange(221)  # more than 220 bind by a chance below 1e-22
_LOG_FACTORIALS = np.concatenate([[0.0], np.cumsum(np.log(_NUMBERS[1:]))])


def bindings(uniform: Array, mean: Array) -> Array:
    """Numbers (...) of bindings with the `mean` (...), one for each `uniform` (...) in [0, 1).

    By inversion, so that neighbouring uniforms give neighbouring numbers: Poisson's distribution up to a
    mean of 100, above it the normal one of the same mean and variance, rounded. A mean below 0 counts as 0.
    """
    xp = namespace(mean)
    mean = xp.clip(mean, 0, None)
    spread = xp.round(mean + xp.sqrt(mean) * normal_quantile(uniform))
    few = xp.clip(mean, 1e-30, LARGEST_EXACT)[..., None]
    numbers, factorials = as_array(_NUMBERS, mean), as_array(_LOG_FACTORIALS, mean)
    chances = xp.exp(numbers * xp.log(few) - few - factorials)
    # what stands for torch's cumsum makes its compiler warn
    chance = chances.cumsum(-1) if is_torch(chances) else xp.cumulative_sum(chances, axis=-1)
    counted = xp.sum(xp.astype(chance <= uniform[..., None], mean.dtype), axis=-1)
    counted = xp.where(mean > 0, counted, xp.zeros_like(counted))
    return xp.where(mean > LARGEST_EXACT, xp.clip(spread, 0, None), counted)


def counted(uniform: Array, mean: Array, volume: Array) -> Array:
    """The concentration (...) that the molecules bound tell: n/V of the mean V c, with V = λ_b ΔT.

    `mean` (...) is the true mean of c, which an interval of no length tells as it is.
    """
    xp = namespace(uniform)
    some = volume > 0
    safe = xp.where(some, volume, xp.ones_like(volume))
    return xp.where(some, bindings(uniform, safe * mean) / safe, mean)


def normal_quantile(uniform: Array) -> Array:
    """Φ⁻¹ (...) of numbers (...) in [0, 1) to 1e-6, up to 6.6 standard deviations.

    Wichura, Algorithm AS 241, Applied Statistics 37 (1988) 477: PPND7.
    """
    xp = namespace(uniform)
    centre = uniform - 0.5
    rest = xp.clip(0.180625 - centre * centre, 0, None)
    within = polynomial((3.3871327179, 50.434271938, 159.29113202, 59.109374720), rest)
    within = centre * (within / polynomial((1.0, 17.895169469, 78.757757664, 67.187563600), rest))
    tail = xp.sqrt(-xp.log(xp.clip(xp.minimum(uniform, 1 - uniform), 1.4e-11, None))) - 1.6
    beyond = polynomial((1.4234372777, 2.7568153900, 1.3067284816, 0.17023821103), tail)
    beyond = beyond / polynomial((1.0, 0.73700164250, 0.12021132975), tail)
    return xp.where(xp.abs(centre) <= 0.425, within, xp.where(centre < 0, -beyond, beyond))
