"""Independent physics that the tests compare with, and the traffic between array libraries."""

import dataclasses

import numpy as np
from scipy.integrate import solve_ivp

from swarm.physics.motion.arc import Pose


def array(xp, values, dtype=None):
    """`values` as an array of the library `xp`."""
    values = np.asarray(values)
    if dtype is None and values.dtype.kind == "f":
        dtype = xp.float64
    return xp.asarray(values.copy(), dtype=dtype)


def to_numpy(values):
    """An array of any library as a NumPy array."""
    return np.asarray(values)


def slopes_of(function, position, step=1e-5):
    """Derivatives (..., 2) of a function of positions along x and y, by central differences."""
    ahead, back = ([function(position + way * side) for side in step * np.eye(2)] for way in (1, -1))
    return np.stack([(a - b) / (2 * step) for a, b in zip(ahead, back, strict=True)], axis=-1)


def pose(xp, position, angle, dtype=None):
    """A pose from positions (..., 2) and angles (...)."""
    heading = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return Pose(array(xp, position, dtype or xp.float64), array(xp, heading, dtype or xp.float64))


def place_and_heading(pose):
    """Position and heading (..., 4) as NumPy numbers."""
    return np.concatenate([to_numpy(pose.position), to_numpy(pose.heading)], axis=-1)


def reference(position, heading, curvature, speed, duration, flow=None, *, parts=(1.0,)):
    """Position and heading (cells, 4) after `duration`, by an adaptive eighth-order Runge–Kutta method.

    With several `parts` of the duration, (parts, cells, 4).
    """
    cells = len(position)
    curvature, speed, duration = (np.broadcast_to(a, cells) for a in (curvature, speed, duration))

    def rate(_, y):
        x, y, angle = y.reshape(3, cells)
        rates = [speed * np.cos(angle), speed * np.sin(angle), speed * curvature]
        if flow is not None:
            places = np.stack([x, y], axis=-1)
            velocity = np.asarray(flow.velocity(places))
            rates = [rates[0] + velocity[:, 0], rates[1] + velocity[:, 1], rates[2] + flow.spin(places)]
        return (duration * np.stack(rates)).ravel()  # every cell in its own time, from 0 to 1

    angle = np.arctan2(heading[:, 1], heading[:, 0])
    start = np.concatenate([position[:, 0], position[:, 1], angle])
    ends = solve_ivp(rate, (0, 1), start, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=parts).y.T
    x, y, angle = np.moveaxis(ends.reshape(len(parts), 3, cells), 1, 0)
    path = np.stack([x, y, np.cos(angle), np.sin(angle)], axis=-1)
    return path[0] if len(parts) == 1 else path


def describe(world):
    """The parameters in which a world differs from the default, for the name of a test."""
    default = type(world)()
    return (
        "-".join(
            f"{item.name}={getattr(world, item.name)}"
            for item in dataclasses.fields(world)
            if getattr(world, item.name) != getattr(default, item.name)
        )
        or "default"
    )
