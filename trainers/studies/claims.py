"""Claims: how a sentence is measured, and the verdict that follows from its interval alone.

What is claimed, and by which criterion it is judged, is in the `statements.yaml` of a study's room.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
import yaml

from trainers.studies.estimates import Estimate, Interval, difference, estimate

DEVISED = ""  # the recipe of strategies that nobody trained
REPRODUCED, NOT_REPRODUCED, REVERSED = "reproduced", "not reproduced", "reversed"


class Measure(NamedTuple):
    """Something that is measured of every cell."""

    values: Callable[[Any], np.ndarray]  # of a sample: (seeds, cells), whose mean is the number of a seed
    unit: str
    combine: Callable[..., Any] = difference  # of the samples' means
    part: bool | None = None  # whether each is a part of a whole, see `estimate`


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


def statements(room: str, measures: Mapping[str, Measure]) -> Iterator[Statement]:
    """Every statement in the `statements.yaml` of a room, in its order."""
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
    interval: Interval | None  # 95%, over training seeds and test cells
    criterion: str  # on the whole interval
    seeds: tuple[int, ...]  # of training
    spread_of_seeds: float | None  # standard deviation, where one stack of several seeds is measured
    worst_seed: float | None  # the measurement with the least favourable choice of seeds
    verdict: str
    by_seed: dict[str, list[float]]  # the number of every seed in each sample


Sample = Callable[[str, str], Any]  # what was measured at CASE/KIND under a recipe; None where nothing was


def judged(statement: Statement, sample: Sample, recipe: str) -> Claim | None:
    """The verdict on a statement under a recipe; None where something was not measured."""
    found = [sample(where, recipe) for where in statement.samples]
    if any(each is None for each in found):
        return None
    samples = [statement.measure.values(each) for each in found]
    seeds = next((each.seeds for each in found if each.seeds), ())
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


def all_claims(asked: Iterable[Statement], sample: Sample, recipes: Sequence[str]) -> list[Claim]:
    """Every statement whose measurements are there: once if nobody trains for it, else under each recipe."""
    found: dict[tuple[str, str | None], Claim] = {}
    for statement, recipe in itertools.product(asked, recipes or (DEVISED,)):
        if (claim := judged(statement, sample, recipe)) is not None:
            found.setdefault((claim.id, claim.recipe), claim)
    return list(found.values())
