"""The clock: how long decisions and lives last, counted in whole numbers so that no time is lost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, at_least, look_up, namespace
from swarm._support.checks import check_rule

Array = Any

RULES = ("truncated", "exact", "common")
MAX_TICKS = 10_000  # of one decision: there is a row for each of them in the tables


class Ticks(NamedTuple):
    """A clock's whole numbers in an array library."""

    whole: Array  # (actions,) ticks of a whole interval; (1,) where they are all the same
    last: Array  # (1,) one more than the longest


def frozen(part: Any, time: Array) -> Any:
    """A field or flow as it is at `time`, a number or an array that goes with positions (...) [time].

    One without `at(time)` is steady, and the same at all times.
    """
    at = getattr(part, "at", None)
    return part if at is None else at(time)


@dataclass(frozen=True)
class Clock:
    """The intervals between decisions, one for each action, and the life they add up to.

    A *count* is what a cell has lived: ticks (..., cells) int32, or where the intervals have no tick in
    common, decisions by action (..., cells, actions). Raises ValueError where periods, decisions and the life
    cannot be counted.
    """

    periods: tuple[float, ...]  # T with each action [time]
    n_records: int  # N_T, decisions in a period
    life: float  # t_life [time]
    time_step: float  # Δt, the tick that intervals are rounded down to [time]
    # "truncated": ΔT = int(T/(N_T Δt)) Δt; "exact": T/N_T; "common": truncated, of the mean speed's T for all
    rule: str

    def __post_init__(self) -> None:
        steps = max(self.periods) / (self.n_records * self.time_step)
        step, records = f"time_step = {self.time_step:g}", f"n_records = {self.n_records}"
        period = "with period T = {:g} at this speed and curvature, and".format
        rule = f"time_step must leave at most {MAX_TICKS} steps per decision"
        few = self.rule == "exact" or steps <= MAX_TICKS
        check_rule(few, rule, f"{step} {period(max(self.periods))} {records}")
        rule = f"life must be at most 2^30 ticks of {self.tick:g}"
        check_rule(self.life / self.tick <= 2**30, rule, f"{self.life:g}")
        rule = "n_records must leave at least one time_step per decision: T/(N_T Δt) must reach 1"
        whole = min(self.interval_ticks) >= 1
        check_rule(whole, rule, f"{records} {period(min(self.periods))} {step}")

    @cached_property
    def has_common_tick(self) -> bool:
        """Whether all intervals are whole numbers of one tick."""
        return self.rule != "exact" or len(set(self.periods)) == 1

    @cached_property
    def tick(self) -> float:
        """Unit of the count [time]: Δt, or one decision where intervals are exact."""
        return self.periods[0] / self.n_records if self.rule == "exact" else self.time_step

    @cached_property
    def interval_ticks(self) -> tuple[int, ...]:
        """Ticks of a decision with each action. Paper: ΔT is rounded down to whole integration steps."""
        if self.rule == "exact":
            return (1,) * len(self.periods)
        # the small number keeps a quotient that is whole but for rounding
        return tuple(int(period / (self.n_records * self.time_step) + 1e-9) for period in self.periods)

    @cached_property
    def intervals(self) -> tuple[float, ...]:
        """ΔT with each action [time]."""
        if self.rule == "exact":
            return tuple(period / self.n_records for period in self.periods)
        return tuple(ticks * self.time_step for ticks in self.interval_ticks)

    @cached_property
    def life_ticks(self) -> int:
        """Ticks of a life; the last one may be cut short."""
        return max(1, math.ceil(self.life / self.tick - 1e-9))

    @cached_property
    def max_decisions(self) -> int:
        """The most decisions a life can take."""
        return max(1, math.ceil(self.life / min(self.intervals) - 1e-9))

    # --- counting -------------------------------------------------------------------------------------------

    def start(self, like: Array) -> Array:
        """The count at t = 0 of cells like those of `like` (..., cells)."""
        shape = like.shape if self.has_common_tick else (*like.shape, len(self.periods))
        return as_array(np.zeros(tuple(shape)), like, dtype=namespace(like).int32)

    def ticks(self, like: Array) -> Ticks:
        """What `next_column` needs, in the array library of `like`."""
        whole = self.interval_ticks if len(set(self.interval_ticks)) > 1 else self.interval_ticks[:1]
        numbers = (np.asarray(each) for each in (whole, [max(whole) + 1]))
        return Ticks(*(as_array(each, like, dtype=namespace(like).int32) for each in numbers))

    @cached_property
    def width(self) -> int:
        """Columns of an action, see `columns`."""
        return max(self.interval_ticks) + 2

    def columns(self) -> tuple[np.ndarray, np.ndarray]:
        """Action and length [time] of every interval that can occur, both (columns,).

        Column `action · width + min(ticks left, width − 1)`: the last of an action is a whole interval, the
        others are clipped by the end of life.
        """
        left = np.tile(np.arange(self.width), len(self.periods))
        action = np.repeat(np.arange(len(self.periods)), self.width)
        slack = self.life_ticks * self.tick - self.life  # what is missing of the last tick
        clipped = np.maximum(left * self.tick - slack, 0.0)
        whole = left > np.asarray(self.interval_ticks)[action]
        return action, np.where(whole, np.asarray(self.intervals)[action], clipped)

    def next_column(
        self, count: Array, action: Array, ticks: Ticks, over: Array | None
    ) -> tuple[Array, Array]:
        """The count after the next interval of each cell, and the interval's column.

        Needs a common tick. Cells whose life is `over` (None: none but those out of time) stay as they are.
        """
        xp = namespace(count)
        action = xp.astype(action, xp.int32, copy=False)
        left = self.life_ticks - count
        if over is not None:
            left = xp.where(over, xp.zeros_like(left), left)
        whole = ticks.whole if ticks.whole.shape[0] == 1 else look_up(ticks.whole, action)
        return count + xp.minimum(left, whole), action * self.width + xp.minimum(left, ticks.last)

    def next_length(self, count: Array, action: Array, over: Array, like: Array) -> tuple[Array, Array]:
        """The count after the next interval of each cell, and the interval's length [time] with the dtype of
        `like`, where no common tick exists: decisions are counted by action, so rounding never piles up."""
        xp = namespace(count)
        left = self.life - self.time(count, like)
        length = xp.minimum(look_up(as_array(np.asarray(self.intervals), like), action), left)
        length = xp.where(over | self.is_up(count), xp.zeros_like(left), length)
        actions = as_array(np.arange(len(self.periods)), action)
        taken = xp.astype(action[..., None] == actions, xp.int32)
        return count + xp.where((length > 0)[..., None], taken, xp.zeros_like(taken)), length

    def is_up(self, count: Array, *, alone: bool = False) -> Array:
        """Whether lives (..., cells) have lasted as long as they can.

        `alone` is for whoever does nothing further with the flags: quicker where torch compiles.
        """
        if self.has_common_tick:
            return at_least(count, self.life_ticks) if alone else count >= self.life_ticks
        return self._elapsed(count, namespace(count).float32) >= self.life * (1 - 1e-6)

    def time(self, count: Array, like: Array) -> Array:
        """Time lived (..., cells) with the dtype of `like`, `life` exactly when it is up [time]."""
        xp = namespace(count)
        elapsed = self._elapsed(count, like.dtype)
        life = xp.full_like(elapsed, self.life)
        return xp.where(self.is_up(count), life, xp.minimum(elapsed, life))

    def _elapsed(self, count: Array, dtype: Any) -> Array:
        xp = namespace(count)
        if self.has_common_tick:
            return xp.astype(count, dtype) * self.tick
        durations = as_array(np.asarray(self.intervals), count, dtype=dtype)
        return xp.sum(xp.astype(count, dtype) * durations, axis=-1)
