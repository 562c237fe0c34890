"""Bare arrays as data: a name for each, and the coordinates among them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarm.physics.grids import axes
from swarm.physics.grids.netcdf import COORDINATES
from swarm.physics.grids.units import AXES, SPACE, TIME


def labelled(data: Mapping[Any, Any]) -> Any:
    """Bare arrays by name, the coordinates x, y (z and time) among them, as a Dataset: they must be in
    order."""
    import xarray as xr

    arrays = {str(name): np.asarray(array) for name, array in data.items()}
    sizes = {}
    for axis in COORDINATES:
        if axis not in arrays:
            if axis not in AXES:
                continue
            raise ValueError(f"data must have the coordinate {axis}, got {sorted(arrays)}")
        if axis == "z" and arrays[axis].ndim == len(AXES):  # a quantity
            continue
        axes.check_numbers(axis, arrays[axis])
        if arrays[axis].ndim != 1:
            raise ValueError(f"{axis} must have one dimension, got {arrays[axis].shape}")
        axes.check_points(axis, arrays[axis], 1, "")
        axes.check_strict(axis, arrays[axis])
        sizes[axis] = len(arrays[axis])
    places = tuple(axis for axis in SPACE if axis in sizes)
    over = {
        tuple(sizes[axis] for axis in names): names
        for names in (places, (TIME, *places)[TIME not in sizes :])
    }
    for name in arrays.keys() - sizes.keys():
        if arrays[name].shape not in over:
            shapes = " or ".join(map(str, over))
            raise ValueError(f"{name} must have the shape {shapes} of its axes, got {arrays[name].shape}")
    variables = {name: (over[arrays[name].shape], arrays[name]) for name in arrays.keys() - sizes.keys()}
    return xr.Dataset(variables, {axis: arrays[axis] for axis in sizes})
