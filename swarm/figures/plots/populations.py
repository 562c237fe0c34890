"""Figures of populations: centrelines, gains and the way to an egg."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from swarm.figures import style
from swarm.figures.plots.life import path_of
from swarm.figures.plots.space import framed, mark_start, panel, panels
from swarm.physics.fields import LinearField
from swarm.physics.world import World
from swarm.population.statistics import statistics

if TYPE_CHECKING:
    import xarray as xr

GAIN = r"gain $\Delta c = c(t_\mathrm{life}) - c(0)$"
BINS, AT_ONCE = 120, 2**20  # of a distribution, and cells that are read at once


@style.styled
def centrelines(
    results: xr.Dataset, world: World, *, policies: Sequence[str] | None = None, cells: int | None = None
) -> Figure:
    """Centres of curvature of the paths of some `cells` under the `policies`, by default all.

    They lie over the concentration, or in a flow over its speed, with one panel per policy.
    """
    chosen = style.chosen_policies(results, policies)
    if world.in_flow and world.dimensions == 2:
        return _flow_panels(results, world, chosen, cells)
    figure = style.canvas(0.5, 0.55 if world.egg is None else 0.47)
    _centrelines_panel(panel(figure, 111, world), results, world, chosen, cells)
    return figure


@style.styled
def centrelines_and_gains(
    results: xr.Dataset, world: World, *, policies: Sequence[str] | None = None, cells: int | None = 16
) -> Figure:
    """(a) Centrelines of some `cells`, (b) gain of every cell: the paper's figure of a population, by default
    under all policies.
    """
    chosen = style.chosen_policies(results, policies)
    figure = style.canvas(1.0, 0.5)
    places = figure.add_gridspec(1, 2, width_ratios=(1.1, 1.2))
    left, right = panel(figure, places[0], world), figure.add_subplot(places[1])
    _centrelines_panel(left, results, world, chosen, cells)
    _gains_panel(right, results, chosen)
    style.lettered([left, right])
    return figure


def _centreline(results: xr.Dataset, policy: str, cell: int) -> np.ndarray:
    centre = results["centre"].sel(policy=policy).isel(cell=cell).values
    return centre[np.isfinite(centre[:, 0])]


def _draw_centrelines(
    axes: Axes, results: xr.Dataset, policy: str, look: style.Look, cells: int | None, width: float = 0.9
) -> None:
    for cell in range(results.sizes["cell"])[:cells]:
        line = _centreline(results, policy, cell)
        axes.plot(*line.T, color=look.colour, linestyle=look.line, linewidth=width, alpha=0.85)
        axes.plot(*line[0], ".", color=look.colour, markersize=3)


def _centrelines_panel(
    axes: Axes, results: xr.Dataset, world: World, policies: Sequence[str], cells: int | None
) -> None:
    looks = style.looks(policies)
    for name in reversed(policies):
        _draw_centrelines(axes, results, name, looks[name], cells)
    framed(axes, world, square=world.egg is not None, narrowest=0.8)
    if isinstance(world.field, LinearField) and world.dimensions == 2:
        arrow = {"arrowstyle": "-|>", "color": style.INK, "linewidth": 1.0, "shrinkB": 0}
        middle: dict[str, Any] = {"ha": "center", "va": "top", "xycoords": "axes fraction"}
        axes.annotate(r"$\nabla c$", (0.08, 0.99), (0.08, 0.83), arrowprops=arrow, **middle)
    elif world.dimensions == 2:  # in space the axes say where concentration grows
        style.shade_concentration([axes], world)
    above: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.02), "ncols": 3}
    style.legend(axes, looks, **above, handlelength=1.8, columnspacing=1.2)


ACROSS = 4  # panels of a flow, at most, in a row


def _flow_panels(results: xr.Dataset, world: World, policies: Sequence[str], cells: int | None) -> Figure:
    figure, looks = style.canvas(1.0, 0.15), style.looks(policies)
    rows = -(-len(policies) // ACROSS)
    across = -(-len(policies) // rows)
    every = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
    panels = list(every.flat)[: len(policies)]
    for axes, name in zip(panels, policies, strict=True):
        _draw_centrelines(axes, results, name, looks[name], cells)
        style.around_egg(axes, world)
        axes.set_title(looks[name].label, loc="left")
    for axes in list(every.flat)[len(policies) :]:
        axes.set_axis_off()
    for axes in panels[-across:]:
        axes.set_xlabel("$x$")
        axes.xaxis.set_tick_params(labelbottom=True)
    for axes in panels[::across]:
        axes.set_ylabel("$y$")
    for other in panels[1:]:  # the panels share their scales: the first one makes room for all
        panels[0].update_datalim(other.dataLim.corners())
    style.frame(panels[0])
    (left, right), (bottom, top) = panels[0].get_xlim(), panels[0].get_ylim()
    width = (style.WIDTH - 1.2) / across
    height = rows * (width * (top - bottom) / (right - left) + 0.8)
    figure.set_size_inches(style.WIDTH, min(9.0, max(2.6, height)))
    speed = partial(
        style.in_domain, world, lambda places: np.linalg.norm(world.flow.velocity(places), axis=-1)
    )
    for axes in panels:
        axes.set_aspect("equal", adjustable="box")
        mesh = style.shade(axes, speed, style.BRIGHT_IS_FAST, (0.0, None))
    style.lettered(panels)
    figure.colorbar(mesh, ax=list(panels), label="flow speed $|u|$", shrink=0.6, aspect=30, pad=0.015)
    return figure


@style.styled
def gains(results: xr.Dataset, *, policies: Sequence[str] | None = None) -> Figure:
    """Gain of every cell at the end of its life, by default under all policies; lines mark the means and,
    where there is one, the limit of the mean: single cells may lie above it.
    """
    figure = style.canvas(0.62, 0.42)
    _gains_panel(figure.add_subplot(), results, style.chosen_policies(results, policies))
    return figure


@style.styled
def distribution(results: xr.Dataset, *, policies: Sequence[str] | None = None) -> Figure:
    """How the gains of a population of any size are distributed, by default under all policies: the density
    of cells. Thin lines mark the means and, where there is one, the limit of the mean. Results in a file are
    read part by part.
    """
    figure = style.canvas(0.62, 0.42)
    axes, numbers = figure.add_subplot(), statistics(results)
    chosen = style.chosen_policies(results, policies)
    low, high = min(numbers[name]["min"] for name in chosen), max(numbers[name]["max"] for name in chosen)
    edges = np.linspace(low, high if high > low else low + 1.0, BINS + 1)
    for name, look in style.looks(chosen).items():
        own, counts = numbers[name], _counts(results["gain"].sel(policy=name), edges)
        label = f"{look.label}: {own['mean']:.2f} ± {own['std']:.2f}"
        density = counts / counts.sum() / np.diff(edges)
        axes.stairs(density, edges, color=look.colour, linestyle=look.line, linewidth=1.0, label=label)
        axes.axvline(own["mean"], color=look.colour, linestyle=look.line, linewidth=0.6)
    if (limit := results.attrs.get("limit")) is not None:
        limited = {"color": style.INK, "linestyle": style.look("optimal").line, "linewidth": 0.6}
        axes.axvline(limit, **limited, label=f"{style.LIMIT}: {limit:.2f}")
    axes.set(xlabel=GAIN, ylabel="density of cells", ylim=(0, None))
    axes.legend(frameon=True, framealpha=1.0, edgecolor="none")
    return figure


def _counts(gain: xr.DataArray, edges: np.ndarray) -> np.ndarray:
    """How many gains ([worlds,] cells) lie between edges."""
    step = max(1, AT_ONCE // (gain.size // gain.sizes["cell"]))
    parts = (gain.isel(cell=slice(at, at + step)).values for at in range(0, gain.sizes["cell"], step))
    return np.sum([np.histogram(part, edges)[0] for part in parts], axis=0)


def _gains_panel(axes: Axes, results: xr.Dataset, policies: Sequence[str]) -> None:
    numbers, cells, marks = statistics(results), results.sizes["cell"], []
    for name, look in style.looks(policies).items():
        gain, own = results["gain"].sel(policy=name).values, numbers[name]
        inside, size = look.colour if look.line == "-" else "none", 4.2 if cells <= 100 else 2.4
        shape: dict[str, Any] = {"markerfacecolor": inside, "markersize": size, "markeredgewidth": 0.9}
        axes.plot(range(1, cells + 1), gain, look.marker, color=look.colour, zorder=3, **shape)
        axes.axhline(own["mean"], color=look.colour)
        marks.append((own["mean"], f"{look.label}\n{own['mean']:.1f} ± {own['std']:.1f}", look.colour))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="cell", ylabel=GAIN, xlim=(0, cells + 1))
    limit = results.attrs.get("limit")
    if limit is not None:
        axes.axhline(limit, color=style.INK, linestyle=style.look("optimal").line)
        marks.append((limit, f"{style.LIMIT}\n{limit:.2f}", style.INK))
    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.03 * (high - low), high + 0.05 * (high - low))
    style.label_beside(axes, marks)


@style.styled
def radial(
    results: xr.Dataset, world: World, *, policy: str | None = None, cell: int = 0, cells: int = 9
) -> Figure:
    """(a) One cell's path to the egg with its centreline, (b) several centrelines, over the concentration."""
    name = policy or style.chosen_policies(results)[0]
    look = style.look(name)
    colour = look.colour
    figure = style.canvas(1.0, 0.43)
    left, right = panels(figure, world, 2)
    left.plot(*path_of(results, world, name, cell).T, color=colour, linewidth=0.6)
    left.plot(*_centreline(results, name, cell).T, color=style.INK, linewidth=1.2)
    mark_start(left, results, cell)
    _draw_centrelines(right, results, name, look, cells, width=1.1)
    for axes in (left, right):
        framed(axes, world, square=True)
    if world.dimensions == 2:
        style.shade_concentration([left, right], world)
    left.legend(left.lines[:2], ["path", "centreline"], loc="best")
    style.lettered([left, right])
    return figure
