"""Figures of one cell's life: its curvature, its path as it was swum, its gain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swarm.figures.style import (
    ENLARGED,
    INK,
    TALL,
    WIDTH,
    chosen_policies,
    contenders,
    label_beside,
    lettered,
    look,
    styled,
)
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.collocation import swim
from swarm.physics.world import World

if TYPE_CHECKING:
    import xarray as xr


def path_of(results: xr.Dataset, world: World, policy: str, cell: int, *, points: int = 12) -> np.ndarray:
    """The path (places, 2) of one life as it was swum: every interval's arc, cut into `points` pieces."""
    life = results.sel(policy=policy).isel(cell=cell)
    alive = np.isfinite(life["time"].values)
    time, angle, curvature = (
        life[name].values[alive].astype(float) for name in ("time", "heading", "curvature")
    )
    position = life["position"].values[alive].astype(float)
    moved = np.flatnonzero(np.diff(time) > 0)
    fraction = np.arange(points) / points
    heading = np.stack([np.cos(angle), np.sin(angle)], axis=-1)[moved, None]
    pose = Pose(
        np.broadcast_to(position[moved, None], (len(moved), points, 2)),
        np.broadcast_to(heading, (len(moved), points, 2)),
    )
    kappa = np.repeat(curvature[moved + 1, None], points, axis=1)
    speed = np.interp(kappa, world.curvatures, world.action_speeds)
    duration = np.diff(time)[moved, None] * np.append(fraction, 1.0)
    places = swim(pose, kappa, speed, duration[:, :-1], world.flow).position
    last = Pose(pose.position[:, 0], pose.heading[:, 0])
    reached = swim(last, kappa[:, 0], speed[:, 0], duration[:, -1], world.flow).position
    # Where noise bent the path, the arc ends beside the next place: the difference is spread over it.
    places = places + fraction[:, None] * (position[moved + 1] - reached)[:, None]
    return np.concatenate([places.reshape(-1, 2), position[moved[-1:] + 1]])


@styled
def comparison(
    results: xr.Dataset,
    world: World,
    *,
    cell: int = 0,
    policies: Sequence[str] | None = None,
    window: tuple[float, float] = (0.0, 16.0),
    enlarged: bool = True,
) -> Figure:
    """One cell under each policy: (a) its curvature during a `window` of time, (b) its path, (c) its gain.

    `enlarged` shows the path of the window once more, larger.
    """
    known = chosen_policies(results, None)
    chosen = (
        chosen_policies(results, policies)
        if policies
        else list(dict.fromkeys([*contenders(results), *known]))[:3]
    )
    figure = Figure(figsize=(WIDTH, 0.52 * WIDTH), layout="constrained")
    columns = figure.add_gridspec(1, 3, width_ratios=(1.0, 1.35, 1.0))
    lanes = columns[0].subgridspec(len(chosen), 1, hspace=0.12).subplots(sharex=True, squeeze=False)[:, 0]
    for axes, name in zip(lanes, chosen, strict=True):
        _curvature_lane(axes, results, world, name, cell, window)
    lanes[-1].set_xlabel("time $t$")
    path = figure.add_subplot(columns[1])
    _paths_panel(path, results, world, chosen, cell, window if enlarged else None)
    gain = figure.add_subplot(columns[2])
    marks = []
    for name in reversed(chosen):
        life = results.sel(policy=name).isel(cell=cell)
        style, concentration = look(name), life["concentration"].values
        risen = concentration - concentration[0]
        alive = np.isfinite(risen)
        gain.plot(life["time"].values[alive], risen[alive], color=style.colour, linewidth=0.9)
        marks.append((float(risen[alive][-1]), style.label, style.colour))
    gain.set(xlabel="time $t$", ylabel=r"gain $c(t) - c(0)$")
    steered = [name for name in chosen if name != "swinging"] or chosen
    gain.set_xlim(0, float(np.nanmax(results["time"].sel(policy=steered).isel(cell=cell))))
    label_beside(gain, marks)
    lettered([lanes[0], path, gain])
    return figure


def _curvature_lane(
    axes: Axes, results: xr.Dataset, world: World, policy: str, cell: int, window: tuple[float, float]
) -> None:
    life, style = results.sel(policy=policy).isel(cell=cell), look(policy)
    time, curvature = life["time"].values, life["curvature"].values
    shown = np.isfinite(time) & (time <= window[1] + 2 * max(world.intervals))
    axes.stairs(curvature[shown][1:], time[shown], baseline=None, color=style.colour, linewidth=1.2)
    span = world.curvatures[-1] - world.curvatures[0]
    axes.set(
        xlim=window,
        ylim=(world.curvatures[0] - 0.25 * span, world.curvatures[-1] + 0.55 * span),
        yticks=world.curvatures,
        ylabel=r"$\kappa$",
    )
    axes.text(
        0.99,
        0.98,
        style.label,
        transform=axes.transAxes,
        ha="right",
        va="top",
        color=style.colour,
        fontsize=8,
    )


def _paths_panel(
    axes: Axes,
    results: xr.Dataset,
    world: World,
    policies: Sequence[str],
    cell: int,
    window: tuple[float, float] | None,
) -> None:
    paths = {name: path_of(results, world, name, cell) for name in policies}
    for name in reversed(policies):
        axes.plot(*paths[name].T, color=look(name).colour, linewidth=0.6)
    axes.plot(*results["start_position"].isel(cell=cell).values, "o", color=INK, markersize=3, zorder=5)
    axes.set(xlabel="$x$", ylabel="$y$")
    shown = {}
    if window is not None:
        shown = {
            name: _within(results, path, name, cell, window)
            for name, path in paths.items()
            if name != "swinging"
        }
    _fit(axes, free=ENLARGED if shown else 0.0)
    if shown:
        _enlarge(axes, shown, results, cell)


def _fit(axes: Axes, *, free: float) -> None:
    """Equal scales in a box `TALL` times as high as wide; on the right, `free` of its width stays free."""
    (left, right), (bottom, top) = axes.dataLim.intervalx, axes.dataLim.intervaly
    width = max((right - left) / (0.92 - free), 1.08 * (top - bottom) / TALL)
    middle = left + (right - left) / 2 + free * width / 2
    axes.set(xlim=(middle - width / 2, middle + width / 2))
    axes.set_ylim((bottom + top) / 2 - TALL * width / 2, (bottom + top) / 2 + TALL * width / 2)
    axes.set_box_aspect(TALL)


def _within(
    results: xr.Dataset,
    path: np.ndarray,
    policy: str,
    cell: int,
    window: tuple[float, float],
    points: int = 12,
) -> np.ndarray:
    time = results["time"].sel(policy=policy).isel(cell=cell).values
    time = time[np.isfinite(time)]
    first, last = np.searchsorted(time, window)
    return path[max(0, first - 1) * points : last * points + 1]


def _enlarge(axes: Axes, shown: Mapping[str, np.ndarray], results: xr.Dataset, cell: int) -> None:
    corners = np.concatenate(list(shown.values()))
    low, high = corners.min(axis=0), corners.max(axis=0)
    height = 0.5  # of the axes
    tall = height * TALL / ENLARGED  # height of the enlarged part, per width
    middle, half = (low + high) / 2, 0.54 * max(high[0] - low[0], (high[1] - low[1]) / tall)
    inset = axes.inset_axes((0.99 - ENLARGED, 0.02, ENLARGED, height))
    for name, path in reversed(list(shown.items())):
        inset.plot(*path.T, color=look(name).colour, linewidth=0.9)
    inset.plot(*results["start_position"].isel(cell=cell).values, "o", color=INK, markersize=3, zorder=5)
    inset.set(
        xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - tall * half, middle[1] + tall * half)
    )
    inset.set(xticks=[], yticks=[])
    inset.spines[:].set_visible(True)
    axes.indicate_inset_zoom(inset, edgecolor=INK, linewidth=0.6)
