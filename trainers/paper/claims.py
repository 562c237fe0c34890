"""The paper's claims, each with our measurement and a verdict that follows from its interval alone."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from trainers.paper.intervals import Estimate, Summary, estimate, mean, off_gradient, spread
from trainers.paper.measurements import DEVISED, Circle, Lives

REPRODUCED, NOT_REPRODUCED, REVERSED = "reproduced", "not reproduced", "reversed"
ROUND = 0.01  # a centreline is the predicted circle if it keeps to it within this part of the radius
STRAIGHT = 1.0  # [degrees] up to which a migration follows the gradient
TENTH = 0.1  # part of the epochs at either end of a training that are compared


class Claim(NamedTuple):
    """A sentence of the paper in our words, what was measured, and what follows."""

    id: str
    claim: str
    recipe: str | None  # None where nothing is trained
    measurement: float
    unit: str
    interval: tuple[float, float] | None  # 95%, over training seeds and test cells
    criterion: str  # on the whole interval
    seeds: tuple[int, ...]  # of training
    worst_seed: float | None  # the measurement with the least favourable choice of seeds
    verdict: str
    details: dict[str, Any]

    def as_json(self) -> dict[str, Any]:
        """Plain values for claims.json."""
        interval = None if self.interval is None else list(self.interval)
        return self._asdict() | {"interval": interval, "seeds": list(self.seeds)}


def judged(found: Estimate, *, above: float | None = None, below: float | None = None) -> str:
    """`reproduced` where the interval lies wholly on the claimed side of the bound, `reversed` where it lies
    wholly on the other, else `not reproduced`. Without an interval the value itself counts.
    """
    low, high = found.interval or (found.value, found.value)
    if math.isnan(low) or math.isnan(high):
        return NOT_REPRODUCED
    if below is not None:
        low, high, above = -high, -low, -below
    assert above is not None
    if low > above:
        return REPRODUCED
    return REVERSED if high < above else NOT_REPRODUCED


def claim(
    identity: str,
    text: str,
    recipe: str,
    combine: Any,
    *samples: np.ndarray,
    seeds: tuple[int, ...] = (),
    summary: Summary = mean,
    unit: str = "concentration",
    above: float | None = None,
    below: float | None = None,
    seed: int = 0,
    **details: Any,
) -> Claim:
    """The claim that `combine` of the samples' summaries is `above` (default: 0) or `below` a bound."""
    if above is None and below is None:
        above = 0.0
    found = estimate(combine, *samples, summary=summary, seed=seed)
    sign, bound = (">", above) if below is None else ("<", below)
    return Claim(
        id=identity,
        claim=text,
        recipe=recipe or None,
        measurement=found.value,
        unit=unit,
        interval=found.interval,
        criterion=f"{sign} {bound:g}",
        seeds=seeds,
        worst_seed=(found.lowest if below is None else found.highest) if seeds else None,
        verdict=judged(found, above=above, below=below),
        details=details,
    )


# --- swinging and greedy, which nobody trains ---------------------------------------------------------------


def swinging_returns(name: str, setting: str, circle: Circle) -> Claim:
    """Swinging leads back to the start."""
    return claim(
        f"swinging_returns_{name}",
        f"With {setting} a cell that swings comes back to where it began: after a revolution a centre of "
        "curvature lies less than one step of the centreline from the first.",
        DEVISED,
        lambda back: back,
        circle.back,
        unit="steps of the centreline",
        below=1.0,
        revolution=circle.revolution,
    )


def swinging_circle(name: str, setting: str, circle: Circle) -> Claim:
    """Its centreline is a circle of the predicted radius."""
    return claim(
        f"swinging_circle_{name}",
        f"With {setting} the centreline of swinging is an arc, in time a whole circle: every centre of "
        f"curvature keeps to the predicted circle within {100 * ROUND:g}% of its radius.",
        DEVISED,
        lambda deviation: deviation,
        circle.deviation,
        unit="part of the radius",
        below=ROUND,
        fitted_radius=float(circle.fitted.mean()),
        predicted_radius=circle.predicted,
    )


# --- one stack of seeds against another ---------------------------------------------------------------------


def higher(identity: str, text: str, recipe: str, better: Lives, worse: Lives, **options: Any) -> Claim:
    """The first gains more than the second, on the same cells."""
    return claim(
        identity,
        text,
        recipe,
        np.subtract,
        better.gain,
        worse.gain,
        seeds=better.seeds or worse.seeds,
        **options,
    )


def narrower(identity: str, text: str, recipe: str, narrow: Lives, wide: Lives, **options: Any) -> Claim:
    """Gains of the first vary less from cell to cell than those of the second."""
    return claim(
        identity,
        text,
        recipe,
        lambda less, more: more - less,
        narrow.gain,
        wide.gain,
        seeds=narrow.seeds,
        summary=spread,
        unit="concentration, standard deviation over cells",
        spreads=[float(lives.gain.std(axis=1).mean()) for lives in (narrow, wide)],
        **options,
    )


def lead_grows(
    identity: str,
    text: str,
    recipe: str,
    before: tuple[Lives, Lives],
    after: tuple[Lives, Lives],
    **options: Any,
) -> Claim:
    """The lead of the first of each pair over the second is larger after than before."""
    return claim(
        identity,
        text,
        recipe,
        lambda a, b, c, d: (a - b) - (c - d),
        after[0].gain,
        after[1].gain,
        before[0].gain,
        before[1].gain,
        seeds=after[0].seeds,
        **options,
    )


def off_the_gradient(identity: str, text: str, recipe: str, lives: Lives, **options: Any) -> Claim:
    """Migration makes an angle with the gradient; its sign is positive to the left of it."""
    signed = np.degrees(np.angle(lives.off_gradient.mean(axis=1)))
    return claim(
        identity,
        text,
        recipe,
        lambda angle: angle,
        lives.off_gradient,
        seeds=lives.seeds,
        summary=off_gradient,
        unit="degrees",
        above=STRAIGHT,
        signed_by_seed=signed.tolist(),
        **options,
    )


def straighter(
    identity: str, text: str, recipe: str, straight: Lives, oblique: Lives, **options: Any
) -> Claim:
    """Migration of the first is nearer to the gradient than that of the second."""
    return claim(
        identity,
        text,
        recipe,
        lambda less, more: more - less,
        straight.off_gradient,
        oblique.off_gradient,
        seeds=straight.seeds or oblique.seeds,
        summary=off_gradient,
        unit="degrees",
        **options,
    )


# --- training and the egg -----------------------------------------------------------------------------------


def gain_rises(
    identity: str, text: str, recipe: str, gain: np.ndarray, seeds: tuple[int, ...], **options: Any
) -> Claim:
    """Gains (seeds, epochs) of the training cells: the last tenth of the epochs less the first."""
    length = max(1, round(TENTH * gain.shape[1]))
    first, last = (part.mean(axis=1, keepdims=True) for part in (gain[:, :length], gain[:, -length:]))
    return claim(
        identity,
        text,
        recipe,
        lambda rise: rise,
        last - first,
        seeds=seeds,
        first_tenth=float(first.mean()),
        last_tenth=float(last.mean()),
        **options,
    )


def everyone_arrives(identity: str, text: str, recipe: str, lives: Lives, *, seed: int = 0) -> Claim:
    """All cells of all seeds reach the egg; reversed where most do not."""
    found = estimate(lambda part: part, lives.arrived.astype(float), seed=seed)
    reversed_ = judged(found, above=0.5) == REVERSED
    everyone = bool(lives.arrived.all())
    return Claim(
        id=identity,
        claim=text,
        recipe=recipe or None,
        measurement=float(lives.arrived.mean()),
        unit="part of the cells",
        interval=found.interval,
        criterion="= 1",
        seeds=lives.seeds,
        worst_seed=float(lives.arrived.mean(axis=1).min()) if lives.seeds else None,
        verdict=REPRODUCED if everyone else REVERSED if reversed_ else NOT_REPRODUCED,
        details={"slowest": float(lives.lifetime.max()), "mean_time": float(lives.lifetime.mean())},
    )


def centrelines_spiral(identity: str, text: str, recipe: str, lives: Lives, **options: Any) -> Claim:
    """Centrelines keep an angle to the way to the egg."""
    return claim(
        identity,
        text,
        recipe,
        lambda angle: angle,
        np.exp(1j * lives.spiral),
        seeds=lives.seeds,
        summary=off_gradient,
        unit="degrees",
        above=STRAIGHT,
        signed_by_seed=np.degrees(lives.spiral.mean(axis=1)).tolist(),
        **options,
    )
