"""What is seen on a terminal: tables, and how far work is."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich import progress
from rich.console import Console
from rich.table import Table

QUIET = 30.0  # [s] between lines where there is no terminal


class Progress(progress.Progress):
    """The progress of one piece of work, on stderr: a bar on a terminal, else a line now and then.

    To be used in a `with` statement.
    """

    def __init__(self, title: str, total: float | None = None, done: float = 0.0) -> None:
        text, bar = progress.TextColumn, progress.BarColumn()
        columns = text("{task.description}"), bar, text("{task.fields[text]}"), progress.TimeRemainingColumn()
        console = Console(stderr=True)
        super().__init__(*columns, console=console, transient=True, disable=not console.is_terminal)
        self.work = self.add_task(title, total=total, completed=done, text="")  # type: ignore[arg-type]
        self.title, self.said = title, time.monotonic()

    def show(self, done: float, total: float | None = None, text: str = "") -> None:
        """So much of `total`, or of the total it began with, is done."""
        self.update(self.work, completed=done, total=total, text=text)
        if self.disable and time.monotonic() - self.said >= QUIET:
            self.say(f"{self.title} {text or f'{done:g}'}")

    def say(self, line: str) -> None:
        """Print a line that stays."""
        self.said = time.monotonic()
        self.console.print(line, highlight=False, markup=False, soft_wrap=True)


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows under their headings."""
    shown = Table(box=None, pad_edge=False)
    for place, heading in enumerate(headings):
        shown.add_column(heading, justify="right" if place else "left", no_wrap=True)
    for row in rows:
        shown.add_row(*row)
    Console(width=max(Console().width, 100)).print(shown)
