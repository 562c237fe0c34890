"""The figure of any statistic of a study against any axis of its dataset."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm._support.checks import check_name
from swarm._support.tables import with_symbols
from swarm.population.results import RIVAL
from trainers.jobs.comparison import in_symbols
from trainers.jobs.statistics import STATISTICS, Array, Lives, estimate

if TYPE_CHECKING:
    import xarray as xr

    from swarm.figures import Sweep

AXES = ("seed", "test", "policy", "world", "cell", "statistic")  # of a study's dataset beside its own
VARIABLES = {  # of a study's dataset: units, and what they are
    "gain": ("concentration", "c(end of life) − c(0)"),
    "time_to_egg": ("time", "arrival at the egg, infinite for who never came"),
    "limit": ("concentration", "physical limit of the mean gain"),
    "coupled": ("1", "whether what one cell does can matter to another"),
    "tested_world": ("", "settings of the world of the test, JSON"),
    "run": ("", "folder of the run"),
    "statistics": ("", "statistics of each seed, in the units of statistic_units"),
    "low": ("", "lower end of the 95% interval of a statistic's mean over all seeds and cells"),
    "high": ("", "upper end of the 95% interval of a statistic's mean over all seeds and cells"),
    "statistic_units": ("", "units of the statistics"),
}
FORM = "STATISTIC:AXIS[:AXIS=VALUE,...]"
LEARNT, LIMIT = "learnt", "limit"  # what figures call them


def axes_of(study: xr.Dataset) -> dict[str, list[Any]]:
    """The axes of a study's dataset that figures may have, and their values."""
    own = [name for name in study["gain"].dims if name not in AXES]
    return {str(name): study[name].values.tolist() for name in [*own, "seed", "test"]}


def lives_at(study: xr.Dataset, place: Mapping[str, Any], policy: str | None = None) -> Lives:
    """The lives at a place of the grid in a test: of all seeds, or the one it names; or of a reference."""
    here = study.sel({axis: value for axis, value in place.items() if axis != "seed"})
    rival = here.sel(policy=[RIVAL])["reference_gain"]
    if policy is not None:
        here = here.sel(policy=[policy])
    elif "seed" in place:
        here = here.sel(seed=[place["seed"]])

    def of_cells(values: xr.DataArray) -> Array:
        found = values.transpose(..., "cell").values
        return found if "world" in study.dims else found[:, None]

    prefix = "" if policy is None else "reference_"
    gain = of_cells(here[f"{prefix}gain"])
    there = np.isfinite(gain[0])
    inner = slice(None), slice(there.any(axis=1).sum()), slice(there.any(axis=0).sum())
    times = of_cells(here[f"{prefix}time_to_egg"])[inner] if "time_to_egg" in study else None
    if times is not None and np.isnan(times).any():  # no egg in this test
        times = None
    return Lives(gain[inner], of_cells(rival)[inner][0], times, float(here["limit"]), bool(here["coupled"]))


class Request(NamedTuple):
    """A figure that is asked for."""

    statistic: str
    axis: str
    chosen: dict[str, Any]  # values of other axes

    @property
    def name(self) -> str:
        """What its file is called."""
        parts = [self.statistic, self.axis, *(f"{axis}={value}" for axis, value in self.chosen.items())]
        return re.sub(r"[^\w.,=+-]", "_", "-".join(parts))


def request_of(text: str, axes: Mapping[str, Sequence[Any]]) -> Request:
    """What a figure's text asks for; raises ValueError that says what there is."""
    statistic, axis, chosen, *_ = [*text.split(":", 2), "", ""]
    if not axis:
        raise ValueError(f"figure must be {FORM}, got {text!r}")
    check_name(f"statistic of the figure {text}", statistic, STATISTICS)
    check_name(f"axis of the figure {text}", axis, axes)
    found: dict[str, Any] = {}
    for part in filter(None, chosen.split(",")):
        name, _, value = part.partition("=")
        check_name(f"axis of the figure {text}", name, [each for each in axes if each != axis])
        known = {str(each): each for each in axes[name]} | {
            f"{each:g}": each for each in axes[name] if not isinstance(each, str)
        }
        found[name] = known[check_name(f"{name} of the figure {text}", value, known)]
    return Request(statistic, axis, found)


def panels(study: xr.Dataset, request: Request) -> list[Sweep]:
    """The figure of a statistic against an axis: a panel for each test, a line for every combination of the
    other axes; beside them the references and the limit, each once where it is the same for several lines.
    """
    from swarm.figures import Sweep, plain

    axes, chosen = axes_of(study), request.chosen
    levels = axes[request.axis]
    others = {
        name: [chosen[name]] if name in chosen else values
        for name, values in axes.items()
        if name not in (request.axis, "seed")
    }
    tests = others.pop("test", [None])
    numeric, quantity = not any(isinstance(each, str) for each in levels), STATISTICS[request.statistic].label
    found = []
    for test in tests:
        fixed = {"test": test, "seed": chosen.get("seed")}
        fixed = {name: value for name, value in fixed.items() if value is not None}
        found.append(
            Sweep(
                levels if numeric else range(len(levels)),
                _lines(study, request, levels, others, fixed),
                _label(study, request.axis),
                f"{quantity} ({plain(test)})" if len(tests) > 1 else quantity,
                {} if numeric else {place: plain(level) for place, level in enumerate(levels)},
                joined=numeric,
            )
        )
    return found


def _lines(
    study: xr.Dataset,
    request: Request,
    levels: Sequence[Any],
    others: Mapping[str, Sequence[Any]],
    fixed: Mapping[str, Any],
) -> dict[str, Array]:
    """By name (levels, 3): the statistic with its interval, of policies, references and the limit."""
    several = [name for name, values in others.items() if len(values) > 1]
    rivals = study["policy"].values.tolist()[request.statistic in ("over_greedy", "wins") :]

    def line(places: Sequence[Mapping[str, Any]], policy: str | None = None) -> Array:
        return np.array([estimate(lives_at(study, each, policy), request.statistic) for each in places])

    found: dict[str, Array] = {}
    beside: dict[str, dict[tuple, Array]] = {name: {} for name in (*rivals, LIMIT)}
    for values in itertools.product(*others.values()):
        place = {**fixed, **dict(zip(others, values, strict=True))}
        places = [place | {request.axis: level} for level in levels]
        here = tuple(place[name] for name in several)
        found[_told(several, here) or LEARNT] = line(places)
        for name in rivals:
            beside[name][here] = line(places, name)
        if request.statistic == "gain":
            limits = [lives_at(study, each).limit for each in places]
            beside[LIMIT][here] = np.array([[limit, np.nan, np.nan] for limit in limits])
    for name, lines in beside.items():
        found |= _once(name, several, lines)
    return found


def _once(name: str, axes: Sequence[str], lines: Mapping[tuple, Array]) -> dict[str, Array]:
    """Lines by the values of the axes that they vary with; without those that have no number."""

    def varies(place: int) -> bool:
        alike: dict[tuple, np.ndarray] = {}
        for values, line in lines.items():
            first = alike.setdefault((*values[:place], *values[place + 1 :]), line)
            if not np.array_equal(first, line, equal_nan=True):
                return True
        return False

    which = [place for place in range(len(axes)) if varies(place)]
    found = {}
    for values, line in lines.items():
        if np.isfinite(line[:, 0]).any():
            told = _told([axes[place] for place in which], [values[place] for place in which])
            found[f"{name}, {told}" if told else name] = line
    return found


def _told(axes: Iterable[str], values: Iterable[Any]) -> str:
    """Values of axes, by the symbols of the field or without the sections of their keys."""
    words = in_symbols(" ".join(f"{axis}={value}" for axis, value in zip(axes, values, strict=True)))
    return re.sub(r"(?<!\S)(world|learning|evaluation)\.", "", words)


def _label(study: xr.Dataset, axis: str) -> str:
    from swarm.figures import plain

    units = study[axis].attrs.get("units")
    return with_symbols(_told([axis], [""]).rstrip("="), plain) + (f" [{units}]" if units else "")
