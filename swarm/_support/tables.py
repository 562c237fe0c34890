"""Tables: rows under headings, as CSV, as Markdown or for whoever prints them."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

NOTHING = "–"  # where there is no number
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what spreadsheets take for one

SYMBOLS = {  # of the field, as text: as mathematics
    "N_T": "N_T",
    "t_life": r"t_\mathrm{life}",
    "Δt": r"\Delta t",
    "κ": r"\kappa",
    "γ": r"\gamma",
    "α": r"\alpha",
    "ε": r"\varepsilon",
    "±": r"\pm",
    "∞": r"\infty",
}
_SYMBOL = re.compile(rf"(?<!\w)({'|'.join(SYMBOLS)})(?!\w)")
_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
_SPECIAL |= {each: "\\" + each for each in "&%$#_{}"} | {"…": r"\dots{}", "–": "--"}


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

    def as_markdown(self, texts: int = 1) -> str:
        """The first columns, `texts` of them, to the left as text, the others to the right as numbers."""
        rule = [*[":--"] * texts, *["--:"] * (len(self.headings) - texts)]
        lines = ([each.replace("|", r"\|") for each in line] for line in (self.headings, rule, *self.texts))
        return "".join(f"| {' | '.join(line)} |\n" for line in lines)

    def as_latex(self) -> str:
        """A tabular with the rules of the package booktabs, the first column left, the others right."""
        lines = [
            " & ".join(with_symbols(each, _escaped) for each in line) + r" \\"
            for line in (self.headings, *self.texts)
        ]
        columns = "l" + "r" * (len(self.headings) - 1)
        parts = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", lines[0], r"\midrule", *lines[1:]]
        return "\n".join([*parts, r"\bottomrule", r"\end{tabular}", ""])


def _stored(value: Any, digits: int | None) -> Any:
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, str) and value.startswith(FORMULA) and not _is_number(value):
        return f"'{value}"
    if value is None or value != value:  # not a number
        return ""
    return f"{value:.{digits}g}" if digits and isinstance(value, float) else value


def with_symbols(text: str, plain: Callable[[str], str]) -> str:
    """Text whose symbols are set as mathematics, between dollars; `plain` sets what is between them."""
    parts = _SYMBOL.split(text)
    return "".join(f"${SYMBOLS[part]}$" if i % 2 else plain(part) for i, part in enumerate(parts))


def _escaped(text: str) -> str:
    """Text as LaTeX shows it literally, with minus signs before numbers."""
    shown = "".join(_SPECIAL.get(letter, letter) for letter in text)
    return re.sub(r"(?<!\S)-(?=\d)", "$-$", shown)


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
