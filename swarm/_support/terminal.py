"""What is seen on a terminal: tables, and how far work is."""

from __future__ import annotations

import math
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, ClassVar, Self, TextIO

from rich import progress
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

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
        self._try("write", text)
        return len(text)

    def flush(self) -> None:
        self._try("flush")

    def isatty(self) -> bool:
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
        named, text = (
            progress.TextColumn(f"{{task.{each}}}", markup=False) for each in ("description", "fields[text]")
        )
        console = Console(file=Told(sys.stderr))  # type: ignore[arg-type]
        columns = named, progress.BarColumn(), text, TimeLeft()
        options: dict[str, Any] = {"transient": True, "speed_estimate_period": math.inf}
        super().__init__(*columns, console=console, disable=not console.is_terminal, **options)
        self.add_task(title, total=total, completed=done, text="")  # type: ignore[arg-type]
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
        self.update(self.task_ids[0], completed=done, total=total, text=text)

    def say(self, line: str) -> None:
        """Print a line that stays."""
        self.console.print(Text(line), soft_wrap=True)

    def _tell(self) -> None:
        """A line now and then, but for what another shows meanwhile."""
        pause = FIRST
        while not self._over.wait(pause):
            pause = QUIET
            if self._shown[-1] is self:
                (task,) = self.tasks
                part = f"{task.percentage:.0f}%" if task.total else ""
                far = " ".join(filter(None, (task.description, task.fields["text"], part)))
                told = far, duration(task.elapsed or 0.0), TimeLeft().render(task).plain
                self.say(", ".join(filter(None, told)))


class TimeLeft(progress.ProgressColumn):
    """The time that is left if the work goes on as until now; nothing where nothing can be told yet."""

    def render(self, task: progress.Task) -> Text:
        left = None if task.finished else task.time_remaining
        return Text("" if left is None else f"about {duration(left)} left")


def duration(seconds: float) -> str:
    """A time in words: 8 s, 3 min, 2 h 5 min."""
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows under their headings, as wide as the terminal, or 80 columns where there is none.

    Nothing is cut: headings and words in the cells go on in the next line, numbers stay whole, and columns
    for which there is no room follow in tables of their own, each of which begins with the first column.
    """
    console = Console()
    columns = [[heading, *(row[place] for row in rows)] for place, heading in enumerate(headings)]
    least = [_narrowest(column) for column in columns]
    least = [min(each, (console.width - 1) // 2) for each in least]
    for number, places in enumerate(_parts(least, console.width)):
        gap = 2 if sum(least[each] + 2 for each in places) - 2 <= console.width else 1
        shown = Table(box=None, padding=(0, gap, 0, 0), pad_edge=False)
        room = console.width - gap * (len(places) - 1)
        widths = _widths([columns[each] for each in places], [least[each] for each in places], room)
        for place, width in zip(places, widths, strict=True):
            side: Any = "left" if not place or _is_text(columns[place][1:]) else "right"
            shown.add_column(Text(headings[place]), justify=side, width=width, overflow="fold")
        for row in rows:
            shown.add_row(*(Text(row[place]) for place in places))
        if number:
            console.print()
        console.print(shown)


def _is_text(cells: Sequence[str]) -> bool:
    """Whether lines may break within the cells: there are words in them."""
    return any(" " in cell and any(map(str.isalpha, cell)) for cell in cells)


def _narrowest(column: Sequence[str]) -> int:
    """The width of a column whose heading, and whose cells where they are text, break at every space."""
    heading, *cells = column
    pieces = [word for cell in cells for word in cell.split()] if _is_text(cells) else cells
    return max(map(cell_len, [*heading.split(), *pieces]), default=1)


def _parts(least: Sequence[int], room: int) -> Iterator[list[int]]:
    """Which columns stand side by side: the first, and as many of the others as there is room for."""
    part, used = [0], least[0]
    for place, width in enumerate(least[1:], start=1):
        if used + 1 + width > room and len(part) > 1:
            yield part
            part, used = [0], least[0]
        part.append(place)
        used += 1 + width
    yield part


def _widths(columns: Sequence[Sequence[str]], least: Sequence[int], room: int) -> list[int]:
    """The columns' widths: what there is room for beyond the least goes to those that lack most."""
    widths, wanted = list(least), [max(map(cell_len, column)) for column in columns]
    for _ in range(room - sum(least)):
        lacking = [want - width for want, width in zip(wanted, widths, strict=True)]
        if max(lacking) > 0:
            widths[lacking.index(max(lacking))] += 1
    return widths
