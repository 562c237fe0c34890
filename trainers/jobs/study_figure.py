"""Statistics of a study, and the figure of any of them against any axis of its dataset."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm._support.checks import check_name
from swarm._support.tables import with_symbols
from swarm.population.results import RIVAL
from swarm.population.statistics import independent, mean_interval
from trainers.jobs.comparison import in_symbols

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from swarm.figures import Sweep

RESERVED = (
    "seed",
    "test",
    "policy",
    "world",
    "cell",
    "statistic",
)  # axes of a study's dataset beside its own
FORM = "STATISTIC:AXIS[:AXIS=VALUE,...]"
LEARNT, LIMIT = "learnt", "limit"  # what figures call them
Array = Any


class Lives(NamedTuple):
    """What cells of one test gained, under policies of several seeds or under one reference."""

    gain: Array  # (seeds, worlds, cells) [concentration]
    greedy: Array  # (worlds, cells), of the same cells
    times: Array | None  # (seeds, worlds, cells) [time] to the egg, infinite for who never came
    limit: float  # of the mean gain; NaN where none is known
    coupled: bool  # whether what one cell does can matter to another


class Statistic(NamedTuple):
    """A number of every seed."""

    label: str
    units: str
    of: Callable[[Lives], Array]  # of each cell (seeds, worlds, cells), whose mean it is; or (seeds,)
    needs_egg: bool = False


def _of_arrived(number: Callable[[Array], Any]) -> Callable[[Lives], Array]:
    def of(lives: Lives) -> Array:
        assert lives.times is not None
        came = [each[np.isfinite(each)] for each in lives.times]
        return np.array([number(each) if each.size else np.nan for each in came])

    return of


CELLS = (1, 2)
STATISTICS = {
    "gain": Statistic(r"mean gain $\Delta c$", "concentration", lambda lives: lives.gain),
    "over_greedy": Statistic(
        "mean lead over greedy", "concentration", lambda lives: lives.gain - lives.greedy
    ),
    "fraction_of_limit": Statistic(
        "fraction of the limit", "1", lambda lives: lives.gain / (lives.limit if lives.limit > 0 else np.nan)
    ),
    "wins": Statistic("cells that beat greedy", "1", lambda lives: (lives.gain > lives.greedy) * 1.0),
    "std": Statistic(
        "standard deviation of the gain", "concentration", lambda lives: lives.gain.std(axis=CELLS)
    ),
    "lowest": Statistic("lowest gain", "concentration", lambda lives: lives.gain.min(axis=CELLS)),
    "highest": Statistic("highest gain", "concentration", lambda lives: lives.gain.max(axis=CELLS)),
    "arrived": Statistic(
        "cells at the egg", "1", lambda lives: np.isfinite(np.asarray(lives.times)) * 1.0, True
    ),
    "time_to_egg": Statistic("mean time to the egg", "time", _of_arrived(np.mean), True),
    "median_time_to_egg": Statistic("median time to the egg", "time", _of_arrived(np.median), True),
}

SHARES = ("wins", "arrived")


def sample(lives: Lives, statistic: str) -> Array:
    """What a statistic is the mean of: (seeds, independent units); NaN where there is no egg."""
    kind = STATISTICS[statistic]
    if kind.needs_egg and lives.times is None:
        return np.full((len(lives.gain), 1), np.nan)
    values = np.asarray(kind.of(lives), np.float64)
    if values.ndim == 1:
        return values[:, None]
    return np.stack([independent(each, lives.coupled) for each in values])


def estimate(lives: Lives, statistic: str) -> tuple[float, float, float]:
    """A statistic over all seeds, with its 95% interval over seeds and cells; NaN where there is none."""
    values = sample(lives, statistic)
    low, high = (mean_interval(values) if np.isfinite(values).all() else None) or (np.nan, np.nan)
    if statistic in SHARES:
        low, high = np.clip([low, high], 0.0, 1.0).tolist()
    return float(values.mean()), low, high


def lives_at(study: xr.Dataset, place: Mapping[str, Any], policy: str | None = None) -> Lives:
    """The lives at a place of the grid in a test: of all seeds, or the one it names; or of a reference."""
    here = study.sel({axis: value for axis, value in place.items() if axis != "seed"})
    seeds = here.sel(seed=[place["seed"]]) if "seed" in place else here
    references = here.sel(policy=[policy]) if policy else None

    def cells(name: str) -> Array | None:
        if name not in study:
            return None
        found = seeds[name] if references is None else references[f"reference_{name}"]
        values = found.transpose(..., "cell").values
        return values if "world" in study.dims else values[:, None]

    gain = cells("gain")
    assert gain is not None
    there = np.isfinite(gain[0])
    inner = slice(None), slice(there.any(axis=1).sum()), slice(there.any(axis=0).sum())
    times = cells("time_to_egg")
    times = None if times is None or np.isnan(times[inner]).any() else times[inner]
    rival = here["reference_gain"].sel(policy=RIVAL).transpose(..., "cell").values
    greedy = (rival if "world" in study.dims else rival[None])[inner[1:]]
    return Lives(gain[inner], greedy, times, float(here["limit"]), bool(here["coupled"]))


# --- figures ------------------------------------------------------------------------------------------------


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


def check_axis_name(name: Any) -> None:
    """Raises ValueError unless an axis may be called so."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z_][\w.]*", name):
        raise ValueError(f"grid must have axes named by letters, digits, dots and _, got {name!r}")
    if name in RESERVED:
        raise ValueError(f"grid must have axes of other names than {', '.join(RESERVED)}, got {name}")


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


def axes_of(study: xr.Dataset) -> dict[str, list[Any]]:
    """The axes of a study's dataset that figures may have, and their values."""
    own = [name for name in study["gain"].dims if name not in RESERVED]
    return {str(name): study[name].values.tolist() for name in [*own, "seed", "test"]}


def figure(study: xr.Dataset, request: Request) -> Figure:
    """A statistic against an axis: a panel for each test, a line for every combination of the other axes;
    beside them the references and the limit, each once where it is the same for several lines.
    """
    from swarm import figures

    return figures.sweeps(panels(study, request))


def panels(study: xr.Dataset, request: Request) -> list[Sweep]:
    """What the figure shows."""
    from swarm.figures import Sweep, plain

    axes = axes_of(study)
    levels = axes[request.axis]
    others = {name: values for name, values in axes.items() if name not in (request.axis, "seed")}
    others |= {name: [value] for name, value in request.chosen.items() if name != "seed"}
    tests = others.pop("test", [None])
    kind = STATISTICS[request.statistic]
    numeric = not any(isinstance(each, str) for each in levels)
    found = []
    for test in tests:
        fixed = ({} if test is None else {"test": test}) | {
            name: value for name, value in request.chosen.items() if name == "seed"
        }
        lines = _lines(study, request, levels, others, fixed)
        title = f"{kind.label} ({plain(test)})" if len(tests) > 1 else kind.label
        marks: dict[float, str] = (
            {} if numeric else {place: plain(level) for place, level in enumerate(levels)}
        )
        found.append(
            Sweep(
                levels if numeric else range(len(levels)),
                lines,
                _label(study, request.axis),
                title,
                marks,
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
    several = {name: values for name, values in others.items() if len(values) > 1}
    same = {name: values[0] for name, values in others.items() if len(values) == 1} | dict(fixed)
    rivals = study["policy"].values.tolist()[request.statistic in ("over_greedy", "wins") :]
    found: dict[str, Array] = {}
    beside: dict[str, dict[tuple, Array]] = {name: {} for name in (*rivals, LIMIT)}
    for values in itertools.product(*several.values()):
        places = [same | dict(zip(several, values, strict=True)) | {request.axis: level} for level in levels]
        found[_told(several, values) or LEARNT] = _found(study, request.statistic, places)
        for name in rivals:
            beside[name][values] = _found(study, request.statistic, places, name)
        if request.statistic == "gain":
            limits = [lives_at(study, each).limit for each in places]
            beside[LIMIT][values] = np.array([[limit, np.nan, np.nan] for limit in limits])
    for name, lines in beside.items():
        found |= _once(name, list(several), lines)
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


def _found(
    study: xr.Dataset, statistic: str, places: Sequence[Mapping[str, Any]], policy: str | None = None
) -> Array:
    return np.array([estimate(lives_at(study, each, policy), statistic) for each in places])


def _label(study: xr.Dataset, axis: str) -> str:
    from swarm.figures import plain

    units = study[axis].attrs.get("units")
    return with_symbols(_told([axis], [""]).rstrip("="), plain) + (f" [{units}]" if units else "")
