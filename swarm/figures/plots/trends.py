"""Figures of what changes: gain during training, against noise or anything else, and from runs to runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from swarm._support.tables import with_symbols
from swarm.figures import style
from swarm.population.results import RIVAL
from swarm.population.statistics import statistics

if TYPE_CHECKING:
    import xarray as xr


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
        axes.axhline(curve.limit, color=style.INK, linestyle=style.look("optimal").line, label=style.LIMIT)
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
def noise_sweep(levels: Sequence[float], results: Sequence[xr.Dataset], *, label: str) -> Figure:
    """Mean gain, with its 95% interval, against a perturbation's strength, a test per level."""
    if len(levels) != len(results) or not len(levels):
        raise ValueError(f"levels must be one for each of the results, got {len(levels)} and {len(results)}")
    figure = style.canvas(0.62, 0.42)
    axes = figure.add_subplot()
    numbers = [statistics(one) for one in results]
    found, looks = {}, style.looks(style.chosen_policies(results[0]))
    for name, look in looks.items():
        means = [each[name]["mean"] for each in numbers]
        intervals = [each[name]["ci95"] or (each[name]["mean"],) * 2 for each in numbers]
        found[name] = np.column_stack([means, intervals])
        axes.fill_between(levels, *np.transpose(intervals), color=look.colour, alpha=0.2, linewidth=0)
    _sweep_panel(axes, Sweep(levels, found, label, r"mean gain $\Delta c$"))
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    style.legend(axes, looks, loc="best")
    return figure


@style.styled
def groups(rows: Sequence[tuple[Mapping[str, Any], np.ndarray]]) -> Figure:
    """Mean gains of groups of runs: every seed (seeds,), the mean with its interval, greedy and the limit.

    A row holds `runs`, `mean`, `low`, `high`, `greedy` and `limit`; None where there is no number.
    """
    figure = style.canvas(1.0, 0.12 + 0.065 * len(rows))
    axes = figure.subplots()
    look, rival = style.look("dqn"), style.look(RIVAL)
    for place, (row, seeds) in enumerate(rows):
        above = np.full(len(seeds), place - 0.22)
        axes.plot(seeds, above, "o", color=look.colour, alpha=0.4, markersize=4, label="seeds")
        reach = None if row["low"] is None else [[row["mean"] - row["low"]], [row["high"] - row["mean"]]]
        shape: dict[str, Any] = {"capsize": 4, "capthick": 1.4, "elinewidth": 2.4, "markersize": 3}
        told = f"{row['mean']:.2f}" + ("" if reach is None else f"\n{row['low']:.2f} … {row['high']:.2f}")
        label = "mean, 95% interval"
        axes.errorbar(row["mean"], place + 0.1, xerr=reach, fmt="D", color=look.colour, label=label, **shape)
        axes.text(1.01, place, told, transform=axes.get_yaxis_transform(), va="center", fontsize=8)
        axes.plot(row["greedy"], place, rival.marker, color=rival.colour, markersize=5, label=rival.label)
        if row["limit"] is not None:
            axes.plot([row["limit"]] * 2, [place - 0.35, place + 0.35], color=style.INK, label=style.LIMIT)
    axes.set_yticks(range(len(rows)), [with_symbols(str(row["runs"]), style.plain) for row, _ in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel(r"mean gain $\Delta c$")
    style.legend_above(figure, axes)
    return figure
