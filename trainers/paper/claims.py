"""Claims: how a sentence of the paper is measured, and the verdict that follows from its interval alone.

What is claimed, and by which criterion it is judged, is in `statements.yaml`.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import resources
from typing import Any, NamedTuple, Protocol

import numpy as np
import yaml

from swarm.population.statistics import LEVEL, margin
from trainers.paper.measurements import DEVISED, Lives, TrainingGains

REPRODUCED, NOT_REPRODUCED, REVERSED = "reproduced", "not reproduced", "reversed"
TENTH = 0.1  # part of the epochs at either end of a training that are compared
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
    interval: tuple[float, float] | None  # 95%, over training seeds and test cells; None for a single number
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


# --- what is measured: (seeds, cells) whose mean over the cells is the number of a seed ---------------------


class Measure(NamedTuple):
    """Something that is measured of every cell."""

    values: Callable[[Any], np.ndarray]  # of Lives, a Circle or TrainingGains: (seeds, cells)
    unit: str
    combine: Callable[..., Any] = difference  # of the samples' means
    part: bool | None = None  # whether each is a part of a whole, see `estimate`


def _spread(lives: Lives) -> np.ndarray:
    """Standard deviation of the gain over cells, to first order in each cell's weight."""
    off = lives.gain - lives.gain.mean(axis=1, keepdims=True)
    std = off.std(axis=1, keepdims=True)
    return std + np.divide(off**2 - std**2, 2 * std, out=np.zeros_like(off), where=std > 0)


def _turn(lives: Lives) -> tuple[np.ndarray, np.ndarray]:
    """Angle (seeds, 1) of the mean drift to the left of +y [rad], and what each cell (seeds, cells) adds."""
    drift = lives.drift[..., 1] - 1j * lives.drift[..., 0]
    mean = drift.mean(axis=1, keepdims=True)
    return np.angle(mean), np.imag(drift * mean.conj()) / np.abs(mean) ** 2


def _uphill(lives: Lives) -> np.ndarray:
    angle, turned = _turn(lives)
    return np.cos(angle) - np.sin(angle) * turned


def _rise(training: TrainingGains) -> np.ndarray:
    gain = training.gain
    length = max(1, round(TENTH * gain.shape[1]))
    return (gain[:, -length:].mean(axis=1) - gain[:, :length].mean(axis=1))[:, None]


MEASURES = {
    "gain": Measure(lambda lives: lives.gain, "concentration"),
    "part lost": Measure(lambda lives: lives.gain, "of the gain", loss),
    "spread of the gain": Measure(_spread, "concentration, standard deviation over cells"),
    "angle": Measure(lambda lives: np.degrees(sum(_turn(lives))), "degrees"),
    "part of the way up": Measure(_uphill, "of the way leads up the gradient"),
    "wave": Measure(lambda lives: lives.wave, "length"),
    "part that breaks the pattern": Measure(lambda lives: lives.broken, "of the decisions"),
    "part ahead of greedy": Measure(lambda lives: lives.ahead, "of the cells"),
    "part that arrives": Measure(lambda lives: lives.arrived, "of the cells"),
    "winding": Measure(lambda lives: np.degrees(lives.winding), "degrees"),
    "rise": Measure(_rise, "concentration"),
    "way back": Measure(lambda circle: circle.back, "steps of the centreline"),
    "distance off the circle": Measure(lambda circle: circle.deviation, "of the radius"),
}


# --- verdicts -----------------------------------------------------------------------------------------------


class Criterion(NamedTuple):
    """What a claim says of a number: that it is > or < a bound, farther than it from 0 (±), or 1 (all)."""

    sign: str
    bound: float = 0.0

    def __str__(self) -> str:
        texts = {"±": f"farther than {self.bound:g} from 0", "all": "= 1"}
        return texts.get(self.sign, f"{self.sign} {self.bound:g}")

    def verdict(self, found: Estimate) -> str:
        """`reproduced` where the whole interval satisfies it, `reversed` where the whole interval does not,
        else `not reproduced`. Without an interval the value itself counts.

        What all cells do is reproduced where all that were tested did, and reversed where most do not.
        """
        low, high = found.interval or (found.value, found.value)
        if math.isnan(low) or math.isnan(high):
            return NOT_REPRODUCED
        if self.sign == "<":
            low, high = -high, -low
        bound = {"<": -self.bound, "all": 0.5}.get(self.sign, self.bound)
        right, wrong = low > bound, high < bound
        if self.sign == "±":
            right, wrong = right or high < -bound, -bound < low and wrong
        elif self.sign == "all":
            right = found.value == 1
        return REPRODUCED if right else REVERSED if wrong else NOT_REPRODUCED

    def worst(self, found: Estimate) -> float:
        """The number with the least favourable choice of seeds."""
        low_is_worse = self.sign in (">", "all") or (self.sign == "±" and found.value > 0)
        return found.lowest if low_is_worse else found.highest


class Statement(NamedTuple):
    """A sentence of the paper in our words, and how it is judged."""

    id: str
    text: str
    measure: Measure
    samples: Sequence[str]  # CASE/KIND of each
    criterion: Criterion


def statements(
    room: str = "trainers.paper", measures: Mapping[str, Measure] = MEASURES
) -> Iterator[Statement]:
    """Every statement in the `statements.yaml` of a room, in its order; by default the paper's."""
    source = resources.files(room) / "statements.yaml"
    stored = yaml.safe_load(source.read_text(encoding="utf-8"))
    names = {"": ""} | stored["names"]
    for row in stored["statements"]:
        for kind, case in itertools.product(row.get("kinds", [""]), row.get("cases", [""])):
            words = {"kind": kind, "case": case, "setting": names.get(case, case)}
            words["subject"] = names.get(kind, kind)
            words["Subject"] = words["subject"].capitalize()
            measure, _, samples = row["number"].format(**words).rpartition(" of ")
            sign, _, bound = row["is"].partition(" ")
            yield Statement(
                row["id"].format(**words),
                row["text"].format(**words),
                measures[measure],
                samples.split(),
                Criterion(sign, float(bound or 0)),
            )


class Claim(NamedTuple):
    """A statement, what was measured, and what follows."""

    id: str
    claim: str
    recipe: str | None  # None where nothing is trained
    measurement: float
    unit: str
    interval: tuple[float, float] | None  # 95%, over training seeds and test cells
    criterion: str  # on the whole interval
    seeds: tuple[int, ...]  # of training
    spread_of_seeds: float | None  # standard deviation, where one stack of several seeds is measured
    worst_seed: float | None  # the measurement with the least favourable choice of seeds
    verdict: str
    by_seed: dict[str, list[float]]  # the number of every seed in each sample


class Samples(Protocol):
    """Evidence of any kind."""

    def sample(self, where: str, recipe: str) -> Any:
        """What was measured at CASE/KIND under a recipe, with its `seeds`; None where nothing was."""
        ...


def judged(statement: Statement, evidence: Samples, recipe: str) -> Claim | None:
    """The verdict on a statement under a recipe; None where something was not measured."""
    found = [evidence.sample(where, recipe) for where in statement.samples]
    samples = [statement.measure.values(each) for each in found if each is not None]
    if len(samples) < len(found):
        return None
    seeds = next((each.seeds for each in found if each is not None and each.seeds), ())
    part = statement.measure.part if len(samples) == 1 else None
    number = estimate(*samples, combine=statement.measure.combine, part=part)
    means = [sample.mean(axis=1).tolist() for sample in samples]
    several = len(samples) == 1 < len(seeds)
    return Claim(
        id=statement.id,
        claim=statement.text,
        recipe=recipe if seeds else None,
        measurement=number.value,
        unit=statement.measure.unit,
        interval=number.interval,
        criterion=str(statement.criterion),
        seeds=seeds,
        spread_of_seeds=float(np.std(means[0], ddof=1)) if several else None,
        worst_seed=statement.criterion.worst(number) if seeds else None,
        verdict=statement.criterion.verdict(number),
        by_seed=dict(zip(statement.samples, means, strict=True)),
    )


def all_claims(
    evidence: Samples, recipes: Sequence[str], given: Iterable[Statement] | None = None
) -> list[Claim]:
    """Every statement whose measurements are there: once if nobody trains for it, else under each recipe."""
    found: dict[tuple[str, str | None], Claim] = {}
    for statement in statements() if given is None else given:
        for recipe in recipes or (DEVISED,):
            if (claim := judged(statement, evidence, recipe)) is not None:
                found.setdefault((claim.id, claim.recipe), claim)
    return list(found.values())
