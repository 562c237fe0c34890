"""Figures of one cell's life: its curvature, its path as it was swum, its gain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swarm.figures import style
from swarm.figures.plots.space import framed, mark_start, panel
from swarm.figures.scene import Helices
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.collocation import swim
from swarm.physics.world import World

if TYPE_CHECKING:
    import xarray as xr

TALL = 1.45  # height per width of the panel with paths
ENLARGED = 0.42  # width of its enlarged part, of the panel's; height 0.5
POINTS = 12  # into which an interval's path is cut
WINDOW = 0.0, 16.0  # of time, in which curvature and enlarged paths are shown


def path_of(results: xr.Dataset, world: World, policy: str, cell: int, *, points: int = POINTS) -> np.ndarray:
    """The path (places, axes) of one life as it was swum: every interval's arc or helix, cut into `points`
    pieces. In space, what a flow adds to a helix is spread evenly over it.
    """
    life = results.sel(policy=policy).isel(cell=cell)
    alive = np.isfinite(life["time"].values)
    time, heading, curvature, position = (
        life[name].values[alive].astype(float) for name in ("time", "heading", "curvature", "position")
    )
    moved = np.flatnonzero(np.diff(time) > 0)
    share, wait = np.linspace(0, 1, points + 1), np.diff(time)[moved]
    bend, start, end = curvature[moved + 1], position[moved], position[moved + 1]
    if world.dimensions == 3:
        places = Helices.of(world, Pose(start, heading[moved]), end, bend, wait, wait > 0).places(share)
    else:
        angle = heading[moved, None] + 0 * share
        pose = Pose(start[:, None] + 0 * share[:, None], np.stack([np.cos(angle), np.sin(angle)], axis=-1))
        kappa, speed = bend[:, None] + 0 * share, np.interp(bend, world.curvatures, world.action_speeds)
        places = swim(pose, kappa, speed[:, None] + 0 * share, wait[:, None] * share, world.flow).position
        # Where noise bent the path, the arc ends beside the next place: the difference is spread over it.
        places = places + share[:, None] * (end - places[:, -1])[:, None]
    return np.concatenate([places[:, :-1].reshape(-1, places.shape[-1]), end[-1:]])


@style.styled
def comparison(
    results: xr.Dataset,
    world: World,
    *,
    cell: int = 0,
    policies: Sequence[str] | None = None,
    enlarged: bool = True,
) -> Figure:
    """One cell under each policy: (a) its curvature up to t = 16, (b) its path, (c) its gain.

    `policies` are by default all; `enlarged` shows the path up to then once more, larger, in the plane.
    """
    chosen = style.chosen_policies(results, policies)
    figure = style.canvas(1.0, 0.52)
    columns = figure.add_gridspec(1, 3, width_ratios=(1.0, 1.35, 1.0))
    lanes = columns[0].subgridspec(len(chosen), 1, hspace=0.12).subplots(sharex=True, squeeze=False)[:, 0]
    looks = style.looks(chosen)
    for axes, name in zip(lanes, chosen, strict=True):
        _curvature_lane(axes, results.sel(policy=name).isel(cell=cell), world, looks[name], len(chosen))
    lanes[-1].set_xlabel("time $t$")
    path, gain = panel(figure, columns[1], world), figure.add_subplot(columns[2])
    _paths_panel(path, results, world, looks, cell, enlarged=enlarged)
    _gain_panel(gain, results, looks, cell)
    style.lettered([lanes[0], path, gain])
    return figure


def _curvature_lane(axes: Axes, life: xr.Dataset, world: World, look: style.Look, lanes: int) -> None:
    time, curvature = life["time"].values, life["curvature"].values
    shown = np.isfinite(time) & (time <= WINDOW[1] + 2 * max(world.intervals))
    axes.stairs(curvature[shown][1:], time[shown], baseline=None, color=look.colour, linewidth=1.2)
    least, most = world.curvature_bounds
    span = most - least
    axes.set(xlim=WINDOW, ylim=(least - 0.25 * span, most + (0.3 + 0.08 * lanes) * span))
    axes.set(yticks=world.action_range or world.curvatures, ylabel=r"$\kappa$")
    where: dict[str, Any] = {"transform": axes.transAxes, "ha": "right", "va": "top", "fontsize": 8}
    axes.text(0.99, 0.98, look.label, color=look.colour, **where)


def _gain_panel(axes: Axes, results: xr.Dataset, looks: Mapping[str, style.Look], cell: int) -> None:
    marks, ends = [], {}
    for name, look in reversed(list(looks.items())):
        life = results.sel(policy=name).isel(cell=cell)
        alive = np.isfinite(life["concentration"].values)
        time, concentration = life["time"].values[alive], life["concentration"].values[alive]
        gain = concentration - concentration[0]
        axes.plot(time, gain, color=look.colour, linewidth=0.9)
        marks.append((float(gain[-1]), look.label, look.colour))
        ends[name] = float(time[-1])
    steered = [end for name, end in ends.items() if name != "swinging"]
    axes.set(xlabel="time $t$", ylabel=r"gain $c(t) - c(0)$", xlim=(0, max(steered or ends.values())))
    for (height, _, colour), end in zip(marks, ends.values(), strict=True):  # of lives that were over earlier
        axes.hlines(height, end, max(end, axes.get_xlim()[1]), color=colour, linewidth=0.5, linestyle=":")
    style.label_beside(axes, marks)


def _paths_panel(
    axes: Axes,
    results: xr.Dataset,
    world: World,
    looks: Mapping[str, style.Look],
    cell: int,
    *,
    enlarged: bool,
) -> None:
    paths = {name: path_of(results, world, name, cell) for name in looks}
    for name in reversed(list(looks)):
        axes.plot(*paths[name].T, color=looks[name].colour, linewidth=0.6)
    if world.dimensions == 3:
        framed(axes, world)
        mark_start(axes, results, cell)
        return
    mark_start(axes, results, cell)
    axes.set(xlabel="$x$", ylabel="$y$")
    shown = {}
    for name in looks:
        if enlarged and name != "swinging":
            time = results["time"].sel(policy=name).isel(cell=cell).values
            shown[name] = paths[name][: np.searchsorted(time[np.isfinite(time)], WINDOW[1]) * POINTS + 1]
    _fit(axes, free=ENLARGED if shown else 0.0)
    if shown:
        _enlarge(axes, shown, looks, results, cell)


def _fit(axes: Axes, *, free: float) -> None:
    """Equal scales in a box `TALL` times as high as wide; on the right, `free` of its width stays free."""
    (left, right), (bottom, top) = axes.dataLim.intervalx, axes.dataLim.intervaly
    width = max((right - left) / (0.92 - free), 1.08 * (top - bottom) / TALL)
    x, y = (left + right + free * width) / 2, (bottom + top) / 2
    axes.set(xlim=(x - width / 2, x + width / 2), ylim=(y - TALL * width / 2, y + TALL * width / 2))
    axes.set_box_aspect(TALL)


def _enlarge(
    axes: Axes,
    shown: Mapping[str, np.ndarray],
    looks: Mapping[str, style.Look],
    results: xr.Dataset,
    cell: int,
) -> None:
    corners = np.concatenate(list(shown.values()))
    low, high = corners.min(axis=0), corners.max(axis=0)
    tall = 0.5 * TALL / ENLARGED  # height of the enlarged part, per width
    (x, y), half = (low + high) / 2, 0.54 * max(high[0] - low[0], (high[1] - low[1]) / tall)
    inset = axes.inset_axes((0.99 - ENLARGED, 0.02, ENLARGED, 0.5))
    for name, path in reversed(list(shown.items())):
        inset.plot(*path.T, color=looks[name].colour, linewidth=0.9)
    mark_start(inset, results, cell)
    inset.set(xlim=(x - half, x + half), ylim=(y - tall * half, y + tall * half), xticks=[], yticks=[])
    inset.spines[:].set_visible(True)
    axes.indicate_inset_zoom(inset, edgecolor=style.INK, linewidth=0.6)
