"""What all figures share: one style, how each policy looks, and parts of panels.

Every figure is drawn and saved within `in_style`; nothing here touches pyplot.
"""

from __future__ import annotations

import functools
import io
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from swarm._support import files
from swarm.physics.motion.domain import inside_all
from swarm.physics.world import World

if TYPE_CHECKING:
    import xarray as xr

WIDTH = 7.0  # of a page [inch]
INK = "#222222"
LIMIT = "limit of the mean"  # over many cells: a single one may gain more
RC: dict[str, Any] = {
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 9),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), 8),
    "legend.fontsize": 8.5,
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 0.7),
    **dict.fromkeys(("axes.spines.top", "axes.spines.right", "legend.frameon"), False),
    "lines.linewidth": 1.2,
    "figure.dpi": 100,
    "savefig.dpi": 200,
    "svg.hashsalt": "chemoswarm",
}


class Look(NamedTuple):
    """How a policy is drawn everywhere."""

    label: str
    colour: str
    line: Any
    marker: str


# Okabe and Ito's colours, which colour-blind readers can tell apart; lines and markers differ as well.
LOOKS = {
    "dqn": Look("DQN", "#0072B2", "-", "o"),
    "ppo": Look("PPO", "#E69F00", "-", "X"),
    "greedy": Look("greedy", "#D55E00", (0, (4, 1.5)), "s"),
    "swinging": Look("swinging", "#009E73", (0, (1, 1)), "^"),
    "random": Look("random", "#777777", (0, (1, 2)), "d"),
    "optimal": Look("optimal", "#222222", (0, (6, 1.5, 1, 1.5)), "D"),
    "limit": Look(LIMIT, "#222222", "-", "_"),
    "aware": Look("aware DQN", "#0072B2", "-", "o"),
    "blind": Look("blind DQN", "#CC79A7", (0, (5, 1, 1, 1)), "v"),
    "still": Look("still-water DQN", "#56B4E9", (0, (3, 1, 1, 1, 1, 1)), "P"),
    "alone": Look("alone, no medium", "#56B4E9", (0, (3, 1, 1, 1, 1, 1)), "<"),
    "wake": Look("alone, own wake", "#CC79A7", (0, (5, 1, 1, 1)), ">"),
    "crowd": Look("crowd of 40", "#0072B2", "-", "*"),
    "crowd_160": Look("crowd of 160", "#222222", "-", "d"),
    "crowd_ppo": Look("crowd of 40, PPO", "#E69F00", "-", "p"),
    "own": Look("own reward", "#0072B2", "-", "h"),
    "arrival": Look("reward arrival", "#CC79A7", (0, (5, 1, 1, 1)), "H"),
    "learnt": Look("learnt", "#0072B2", "-", "8"),
}
SPARE = ("#56B4E9", "#CC79A7", "#E69F00", "#4B0082")
ON_DARK = {  # the same colours for dark water, as far apart for every eye
    "#0072B2": "#5AB4FF",
    "#E69F00": "#FFD24A",
    "#D55E00": "#FF8A4C",
    "#009E73": "#2FD6A1",
    "#777777": "#8B939C",
    "#222222": "#FFFFFF",
    "#CC79A7": "#FF8AD0",
    "#56B4E9": "#B5E3FF",
    "#4B0082": "#9D7BFF",
}
DARK_IS_HIGH = LinearSegmentedColormap.from_list("dark is high", ["#ffffff", "#8f9aa5"])
BRIGHT_IS_FAST = LinearSegmentedColormap.from_list("bright is fast", ["#8f9aa5", "#ffffff"])

P = ParamSpec("P")


def in_style(more: Mapping[str, Any] | None = None) -> AbstractContextManager[None]:
    """Within, Matplotlib's own defaults hold and ours over them, whatever a user's matplotlibrc says."""
    return matplotlib.style.context(RC | dict(more or {}), after_reset=True)


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    @functools.wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with in_style():
            return draw(*args, **kwargs)

    return styled


def canvas(width: float, height: float) -> Figure:
    """An empty figure, its size in widths of a page."""
    return Figure(figsize=(width * WIDTH, height * WIDTH), layout="constrained")


def save(figure: Figure, path: str | os.PathLike) -> None:
    """Writes a figure (.png, .pdf or .svg) whole or not at all; the same figure gives the same bytes."""
    kind = Path(path).suffix.removeprefix(".").lower()
    undated = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
    if kind not in undated:
        raise ValueError(f"figures must be saved as .png, .pdf or .svg, got {str(path)!r}")
    buffer = io.BytesIO()
    with in_style():
        figure.savefig(buffer, format=kind, metadata=undated[kind], bbox_inches="tight", pad_inches=0.06)
    files.write_bytes(path, buffer.getvalue())


def plain(name: object) -> str:
    """A name as Matplotlib's text that shows it literally, dollars too."""
    return str(name).replace("$", r"\$")


def look(policy: str) -> Look:
    """How `policy` is drawn; names that are not known get a colour of their own."""
    if policy in LOOKS:
        return LOOKS[policy]
    spare = sum(policy.encode()) % len(SPARE)
    return Look(plain(policy), SPARE[spare], "-", "dXp*"[spare])


def looks(policies: Sequence[str]) -> dict[str, Look]:
    """How the policies of one figure look: as everywhere, unless colour, or line and marker, are taken."""
    named = sorted(policies, key=lambda name: name not in LOOKS)
    found: dict[str, Look] = {}
    for name, colour in zip(named, team_colours(named), strict=True):
        usual, taken = look(name), [(each.line, each.marker) for each in found.values()]
        spare = [each for each in LOOKS.values() if (each.line, each.marker) not in taken]
        shape = usual if (usual.line, usual.marker) not in taken or not spare else spare[-1]
        found[name] = usual._replace(colour=colour, line=shape.line, marker=shape.marker)
    return {name: found[name] for name in policies}


def team_colours(names: Sequence[str]) -> list[str]:
    """How the policies of one world are coloured: each its look's colour, or another where that is taken."""
    found: list[str] = []
    palette = dict.fromkeys([*SPARE, *(each.colour for each in LOOKS.values())])
    for name in names:
        free = [colour for colour in palette if colour not in found] or [look(name).colour]
        found.append(look(name).colour if look(name).colour not in found else free[0])
    return found


def chosen_policies(results: xr.Dataset, policies: Sequence[str] | None = None) -> list[str]:
    """The `policies`, unless they are given all of the results; ValueError for one that is not in them."""
    known = [str(name) for name in results["policy"].values]
    chosen = list(policies or known)
    for name in chosen:
        if name not in known:
            raise ValueError(f"policies must be among {', '.join(known)}, got {name!r}")
    return chosen


def frame(axes: Axes, *, square: bool = False, narrowest: float = 0.45) -> None:
    """Equal scales, with a small margin around what is drawn; `narrowest` is the least width per height."""
    axes.set_aspect("equal", adjustable="box")
    (left, right), (bottom, top) = axes.dataLim.intervalx, axes.dataLim.intervaly
    margin = 0.04 * max(right - left, top - bottom)
    width, height = right - left + 2 * margin, top - bottom + 2 * margin
    width = max(width, height if square else narrowest * height)
    height = max(height, width if square else narrowest * width)
    x, y = (left + right) / 2, (bottom + top) / 2
    axes.set(xlim=(x - width / 2, x + width / 2), ylim=(y - height / 2, y + height / 2))


def in_domain(world: World, quantity: Callable[[np.ndarray], Any], places: np.ndarray) -> np.ndarray:
    """A quantity (..., of each) of places (..., axes), NaN outside the domain, where it is not asked for."""
    inside = inside_all(world.domains, places)
    if inside is None or np.all(inside):
        return np.asarray(quantity(places))
    known = np.asarray(inside)
    found = np.asarray(quantity(places[known])) if known.any() else np.zeros(0)
    values = np.full((*known.shape, *found.shape[1:]), np.nan, np.result_type(found, np.float32))
    values[known] = found
    return values


def shade(
    axes: Axes,
    quantity: Callable[[np.ndarray], np.ndarray],
    colours: Any,
    span: tuple[float | None, float | None] = (None, None),
) -> Any:
    """Fills the axes, as wide as they are now, with a quantity of the place."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    step = max(right - left, top - bottom) / 300
    x, y = np.arange(left, right + step, step), np.arange(bottom, top + step, step)
    image = axes.imshow(
        quantity(np.stack(np.meshgrid(x, y), axis=-1)),
        cmap=colours,
        norm=Normalize(*span),
        extent=(x[0] - step / 2, x[-1] + step / 2, y[0] - step / 2, y[-1] + step / 2),
        origin="lower",
        interpolation="bilinear",
        zorder=-1,
    )
    axes.set(xlim=(left, right), ylim=(bottom, top))
    axes.spines[:].set_visible(True)
    return image


def shade_concentration(panels: Sequence[Axes], world: World) -> None:
    """Shades the panels, all on one scale, by the concentration."""
    concentration = functools.partial(in_domain, world, world.field.concentration)
    images = [shade(axes, concentration, DARK_IS_HIGH) for axes in panels]
    span = min(image.norm.vmin for image in images), max(image.norm.vmax for image in images)
    for image in images:
        image.set_clim(*span)
    shape: dict[str, Any] = {"shrink": 0.75, "aspect": 26, "pad": 0.02}
    panels[0].figure.colorbar(images[0], ax=list(panels), label="concentration $c$", **shape)


def around_egg(axes: Axes, world: World) -> None:
    """The egg, and room for it within the axes."""
    if world.egg is not None:
        (x, y), radius = world.egg
        axes.add_patch(Circle((x, y), radius, facecolor="#E69F00", edgecolor=INK, linewidth=0.8, zorder=4))
        axes.update_datalim([(x - radius, y - radius), (x + radius, y + radius)])


def lettered(axes: Sequence[Axes]) -> None:
    for letter, one in zip("abcdefgh", axes, strict=False):
        one.set_title(f"({letter})  {one.get_title(loc='left')}".rstrip(), loc="left")


def legend(axes: Axes, shown: Mapping[str, Look], **kwargs: Any) -> None:
    handles = [Line2D([], [], color=each.colour, linestyle=each.line) for each in shown.values()]
    axes.legend(handles, [each.label for each in shown.values()], **kwargs)


def legend_above(figure: Figure, axes: Axes, most: int | None = None) -> None:
    """Every label of the axes once, above the figure, at `most` so many in a row."""
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    ncols = min(most or len(unique), len(unique))
    figure.legend(list(unique.values()), list(unique), loc="outside upper right", ncols=ncols)


def label_beside(axes: Axes, marks: Sequence[tuple[float, str, str]]) -> None:
    """Labels right of the axes at given heights, moved apart where they would overlap."""
    low, high = axes.get_ylim()
    lines = 1 + max(text.count("\n") for _, text, _ in marks)
    marks, transform = sorted(marks), axes.get_yaxis_transform()
    heights = apart([value for value, *_ in marks], (0.01 + 0.06 * lines) * (high - low))
    for (value, text, colour), at in zip(marks, heights, strict=True):
        axes.plot([1.0, 1.035], [value, at], transform=transform, color=colour, linewidth=0.7, clip_on=False)
        axes.text(1.05, at, text, transform=transform, va="center", color=colour, fontsize=8)


def apart(values: Sequence[float], distance: float) -> np.ndarray:
    """Rising values moved as little as possible (least squares) to lie at least `distance` apart."""
    from scipy.optimize import isotonic_regression

    steps = distance * np.arange(len(values))
    return isotonic_regression(np.asarray(values) - steps).x + steps
