"""Tables: rows under headings, as CSV, as Markdown or for whoever prints them."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

NOTHING = "–"  # where there is no number
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what spreadsheets take for one


@dataclass(frozen=True)
class Table:
    """Rows of text, numbers and None, as many in each as there are headings."""

    headings: Sequence[str]
    rows: Sequence[Sequence[Any]]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.headings):
                raise ValueError(f"a row must have {len(self.headings)} values, got {row!r}")

    @classmethod
    def of(cls, records: Iterable[Mapping[str, Any]], headings: Sequence[str] = ()) -> Self:
        """A table of records, by default with the first one's names as headings."""
        records = list(records)
        headings = headings or (list(records[0]) if records else [])
        return cls(headings, [[record[name] for name in headings] for record in records])

    @property
    def texts(self) -> list[list[str]]:
        """The rows as they are read; a dash where there is nothing."""
        return [[NOTHING if value is None else str(value) for value in row] for row in self.rows]

    def as_csv(self, digits: int | None = None) -> str:
        """Comma-separated, all digits of a number or so many; nothing where there is none, flags as 0 and 1.

        Text that a spreadsheet would compute gets a ' in front. Empty where there are no headings.
        """
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        if self.headings:
            writer.writerow(self.headings)
            writer.writerows([_stored(value, digits) for value in row] for row in self.rows)
        return buffer.getvalue()

    def as_markdown(self) -> str:
        """The first column to the left as text, the others to the right as numbers."""
        rule = [":--", *["--:"] * (len(self.headings) - 1)]
        return "".join(f"| {' | '.join(line)} |\n" for line in (self.headings, rule, *self.texts))


def _stored(value: Any, digits: int | None) -> Any:
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, str) and value.startswith(FORMULA) and not _is_number(value):
        return f"'{value}"
    if value is None or value != value:  # not a number
        return ""
    return f"{value:.{digits}g}" if digits and isinstance(value, float) else value


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def span(interval: Sequence[float] | None, form: str = ".2f") -> str | None:
    """An interval (low, high) as it is read; None where there is none."""
    if interval is None or np.isnan(interval[0]):
        return None
    return f"{interval[0]:{form}} … {interval[1]:{form}}"


def percent(fraction: float | None) -> str | None:
    """A fraction as it is read; None where there is none."""
    return None if fraction is None else f"{100 * fraction:.1f}%"
