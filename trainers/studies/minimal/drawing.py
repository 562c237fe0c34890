"""One brain as a drawing: its graph, its numbers as formulas that can be typed in again, and what it computes
in words.
"""

import io
import math
from pathlib import Path
from typing import Any

import numpy as np

from swarm._support import files
from swarm.figures import style
from swarm.physics.world import World
from trainers.studies.minimal.brain import Brains

SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
OUTPUT = "κ₂ where "
MOST = 24  # parameters of a drawing that can be read
COLOURS = {True: "#0072B2", False: "#D55E00"}  # of weights above and below 0


def rounded(brain: Brains, digits: int) -> Brains:
    """A single brain without idle nodes, scaled so that the largest weight of its output is 1, which changes
    nothing, its numbers rounded.
    """
    (weights,), (biases,), inputs = brain.weights, brain.biases, brain.inputs
    used = _used(weights, inputs)
    rows, columns = [*used, brain.nodes], [*range(inputs), *(inputs + each for each in used)]
    weights, biases = weights[np.ix_(rows, columns)].copy(), biases[rows].copy()
    scale = np.abs(weights[-1]).max()
    weights[-1] /= scale
    biases[-1] /= scale
    return Brains(weights[None].round(digits), biases[None].round(digits))


def _used(weights: np.ndarray, inputs: int) -> list[int]:
    """The nodes that reach the output."""
    reached, before = np.zeros(len(weights) - 1, bool), -1
    while before != (before := int(reached.sum())):
        feeding = weights[:, inputs:] != 0
        reached = reached | feeding[-1] | feeding[:-1][reached].any(axis=0)
    return np.flatnonzero(reached).tolist()


def formulas(brain: Brains, digits: int) -> list[str]:
    """What a single brain does: a line for each node, and one for its output."""
    lines = []
    for row in range(brain.nodes + 1):
        numbers = zip(brain.weights[0, row], _names(brain), strict=True)
        terms = [f"{_signed(number, digits)} {name}" for number, name in numbers if number]
        terms += [_signed(brain.biases[0, row], digits)] if brain.biases[0, row] else []
        total = " ".join(terms)
        lines.append(f"{OUTPUT}{total} > 0" if row == brain.nodes else f"{_named('h', row)} = tanh({total})")
    return lines


def _names(brain: Brains) -> list[str]:
    """What numbers are called: c₀, κ₀ of the newest record, c₁, κ₁ of the one before; then nodes."""
    observed = [_named("cκ"[place % 2], place // 2) for place in range(brain.inputs)]
    return observed + [_named("h", node) for node in range(brain.nodes)]


def _named(letter: str, place: int) -> str:
    return letter + str(place).translate(SUBSCRIPTS)


def _signed(number: float, digits: int) -> str:
    return f"{'−' if number < 0 else '+'} {abs(number):.{digits}f}"


def words(brain: Brains, world: World) -> str:
    """What a single brain computes, in words, read off its numbers."""
    turning = math.hypot(world.mean_curvature, _mean_torsion(world))
    angle = turning * world.speed * float(world.intervals[0])  # that an interval turns [rad]
    said = []
    for row, name in enumerate([*(_named("h", node) for node in range(brain.nodes)), "The output"]):
        concentrations, curvatures = (brain.weights[0, row, at : brain.inputs : 2] for at in (0, 1))
        if not concentrations.any():
            continue
        about_mean = concentrations - concentrations.mean()  # c* is measured from the memory's mean
        response = np.sum(about_mean * np.exp(-1j * angle * np.arange(len(about_mean))))
        lag = -np.degrees(np.angle(response))
        where = "behind" if lag >= 0 else "ahead of"
        text = f"{name} follows the concentration, {abs(lag):.0f}° of a turn {where} it"
        if curvatures.any():
            push, bias = float(curvatures.sum()), float(brain.biases[0, row])
            held = "it holds on to a curvature once taken" if push > 0 else "it presses for a change"
            text += (
                f"; its threshold is {-bias - push:+.2f} while the records are of κ₂ and {push - bias:+.2f} "
                f"while they are of κ₁, of a signal that swings by ±{abs(response):.2f}: {held}"
            )
        said.append(text + ".")
    return " ".join([*said, _ideal(world)]).rstrip()


def _ideal(world: World) -> str:
    """How far κ₂ is to be behind the concentration; nothing where torsions of opposite signs lead to and fro.

    The axis (τ t + κ b)/√(κ² + τ²) of a helix turns towards the cell's normal, which points to the axis, at
    the rate v (τ δκ − κ δτ)/√(κ² + τ²) where curvature and torsion deviate by δκ and δτ (from the
    Frenet–Serret formulas); the cell swims along it, where τ < 0 against it.
    """
    half = 180 / world.n_records
    passing = "less half of the interval that passes with each decision, that is"
    if world.torsions is None:
        return (
            "A circle drifts uphill when it is tight on the way down: κ₂ is to begin where the concentration "
            "is largest and to end where it is smallest, a quarter of a turn behind it; "
            f"{passing} {90 - half:.0f}° behind."
        )
    first, last = world.torsions[0], world.torsions[-1]
    if first * last <= 0:
        return ""
    bend, twist = world.curvatures[-1] - world.curvatures[0], abs(last) - abs(first)
    if abs(_mean_torsion(world)) * bend > world.mean_curvature * twist:
        towards, where, lag = "towards", "smallest, half a turn behind it", f"{180 - half:.0f}° behind"
    else:
        towards, where, lag = "away from", "largest", f"{half:.0f}° ahead of it"
    return (
        f"A helix swum with κ₂ and its torsion turns its way {towards} the side where the cell's own normal "
        f"points: it is to be swum about where the concentration is {where}; {passing} {lag}."
    )


def _mean_torsion(world: World) -> float:
    return 0.0 if world.torsions is None else 0.5 * (world.torsions[0] + world.torsions[-1])


def draw(brain: Brains, digits: int, title: str, path: Path) -> None:
    """Draw a single brain as SVG whose text stays text."""
    with style.in_style({"svg.fonttype": "none"}):
        height = 0.5 + 0.03 * brain.nodes, 0.05 * (1 + brain.nodes)
        figure = style.canvas(1.0, sum(height))
        figure.set_layout_engine("none")  # formulas may be wider than the graph
        graph, lines = figure.subplots(2, 1, height_ratios=height)
        for axes in (graph, lines):
            axes.axis("off")
        graph.set_title(title)
        _draw_graph(graph, brain, digits)
        for place, line in enumerate(formulas(brain, digits)):
            lines.text(0.5, 1 - (place + 0.5) / (brain.nodes + 1), line, ha="center", va="center")
        buffer = io.BytesIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None}, bbox_inches="tight")
    files.write_bytes(path, buffer.getvalue())


def _draw_graph(axes: Any, brain: Brains, digits: int) -> None:
    """Inputs to the left, the output to the right, links as wide as they are strong."""
    (weights,), (biases,) = brain.weights, brain.biases
    used = [place for place in range(brain.inputs) if weights[:, place].any()]
    spots = {place: (0.0, 1 - (row + 0.5) / len(used)) for row, place in enumerate(used)}
    spots |= {
        brain.inputs + node: (0.5 + 0.1 * (node % 2), 1 - (node + 0.5) / brain.nodes)
        for node in range(brain.nodes)
    }
    end = len(_names(brain))
    spots[end] = (1.0, 0.5)
    names = dict(enumerate([*_names(brain), "> 0: κ₂"]))
    for row in range(brain.nodes + 1):
        target = spots[brain.inputs + row if row < brain.nodes else end]
        for place in np.flatnonzero(weights[row]).tolist():
            number, (x, y) = float(weights[row, place]), spots[place]
            axes.plot(
                *zip((x, y), target, strict=True),
                color=COLOURS[number > 0],
                lw=0.5 + 2.5 * min(abs(number), 1.5),
                zorder=1,
            )
            at = (x + 0.35 * (target[0] - x), y + 0.35 * (target[1] - y))
            axes.text(*at, _signed(number, digits), fontsize=8, ha="center", va="bottom", zorder=3)
    for place, (x, y) in spots.items():
        row = place - brain.inputs if place != end else brain.nodes
        label = names[place] + (f"\n{_signed(biases[row], digits)}" if row >= 0 and biases[row] else "")
        box = {"boxstyle": "round,pad=0.4", "fc": "white", "ec": style.INK, "lw": 0.7}
        axes.text(x, y, label, ha="center", va="center", bbox=box, zorder=2)
    axes.set(xlim=(-0.1, 1.15), ylim=(-0.05, 1.05))
