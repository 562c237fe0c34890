"""What is seen on a terminal: tables, and how far work is."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Table as Shown

from swarm._support.tables import Table

QUIET = 30.0  # [s] between lines where there is no terminal


class Progress:
    """The progress of one piece of work, on stderr: a bar on a terminal, else a line now and then.

    To be used in a `with` statement.
    """

    def __init__(self, title: str, total: float | None = None, done: float = 0.0) -> None:
        console = Console(stderr=True)
        self.live = console.is_terminal
        columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}")
        self.bar = Bar(
            *columns, TimeRemainingColumn(), console=console, transient=True, disable=not self.live
        )
        self.task = self.bar.add_task(title, total=total, completed=done, text="")  # type: ignore[arg-type]
        self.title, self.said = title, time.monotonic()

    def __enter__(self) -> Self:
        self.bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bar.stop()

    def show(self, done: float, total: float | None = None, text: str = "") -> None:
        """So much of `total`, or of the total it began with, is done."""
        self.bar.update(self.task, completed=done, total=total, text=text)
        if not self.live and time.monotonic() - self.said >= QUIET:
            self.say(f"{self.title} {text or f'{done:g}'}")

    def say(self, line: str) -> None:
        """Print a line that stays."""
        self.said = time.monotonic()
        self.bar.console.print(line, highlight=False, markup=False, soft_wrap=True)


def print_table(table: Table) -> None:
    """Print rows under their headings."""
    shown = Shown(box=None, pad_edge=False)
    for place, heading in enumerate(table.headings):
        shown.add_column(heading, justify="right" if place else "left", no_wrap=True)
    for row in table.texts:
        shown.add_row(*row)
    Console(width=max(Console().width, 100)).print(shown)
