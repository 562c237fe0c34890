"""Numbers and how sure they are: intervals over training seeds and test cells, and how they are written."""

import functools
import itertools
import re
from collections.abc import Callable
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

from swarm._support import provenance
from swarm._support.tables import NOTHING, percent
from swarm.population.statistics import LEVEL, margin
from trainers.studies.plan import TrainingPlan

Row = dict[str, Any]
Interval = tuple[float, float]
SIGNS = (1, -1, -1, 1)  # of the samples that a claim compares


def difference(*numbers: Any) -> Any:
    """The first number; less the second; less by how much the third exceeds the fourth."""
    return sum(sign * number for sign, number in zip(SIGNS, numbers, strict=False))


def loss(before: Any, after: Any) -> Any:
    """The part of a number that is lost."""
    return 1 - after / before


class Estimate(NamedTuple):
    """A number and how sure it is."""

    value: float
    interval: Interval | None  # 95%, over training seeds and test cells; None for a single number
    lowest: float  # over every choice of one seed from each sample
    highest: float


def estimate(
    *samples: np.ndarray, combine: Callable[..., Any] = difference, part: bool | None = None
) -> Estimate:
    """`combine` of the samples' means; samples are (seeds, cells), all of the same cells.

    The interval of what is not linear follows from its slopes. That of a `part` of the cells, by default
    where samples are bool, keeps within 0 and 1, and is Clopper's and Pearson's for cells that all agree.
    """
    means = [float(sample.mean()) for sample in samples]
    step = 1e-20j  # in the imaginary direction, which is exact
    slopes = [
        float(np.imag(combine(*means[:place], mean + step, *means[place + 1 :])) / step.imag)
        for place, mean in enumerate(means)
    ]
    value = float(combine(*means))
    half = margin(*samples, weights=slopes)
    interval = None if half is None else (value - float(half), value + float(half))
    if interval and (samples[0].dtype == bool if part is None else part):
        all_agree = ((1 - LEVEL) / 2) ** (1 / samples[0].shape[1])
        low, high = {1.0: (all_agree, 1.0), 0.0: (0.0, 1 - all_agree)}.get(value, interval)
        interval = max(low, 0.0), min(high, 1.0)
    by_seed = [sample.mean(axis=1) for sample in samples]
    choices = [float(combine(*choice)) for choice in itertools.product(*by_seed)]
    return Estimate(value, interval, min(choices), max(choices))


# --- how they are written -----------------------------------------------------------------------------------


def columns(name: str, found: Estimate | None, between: str = ", ") -> Row:
    """A number and the ends of its interval, as columns of a table of results."""
    low, high = (found and found.interval) or (None, None)
    return {name: found and found.value, f"{name}{between}low": low, f"{name}{between}high": high}


def number(value: float | None, sign: str = "") -> str:
    if value is None:
        return NOTHING
    if 0 < abs(value) < 5e-4:
        return f"{value:.1g}"
    return f"{value:{sign}.{2 if abs(value) >= 1 else 3}f}"


def spread_of(value: float | None, spread: float | None) -> str:
    return number(value) if spread is None else f"{number(value)} ± {number(spread)}"


def interval_of(interval: tuple[float | None, float | None] | None) -> str:
    return NOTHING if interval in (None, (None, None)) else " … ".join(map(number, interval))


def with_interval(found: Estimate, sign: str = "") -> str:
    """A number, and its interval in brackets."""
    return f"{number(found.value, sign)} ({interval_of(found.interval)})"


def half(found: Estimate, digits: int, scale: float = 1.0) -> str:
    """Half of an interval, upwards."""
    return NOTHING if found.interval is None else f"{scale * (found.interval[1] - found.value):.{digits}f}"


def percent_of(found: Estimate | None) -> str | None:
    """A fraction and half of its interval."""
    return None if found is None else f"{percent(found.value)} ± {half(found, 1, 100)}"


# --- reports ------------------------------------------------------------------------------------------------


@functools.cache
def _parts(room: str) -> dict[str, str]:
    text = (resources.files(room) / "report.md").read_text(encoding="utf-8")
    _, *parts = re.split(r"<!-- (\w+) -->\n", text)
    return dict(zip(parts[::2], parts[1::2], strict=True))


def filled(room: str, part: str, **values: Any) -> str:
    """A part of the `report.md` of a room, which begins with a line <!-- PART -->, with its gaps filled."""
    text = _parts(room)[part].rstrip("\n").format(**values)
    return text if text.endswith("\n") else text + "\n"


def printed_by(plan: TrainingPlan, *command: str) -> dict[str, str]:
    """What prints a report, and where it comes from, to fill the gaps `command` and `origin`."""
    words = ["swarm", *command, *(["--quick"] if plan.quick else [])]
    if not plan.quick and plan.n_seeds != type(plan).n_seeds:
        words.append(f"--seeds {plan.n_seeds}")
    return {"command": " ".join(words), "origin": provenance.line()}
