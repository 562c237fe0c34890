"""The figure of the table: how much of the possible every strategy attains in every world."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarm import figures
from swarm.figures import style
from trainers.strategies.measurements import WorldFindings
from trainers.strategies.plan import DQN, MINIMAL, OPTIMAL, PPO, STRATEGIES

FOLDER, FIGURE = "figures", "strategies.png"
COLUMNS = 4
COLOURS = {DQN: "#0072B2", PPO: "#E69F00", MINIMAL: "#CC79A7", OPTIMAL: style.INK}  # others: devised
DEVISED = "#009E73"


def draw(found: Mapping[str, WorldFindings], folder: Path) -> None:
    """Draw a panel for each world."""
    (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    columns = min(COLUMNS, len(found))
    lines = -(-len(found) // columns)
    with style.in_style():
        figure = style.canvas(1.0, 0.08 + 0.3 * lines)
        panels = figure.subplots(lines, columns, sharey=True, squeeze=False)
        for axes, (name, each) in zip(panels.flat, found.items(), strict=False):
            _panel(axes, each)
            axes.set_title(style.plain(name))
        for axes in panels.flat[len(found) :]:
            axes.set_visible(False)
        panels[0, 0].set_yticks(
            range(len(STRATEGIES)), [label.split(":")[0] for label in STRATEGIES.values()]
        )
        panels[0, 0].invert_yaxis()
        figures.save(figure, folder / FOLDER / FIGURE)


def _panel(axes: Any, found: WorldFindings) -> None:
    """Fractions of the limit with their intervals; around an egg the part that arrives."""
    egg = found.world.egg is not None
    for place, strategy in enumerate(STRATEGIES):
        number = found.arrived(strategy) if egg else found.fraction(strategy)
        if number is None:
            axes.text(0.0, place, "–", ha="center", va="center", color="#777777")
            continue
        ends = number.interval or (number.value, number.value)
        apart = [[number.value - ends[0]], [ends[1] - number.value]]
        colour = COLOURS.get(strategy, DEVISED)
        axes.errorbar(number.value, place, xerr=apart, color=colour, marker="o", ms=4, capsize=2, lw=1)
        axes.plot([0, number.value], [place, place], color=colour, lw=0.8, alpha=0.5, zorder=0)
    axes.axvline(1.0, color="#bbbbbb", lw=0.6, zorder=0)
    axes.set(xlim=(-0.08, 1.08), xlabel="part that arrives" if egg else "of the limit")
    axes.set_xticks([0, 0.5, 1], ["0", "50%", "100%"])
