"""Figures of populations: centrelines, gains, the way to an egg, training, noise and groups of runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from swarm.figures import style
from swarm.figures.life import path_of
from swarm.physics.fields import LinearField
from swarm.physics.world import World
from swarm.population.results import RIVAL
from swarm.population.statistics import statistics

if TYPE_CHECKING:
    import xarray as xr

LIMIT = "limit of the mean"  # over many cells: a single one may gain more


@style.styled
def centrelines(
    results: xr.Dataset, world: World, *, policies: Sequence[str] | None = None, cells: int | None = None
) -> Figure:
    """Centres of curvature of the paths of some `cells` under the `policies`, by default all.

    They lie over the concentration, or in a flow over its speed, with one panel per policy.
    """
    chosen = style.chosen_policies(results, policies)
    if world.in_flow:
        return _flow_panels(results, world, chosen, cells)
    figure = style.canvas(0.5, 0.55 if world.egg is None else 0.47)
    _centrelines_panel(figure.add_subplot(), results, world, chosen, cells)
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
    left, right = figure.subplots(1, 2, width_ratios=(1.1, 1.2))
    _centrelines_panel(left, results, world, chosen, cells)
    _gains_panel(right, results, chosen)
    style.lettered([left, right])
    return figure


def _centreline(results: xr.Dataset, policy: str, cell: int) -> np.ndarray:
    centre = results["centre"].sel(policy=policy).isel(cell=cell).values
    return centre[np.isfinite(centre[:, 0])]


def _draw_centrelines(
    axes: Axes,
    results: xr.Dataset,
    policy: str,
    look: style.Look,
    cells: int | None,
    *,
    width: float = 0.9,
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
    style.around_egg(axes, world)
    style.frame(axes, square=world.egg is not None, narrowest=0.8)
    axes.set(xlabel="$x$", ylabel="$y$")
    if isinstance(world.field, LinearField):
        arrow = {"arrowstyle": "-|>", "color": style.INK, "linewidth": 1.0, "shrinkB": 0}
        middle: dict[str, Any] = {"ha": "center", "va": "top", "xycoords": "axes fraction"}
        axes.annotate(r"$\nabla c$", (0.08, 0.99), (0.08, 0.83), arrowprops=arrow, **middle)
    else:
        style.shade_concentration([axes], world)
    style.legend(
        axes,
        looks,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.02),
        ncols=3,
        handlelength=1.8,
        columnspacing=1.2,
    )


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

    def flow_speed(position: np.ndarray) -> np.ndarray:
        return style.in_domain(
            world, lambda places: np.linalg.norm(world.flow.velocity(places), axis=-1), position
        )

    for axes in panels:
        axes.set_aspect("equal", adjustable="box")
        mesh = style.shade(axes, flow_speed, style.BRIGHT_IS_FAST, (0.0, None))
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
    axes.set(xlabel="cell", ylabel=r"gain $\Delta c = c(t_\mathrm{life}) - c(0)$", xlim=(0, cells + 1))
    limit = results.attrs.get("limit")
    if limit is not None:
        axes.axhline(limit, color=style.INK, linestyle=style.look("optimal").line)
        marks.append((limit, f"{LIMIT}\n{limit:.2f}", style.INK))
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
    left, right = figure.subplots(1, 2)
    left.plot(*path_of(results, world, name, cell).T, color=colour, linewidth=0.6)
    left.plot(*_centreline(results, name, cell).T, color=style.INK, linewidth=1.2)
    style.mark_start(left, results, cell)
    _draw_centrelines(right, results, name, look, cells, width=1.1)
    for axes in (left, right):
        style.around_egg(axes, world)
        style.frame(axes, square=True)
        axes.set(xlabel="$x$", ylabel="$y$")
    style.shade_concentration([left, right], world)
    left.legend(left.lines[:2], ["path", "centreline"], loc="best")
    style.lettered([left, right])
    return figure


class Curve(NamedTuple):
    """Gains of a validation population during training."""

    moment: Any  # (moments,) epochs or decisions
    gain: Any  # (moments,) or (seeds, moments)
    greedy: float | None = None  # the same population's mean gain under greedy
    limit: float | None = None


@style.styled
def training(curves: Mapping[str, Curve] | Curve, *, policy: str = "dqn", label: str = "epoch") -> Figure:
    """Gain during training, a panel per title: the mean over seeds with the band from the worst to the best.

    `policy` says whose look and name the curves have, `label` what their moments are; where most of the rise
    is in the first tenth of them, the axis is logarithmic. Greedy and the limit of the mean are drawn in.
    Titles are Matplotlib's text; `style.plain` takes a name literally.
    """
    named = {"": curves} if isinstance(curves, Curve) else dict(curves)
    figure = style.canvas(0.62 if len(named) == 1 else 1.0, 0.38)
    panels = figure.subplots(1, len(named), sharey=True, squeeze=False)[0]
    early = all(map(_rises_early, named.values()))
    for axes, (title, curve) in zip(panels, named.items(), strict=True):
        _training_panel(axes, curve, style.look(policy))
        if early:
            decade = 10.0 ** np.floor(np.log10(min(each for each in curve.moment if each > 0)))
            axes.set_xscale("symlog", linthresh=decade, linscale=0.5)
            axes.set_xlim(-decade / 10, 1.1 * curve.moment[-1])
        axes.set_title(title, loc="left")
        axes.set_xlabel(label)
    panels[0].set_ylabel(r"gain $\Delta c$")
    style.legend_above(figure, panels[0])
    if len(named) > 1:
        style.lettered(panels)
    return figure


def _rises_early(curve: Curve) -> bool:
    """Whether most of the rise of the mean over seeds is in the first tenth of the moments, 0 among them."""
    moment, gain = np.asarray(curve.moment), np.atleast_2d(np.asarray(curve.gain, float)).mean(axis=0)
    early = gain[moment <= moment[-1] / 10]
    return moment[0] == 0 and 1 < len(early) < len(gain) and np.ptp(early) > np.ptp(gain) / 2


def _training_panel(axes: Axes, curve: Curve, look: style.Look) -> None:
    moment, gain = np.asarray(curve.moment), np.atleast_2d(np.asarray(curve.gain, float))
    rival = style.look(RIVAL)
    if curve.limit is not None:
        axes.axhline(curve.limit, color=style.INK, linestyle=style.look("optimal").line, label=LIMIT)
    if len(gain) > 1:
        band = gain.min(axis=0), gain.max(axis=0)
        axes.fill_between(moment, *band, color=look.colour, alpha=0.22, linewidth=0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    label = look.label if len(gain) == 1 else f"{look.label}, {len(gain)} seeds"
    marker = "o" if len(moment) <= 40 else None
    axes.plot(moment, gain.mean(axis=0), color=look.colour, label=label, marker=marker, markersize=2.5)
    if curve.greedy is not None:
        axes.axhline(curve.greedy, color=rival.colour, linestyle=rival.line, label=rival.label)


class Sweep(NamedTuple):
    """A quantity against something that varies, under several policies."""

    levels: Sequence[float]
    found: Mapping[str, Any]  # by policy (levels, 3): mean, and its interval; NaN where there is none
    label: str  # of the levels
    quantity: str
    marks: Mapping[float, str] = {}  # levels that are called by name
    logarithmic: bool = False
    joined: bool = True  # by lines; levels that are but names stand side by side
    chance: Mapping[str, tuple[float, float]] = {}  # straight lines to compare with, by name, and their ends


@style.styled
def sweeps(panels: Sequence[Sweep]) -> Figure:
    """A quantity against something that varies, with its intervals, one panel for each; policies differ by
    colour, line and marker.
    """
    width = min(1.0, 0.42 + 0.2 * len(panels))
    figure = style.canvas(width, 0.42 if len(panels) == 1 else 0.36)
    every = list(figure.subplots(1, len(panels), squeeze=False)[0])
    for axes, panel in zip(every, panels, strict=True):
        _sweep_panel(axes, panel)
    style.legend_above(figure, every[0], most=3)
    if len(panels) > 1:
        style.lettered(every)
    return figure


def _sweep_panel(axes: Axes, panel: Sweep) -> None:
    levels = np.asarray(panel.levels, float)
    looks = style.looks(list(panel.found))
    for place, (name, numbers) in enumerate(panel.found.items()):
        look, (mean, *band) = looks[name], np.asarray(numbers, float).T
        reach = np.nan_to_num(np.abs(np.array(band) - mean))
        line: dict[str, Any] = {"color": look.colour, "label": look.label}
        line["linestyle"] = look.line if panel.joined else ""
        beside = 0.0 if panel.joined else 0.12 * (place - (len(panel.found) - 1) / 2)
        axes.errorbar(levels + beside, mean, reach, capsize=3, marker=look.marker, ms=3.5, **line)
    for name, ends in panel.chance.items():
        axes.plot(levels[[0, -1]], ends, color=style.INK, linestyle=(0, (1, 2)), label=name, zorder=1)
    if panel.logarithmic:
        axes.set_xscale("log")
    if panel.marks:
        axes.set_xticks(list(panel.marks), list(panel.marks.values()), minor=False)
        axes.minorticks_off()
    axes.set(xlabel=panel.label, ylabel=panel.quantity)


@style.styled
def noise_sweep(
    levels: Sequence[float],
    results: Sequence[xr.Dataset],
    *,
    label: str,
    policies: Sequence[str] | None = None,
) -> Figure:
    """Mean gain, with its 95% interval, against a perturbation's strength, a test per level."""
    if len(levels) != len(results) or not len(levels):
        raise ValueError(f"levels must be one for each of the results, got {len(levels)} and {len(results)}")
    figure = style.canvas(0.62, 0.42)
    axes = figure.add_subplot()
    numbers = [statistics(one) for one in results]
    chosen = style.chosen_policies(results[0], policies)
    found = {}
    for name, look in style.looks(chosen).items():
        means = [each[name]["mean"] for each in numbers]
        intervals = [each[name]["ci95"] or (each[name]["mean"],) * 2 for each in numbers]
        found[name] = np.column_stack([means, intervals])
        axes.fill_between(levels, *np.transpose(intervals), color=look.colour, alpha=0.2, linewidth=0)
    _sweep_panel(axes, Sweep(levels, found, label, r"mean gain $\Delta c$"))
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    style.legend(axes, style.looks(chosen), loc="best")
    return figure


@style.styled
def groups(rows: Sequence[tuple[Mapping[str, Any], np.ndarray]]) -> Figure:
    """Mean gains of groups of runs: every seed (seeds,), the mean with its interval, greedy and the limit.

    A row holds `runs`, `mean`, `low`, `high`, `greedy` and `limit`; None where there is no number.
    """
    figure = style.canvas(1.0, 0.1 + 0.06 * len(rows))
    axes = figure.subplots()
    look, rival = style.look("dqn"), style.look(RIVAL)
    for place, (row, seeds) in enumerate(rows):
        axes.plot(seeds, np.full(len(seeds), place), "o", color=look.colour, alpha=0.35, markersize=4)
        if row["low"] is not None:
            axes.plot([row["low"], row["high"]], [place, place], color=look.colour, linewidth=2.4)
        mean = "mean, 95% interval, seeds"
        axes.plot(row["mean"], place, "D", color=look.colour, markersize=5, label=mean)
        axes.plot(row["greedy"], place, rival.marker, color=rival.colour, markersize=5, label=rival.label)
        if row["limit"] is not None:
            axes.plot([row["limit"]] * 2, [place - 0.3, place + 0.3], color=style.INK, label="limit")
    axes.set_yticks(range(len(rows)), [style.plain(row["runs"]) for row, _ in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel(r"mean gain $\Delta c$")
    style.legend_above(figure, axes)
    return figure
