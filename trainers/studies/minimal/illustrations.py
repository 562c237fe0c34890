"""The figure of the study: how many parameters buy how much of the possible."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarm import figures
from swarm.figures import style
from trainers.studies.minimal.measurements import METHODS, PRUNED, CaseFindings, Measured
from trainers.studies.study import FIGURES

FIGURE = "parameters.png"
LEVELS = (0.95, 0.99)
COLOURS = ("#0072B2", "#56B4E9", "#D55E00", "#E69F00", "#009E73", "#222222")
LOOKS = dict(zip(METHODS, zip(COLOURS, "o.s^vD", strict=True), strict=True))


def draw(found: Mapping[str, CaseFindings], folder: Path) -> None:
    """Draw the figure of all experiments."""
    (folder / FIGURES).mkdir(parents=True, exist_ok=True)
    with style.in_style():
        figure = style.canvas(1.0, 0.5 if len(found) < 3 else 0.4)
        panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
        for place, (axes, (case, each)) in enumerate(zip(panels, found.items(), strict=True)):
            _panel(axes, each)
            axes.set(title=style.plain(case), xlabel="parameters")
            if not place:
                axes.set_ylabel("missing of the limit")
        handles = dict(zip(*panels[0].get_legend_handles_labels()[::-1], strict=True))
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4)
        figures.save(figure, folder / FIGURES / FIGURE)


def _panel(axes: Any, found: CaseFindings) -> None:
    """What of the limit is missing, by the number of parameters, on logarithmic axes."""
    for method, label in METHODS.items():
        rows = best_by_size(found, method)
        if method == PRUNED:  # of networks of all widths
            rows = [
                each
                for place, each in enumerate(rows)
                if all(each.validation.mean() > smaller.validation.mean() for smaller in rows[:place])
            ]
        if not rows:
            continue
        colour, marker = LOOKS[method]
        sizes = [each.rung.parameters for each in rows]
        numbers = [found.fraction(each) for each in rows]
        missing = np.array([1 - each.value for each in numbers])
        ends = np.array([1 - np.array(each.interval or (np.nan, np.nan)) for each in numbers])
        apart = np.abs(ends[:, ::-1] - missing[:, None]).T
        axes.errorbar(
            sizes, missing, apart, color=colour, marker=marker, ms=4, lw=0.9, elinewidth=0.7, label=label
        )
        for fewest in filter(None, (found.smallest(method, level) for level in LEVELS)):
            at = fewest.rung.parameters, 1 - found.fraction(fewest).value
            axes.plot(*at, "o", ms=9, mfc="none", mec=colour, mew=0.8)
    axes.axhline(
        1 - found.greedy.mean() / found.limit, color="#777777", lw=0.8, ls=(0, (4, 2)), label="greedy"
    )
    axes.set(xscale="log", yscale="log", ylim=(1.2, 0.003))
    axes.set_yticks([1, 0.3, 0.1, 0.05, 0.03, 0.01, 0.005], ["100%", "30%", "10%", "5%", "3%", "1%", "0.5%"])
    axes.minorticks_off()
    axes.set_xticks([1, 3, 10, 30, 100, 300], ["1", "3", "10", "30", "100", "300"])
    for level in LEVELS:
        axes.axhline(
            1 - level * (found.attainable or found.limit) / found.limit, color="#bbbbbb", lw=0.6, zorder=0
        )


def best_by_size(found: CaseFindings, method: str) -> list[Measured]:
    """A method's rungs, of those of the same size the one that validation prefers, by size."""
    best: dict[int, Measured] = {}
    for each in found.measured:
        size = each.rung.parameters
        if each.rung.method == method and (
            size not in best or each.validation.mean() > best[size].validation.mean()
        ):
            best[size] = each
    return [best[size] for size in sorted(best)]
