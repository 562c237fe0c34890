"""The scale of a field that users bring, beside the gradients that cells meet."""

from __future__ import annotations

from contextlib import suppress
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from swarm.physics.fields import FunctionField
from swarm.physics.fields.field import warn_of_scale
from swarm.physics.motion.clock import frozen

POINTS = 12  # along each side of the start box
STEP = 0.01  # of differences, in mean radii of the paths
NEGLIGIBLE = 1e-9  # rise over a step, of the concentration

_seen: WeakValueDictionary[tuple[Any, ...], Any] = WeakValueDictionary()


def check_scale(world: Any) -> None:
    """Warns, once for a field, where its `gradient_scale` is off by more than twice from the gradients where
    lives start. Looked at are functions and classes of users; grids look at themselves.
    """
    field, box = world.field, world.box
    if type(field).__module__.startswith("swarm.") and not isinstance(field, FunctionField):
        return
    key = id(field), field.gradient_scale, box
    if _seen.get(key) is field:
        return
    with suppress(TypeError):  # of a field that nothing can refer to weakly
        _seen[key] = field
    if (typical := typical_gradient(world)) is not None:
        warn_of_scale(field.gradient_scale, typical, "sampled where lives start")


def typical_gradient(world: Any) -> float | None:
    """The root mean square of |∇c| in the start box [concentration / length], at the beginning, the middle
    and the end of a life; None where there is none, or the field cannot be asked.
    """
    step = STEP / world.mean_curvature
    sides = [np.linspace(low, high, POINTS) for low, high in world.box]
    axes = np.eye(len(sides))
    stencil = step * np.stack([axes, -axes], axis=1).reshape(-1, len(sides))
    places = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 1, len(sides)) + stencil
    field = world.field
    times = np.linspace(0.0, world.life, 3) if hasattr(field, "at") else [0.0]
    try:
        with np.errstate(all="ignore"):
            if getattr(field, "inside", None) is not None:
                places = places[np.asarray(field.inside(places), bool).all(axis=-1)]
            found = np.stack([np.asarray(frozen(field, time).concentration(places)) for time in times])
        slopes = (found[..., ::2] - found[..., 1::2]) / (2 * step)
        known = np.isfinite(slopes).all(axis=-1)
    except Exception:  # a function may want other arrays than NumPy's
        return None
    if not known.any():
        return None
    typical = float(np.sqrt(np.sum(slopes[known] ** 2, axis=-1).mean()))
    return typical if typical * step > NEGLIGIBLE * np.abs(found[known]).max() else None
