"""Panels that show places: axes in the plane, or in space with equal scales, shadows on the walls, the egg a
sphere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from swarm.figures import style
from swarm.physics.fields import LinearField
from swarm.physics.world import World

if TYPE_CHECKING:
    import xarray as xr

WALL, GRID = (0.955, 0.96, 0.97, 1.0), "#d3dae2"
SHADOW, NARROWEST, MARGIN = 0.13, 0.4, 0.06  # opacity; least side, per longest; room around what is drawn
ZOOM = 1.06  # at which numbers and names still fit
FROM = {"elev": 18.0, "azim": -58.0}  # which the panels are seen [degrees]


def panel(figure: Figure, place: Any, world: World) -> Any:
    """Axes of a figure for places of a world."""
    if world.dimensions == 2:
        return figure.add_subplot(place)
    axes: Any = figure.add_subplot(place, projection="3d", proj_type="persp", focal_length=1.6)
    axes.view_init(**FROM)
    axes.zaxis.set_ticks_position("lower")
    axes.zaxis.set_label_position("lower")
    axes.zaxis.set_rotate_label(False)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color(WALL)
        axis._axinfo["grid"].update(color=GRID, linewidth=0.5)
        axis.set_tick_params(pad=-1.0, labelsize=7)
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    return axes


def panels(figure: Figure, world: World, columns: int, rows: int = 1, **grid: Any) -> list[Any]:
    """Axes of a figure for places of a world, side by side."""
    cells = figure.add_gridspec(rows, columns, **grid)
    return [panel(figure, cells[row, column], world) for row in range(rows) for column in range(columns)]


def framed(axes: Axes, world: World, **shape: Any) -> None:
    """Equal scales, names of the axes, and the egg; in space shadows of all lines, too."""
    if world.dimensions == 2:
        style.around_egg(axes, world)
        style.frame(axes, **shape)
        axes.set(xlabel="$x$", ylabel="$y$")
    else:
        _frame_in_space(axes, world)


def _frame_in_space(axes: Any, world: World) -> None:
    lines = [np.stack(line.get_data_3d()) for line in axes.lines]
    colours = [line.get_color() for line in axes.lines]
    corners = np.concatenate([*lines, *([_sphere(world, 3).reshape(3, -1)] if world.egg else [])], axis=1)
    low, high = np.nanmin(corners, axis=1), np.nanmax(corners, axis=1)
    longest = float((high - low).max())
    wide = np.maximum(high - low, NARROWEST * longest) + 2 * MARGIN * longest
    low, high = (low + high - wide) / 2, (low + high + wide) / 2
    walls = low[0], high[1], low[2]  # those behind
    for line, colour in zip(lines, colours, strict=True):
        for axis, wall in enumerate(walls):
            shadow = [np.full_like(one, wall) if i == axis else one for i, one in enumerate(line)]
            axes.plot(*shadow, color=colour, linewidth=0.5, alpha=SHADOW)
    if world.egg is not None:
        shaded: dict[str, Any] = {"color": "#E69F00", "linewidth": 0, "antialiased": False}
        axes.plot_surface(*_sphere(world, 24), **shaded)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(wide, zoom=ZOOM)
    along = r"$z \parallel \nabla c$" if isinstance(world.field, LinearField) else "$z$"
    axes.set(xlabel="$x$", ylabel="$y$")
    axes.set_zlabel(along, rotation=90)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.labelpad = -6.0


def _sphere(world: World, points: int) -> np.ndarray:
    """Places (3, points, 2 points) of the egg's surface."""
    assert world.egg is not None
    polar, around = np.meshgrid(np.linspace(0, np.pi, points), np.linspace(0, 2 * np.pi, 2 * points))
    unit = [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)]
    return np.array(world.egg[0])[:, None, None] + world.egg[1] * np.stack(unit)


def mark_start(axes: Any, results: xr.Dataset, cell: int) -> None:
    """A dot where a cell began."""
    place = results["start_position"].isel(cell=cell).values
    axes.plot(*place[:, None], "o", color=style.INK, markersize=3, zorder=5)
