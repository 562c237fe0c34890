"""Work done several pieces at a time, in processes of their own, with progress and time left."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
QUIET = 30.0  # [s] between lines where there is no terminal
GRACE = 60.0  # [s] a process whose parent is gone has to save what it was doing


class Task(NamedTuple):
    """A piece of work: `do(*arguments)`, both of which go to another process."""

    label: str
    do: Callable[..., Any]
    arguments: tuple[Any, ...]
    seconds: float  # expected; only their ratios matter
    part_done: Callable[[], float] = float  # in [0, 1], while it is worked on


class Stopped(RuntimeError):
    """Work was interrupted; whoever does it has saved what they can."""


def work_off(tasks: Sequence[Task], workers: int, *, title: str) -> list[Any]:
    """Results of all tasks, or the exceptions they ended with; with 0 workers they are done here.

    The longest are begun first. Raises Stopped after Ctrl-C or SIGTERM, once every process has ended.
    """
    progress = Progress(tasks, max(1, workers), title)
    results: list[Any] = [None] * len(tasks)
    if not workers:
        for place, task in enumerate(tasks):
            results[place] = _attempt(task.do, task.arguments)
            progress.finished(place, results[place])
        return results
    waiting = sorted(range(len(tasks)), key=lambda place: tasks[place].seconds)
    active: dict[Connection, tuple[int, Any]] = {}
    with _termination_interrupts(), _environment(ONE_THREAD):
        try:
            while waiting or active:
                while waiting and len(active) < workers:
                    place = waiting.pop()
                    receiver, process = _begin(tasks[place])
                    active[receiver] = (place, process)
                ready = wait(list(active), timeout=1.0)
                for receiver in [each for each in active if each in ready]:
                    place, process = active.pop(receiver)
                    results[place] = _received(receiver, process)
                    progress.finished(place, results[place])
                progress.show()
        except KeyboardInterrupt:
            raise Stopped("stopped; what was done is kept, and the same command goes on from there") from None
        finally:
            _end([process for _, process in active.values()])
    return results


def _attempt(do: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    try:
        return do(*arguments)
    except Exception as error:
        return error


def _begin(task: Task) -> tuple[Connection, Any]:
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(sender, task.do, task.arguments), name=task.label)
    process.start()
    sender.close()  # so that the end of the process is the end of the pipe
    return receiver, process


def _received(receiver: Connection, process: Any) -> Any:
    try:
        result = receiver.recv()
    except EOFError:
        result = None
    process.join()
    if process.exitcode:
        return RuntimeError(f"its process ended with {process.exitcode}, perhaps because memory ran out")
    return result


def _work(sender: Connection, do: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """In a process of its own: Ctrl-C goes to the parent alone, which passes it on."""
    os.setpgid(0, 0)
    threading.Thread(target=_follow_parent, daemon=True).start()
    result = _attempt(do, arguments)
    if isinstance(result, Exception):
        result = RuntimeError(f"{type(result).__name__}: {result}")  # any exception can be sent
    with suppress(BrokenPipeError):  # nobody waits for it any more
        sender.send(result)


def _follow_parent() -> None:
    """A process does not outlive its parent for long."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    while True:  # the first asks a training to save and stop, the next ends whatever is left
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE)


def _end(processes: Sequence[Any]) -> None:
    """Ask processes to save and stop, and wait for them."""
    for process in processes:
        process.terminate()
    for process in processes:
        process.join()


@contextmanager
def _termination_interrupts() -> Iterator[None]:
    """Within, SIGTERM is like Ctrl-C."""

    def interrupt(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    try:
        previous = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not in the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Within, processes that begin see these variables, unless they were set before."""
    added = {name: value for name, value in values.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


class Progress:
    """What is done and how long is left: one line on a terminal, else a line now and then."""

    def __init__(self, tasks: Sequence[Task], workers: int, title: str) -> None:
        self.tasks, self.workers, self.title = tasks, workers, title
        self.done = [False] * len(tasks)
        self.began = self.shown = time.monotonic()
        self.before = sum(task.seconds * task.part_done() for task in tasks)  # by an earlier call
        self.live = sys.stderr.isatty()

    def finished(self, place: int, result: Any) -> None:
        """Say that a task has come to its end."""
        self.done[place] = True
        ending = f"failed: {result}" if isinstance(result, Exception) else "done"
        count = f"{self.title} {sum(self.done)}/{len(self.tasks)}"
        self._print(f"{count}: {self.tasks[place].label} {ending}", stays=True)

    def show(self) -> None:
        """Say how things stand, where it is time to."""
        now = time.monotonic()
        if all(self.done) or now - self.shown < (1.0 if self.live else QUIET):
            return
        self.shown = now
        parts = [1.0 if done else task.part_done() for task, done in zip(self.tasks, self.done, strict=True)]
        active = [
            f"{task.label} {100 * part:.0f}%"
            for task, part, done in zip(self.tasks, parts, self.done, strict=True)
            if part > 0 and not done
        ]
        text = f"{self.title} {sum(self.done)}/{len(self.tasks)}"
        text += f" ({', '.join(active)})" if active else ""
        left = self.seconds_left(parts, now)
        self._print(text + ("" if left is None else f": {readable(left)} left"))

    def seconds_left(self, parts: Sequence[float], now: float) -> float | None:
        """By the pace so far; None while there is none."""
        whole = sum(task.seconds for task in self.tasks)
        done = sum(task.seconds * part for task, part in zip(self.tasks, parts, strict=True))
        pace = (done - self.before) / max(now - self.began, 1e-9)
        if pace <= 0 or done - self.before < 0.002 * whole:
            return None
        longest = max(task.seconds * (1 - part) for task, part in zip(self.tasks, parts, strict=True))
        return max((whole - done) / pace, longest * min(self.workers, len(self.tasks)) / pace)

    def _print(self, text: str, *, stays: bool = False) -> None:
        if self.live:
            print(f"\r\033[K{text}", end="\n" if stays else "", file=sys.stderr, flush=True)
        else:
            print(text, file=sys.stderr, flush=True)


def readable(seconds: float) -> str:
    """A time as people say it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
