"""What is seen on a terminal: tables, and how far work is."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, ClassVar, Self, TextIO

from rich import progress
from rich.console import Console
from rich.table import Table
from rich.text import Text

SOON = 0.02  # of the work, before which nothing is said of the time left
FIRST, QUIET = 5.0, 10.0  # [s] until the first line, and between lines, where there is no terminal


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
    """The progress of one piece of work, with the time left, on stderr: a bar on a terminal, else a line at
    `FIRST` and every `QUIET` seconds, however rarely the work says how far it is.

    To be used in a `with` statement; one within another shows in its place meanwhile. Work does not end
    because nobody can read how far it is.
    """

    _shown: ClassVar[list[Progress]] = []

    def __init__(self, title: str, total: float | None = None, done: float = 0.0) -> None:
        named, text, left = (
            progress.TextColumn(f"{{task.{each}}}", markup=False)
            for each in ("description", "fields[text]", "fields[clock].left")
        )
        console = Console(file=Told(sys.stderr))  # type: ignore[arg-type]
        columns = named, progress.BarColumn(), text, left
        super().__init__(*columns, console=console, transient=True, disable=not console.is_terminal)
        self.title, self.text, self.clock = title, "", Clock(total, done)
        self.work = self.add_task(title, total=total, completed=done, text="", clock=self.clock)  # type: ignore[arg-type]
        self._over = threading.Event()

    def __enter__(self) -> Self:
        if self._shown and not self.disable:
            self._shown[-1].stop()
        self._shown.append(self)
        if self.disable:
            threading.Thread(target=self._tell, daemon=True).start()
        return super().__enter__()

    def __exit__(self, *error: Any) -> None:
        self._over.set()
        super().__exit__(*error)
        self._shown.remove(self)
        if self._shown:
            self._shown[-1].start()

    def show(self, done: float, total: float | None = None, text: str = "") -> None:
        """So much of `total`, or of the total it began with, is done."""
        self.clock.set(done, total)
        self.text = text
        self.update(self.work, completed=done, total=total, text=text)

    def say(self, line: str) -> None:
        """Print a line that stays."""
        self.console.print(Text(line), soft_wrap=True)

    def _tell(self) -> None:
        """A line now and then, but for what another shows meanwhile."""
        pause = FIRST
        while not self._over.wait(pause):
            pause = QUIET
            if self._shown[-1] is self:
                part = "" if self.clock.part is None else f"{self.clock.part:.0%}"
                far = " ".join(filter(None, (self.title, self.text, part)))
                self.say(", ".join(filter(None, (far, self.clock.spent, self.clock.left))))


class Clock:
    """How long work has taken, and how long it will if it goes on as until now."""

    def __init__(self, total: float | None, done: float) -> None:
        self.total, self.done, self.first = total, done, done
        self.began = self.changed = time.monotonic()

    def set(self, done: float, total: float | None) -> None:
        """So much is done now."""
        self.total = self.total if total is None else total
        self.done, self.changed = done, time.monotonic()

    @property
    def part(self) -> float | None:
        """The part of it that is done, where it is known."""
        return self.done / self.total if self.total else None

    @property
    def spent(self) -> str:
        """The time it has taken."""
        return duration(time.monotonic() - self.began)

    @property
    def left(self) -> str:
        """The time that is left; nothing is said where nothing can be told yet."""
        new = self.done - self.first
        if self.total is None or new <= 0 or new < SOON * (self.total - self.first):
            return ""
        each = (self.changed - self.began) / new
        return f"about {duration(each * max(self.total - self.done, 0.0))} left"


def duration(seconds: float) -> str:
    """A time in words: 8 s, 3 min, 2 h 5 min."""
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows under their headings."""
    shown = Table(box=None, pad_edge=False)
    for place, heading in enumerate(headings):
        shown.add_column(Text(heading), justify="right" if place else "left", no_wrap=True)
    for row in rows:
        shown.add_row(*map(Text, row))
    Console(width=max(Console().width, 100)).print(shown)
