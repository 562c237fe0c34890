"""What is seen on a terminal: tables, and how far work is."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from rich import progress
from rich.console import Console
from rich.table import Table
from rich.text import Text

QUIET = 30.0  # [s] between lines where there is no terminal


class Told:
    """A stream for what is only told on the way: where it is closed, full or read by nobody any more, the
    work goes on in silence.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """As a stream does."""
        self._try("write", text)
        return len(text)

    def flush(self) -> None:
        """As a stream does."""
        self._try("flush")

    def isatty(self) -> bool:
        """As a stream does."""
        return self._stream is not None and self._stream.isatty()

    def _try(self, do: str, *arguments: Any) -> None:
        stream = self._stream
        if stream is None:
            return
        try:
            getattr(stream, do)(*arguments)
        except (OSError, ValueError):  # a closed stream is a ValueError
            self._stream = None
            with suppress(OSError, ValueError), open(os.devnull, "w") as nowhere:  # for what it still holds
                os.dup2(nowhere.fileno(), stream.fileno())


def tell(line: str) -> None:
    """Print a line on stderr, where somebody reads it."""
    print(line, file=Told(sys.stderr))


@contextmanager
def dispensable(figure: str | os.PathLike) -> Iterator[None]:
    """Within, a figure of stored numbers is drawn: what goes wrong costs a line and nothing else."""
    try:
        yield
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        tell(f"{os.fspath(figure)} could not be drawn: {reason}")


class Progress(progress.Progress):
    """The progress of one piece of work, on stderr: a bar on a terminal, else a line now and then.

    To be used in a `with` statement. Work does not end because nobody can read how far it is.
    """

    def __init__(self, title: str, total: float | None = None, done: float = 0.0) -> None:
        named, text = (
            progress.TextColumn(f"{{task.{each}}}", markup=False) for each in ("description", "fields[text]")
        )
        columns = named, progress.BarColumn(), text, progress.TimeRemainingColumn()
        console = Console(file=Told(sys.stderr))  # type: ignore[arg-type]
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
        self.console.print(Text(line), soft_wrap=True)


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows under their headings."""
    shown = Table(box=None, pad_edge=False)
    for place, heading in enumerate(headings):
        shown.add_column(Text(heading), justify="right" if place else "left", no_wrap=True)
    for row in rows:
        shown.add_row(*map(Text, row))
    Console(width=max(Console().width, 100)).print(shown)
