"""Where tasks run: here, or in processes of their own; all through the interface of `concurrent.futures`."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import suppress
from typing import Any, NamedTuple

from swarm._support.terminal import Progress
from trainers.training.run_folder import RunError

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
GRACE = 60.0  # [s] a process whose parent is gone has to save what it was doing


class Task(NamedTuple):
    """A piece of work: `do(*arguments)`, both of which may go to another process."""

    label: str
    do: Callable[..., Any]
    arguments: tuple[Any, ...]
    seconds: float = 1.0  # expected; only their ratios matter
    part_done: Callable[[], float] = float  # in [0, 1], while it is worked on
    keep: Callable[[Any], Any] | None = None  # what becomes of its outcome, here, and what it is then


def run_tasks(tasks: Sequence[Task], executor: Executor, *, title: str) -> list[Any]:
    """Results of all tasks, or the exceptions they ended with; the longest are begun first.

    Raises KeyboardInterrupt after Ctrl-C, once what runs has saved and ended.
    """
    futures: dict[int, Future] = {}
    outcomes: dict[int, Any] = {}

    def take() -> None:
        for place, future in futures.items():
            if place not in outcomes and future.done() and not future.cancelled():
                outcomes[place] = _kept(tasks[place], future)
                failed = isinstance(outcomes[place], BaseException)
                ending = f"failed: {outcomes[place]}" if failed else "done"
                bar.say(f"{title} {len(outcomes)}/{len(tasks)}: {tasks[place].label} {ending}")
        bar.show(seconds_done(), text=f"{len(outcomes)}/{len(tasks)}")

    def seconds_done() -> float:
        parts = (1.0 if place in outcomes else task.part_done() for place, task in enumerate(tasks))
        return sum(task.seconds * part for task, part in zip(tasks, parts, strict=True))

    with Progress(title, sum(task.seconds for task in tasks), seconds_done()) as bar, executor:
        try:
            for place in sorted(range(len(tasks)), key=lambda place: -tasks[place].seconds):
                futures[place] = executor.submit(tasks[place].do, *tasks[place].arguments)
                if futures[place].done():
                    take()
            while len(outcomes) < len(tasks):
                left = [futures[place] for place in futures.keys() - outcomes.keys()]
                wait(left, timeout=1.0, return_when=FIRST_COMPLETED)
                take()
        except KeyboardInterrupt:
            executor.shutdown(cancel_futures=True)
            take()
            how = "stopped; what was done is kept, and the same command goes on from there"
            raise KeyboardInterrupt(how) from None
    return [outcomes[place] for place in range(len(tasks))]


def _kept(task: Task, future: Future) -> Any:
    """The outcome of a task that has ended, or its error."""
    if (error := future.exception()) is not None or task.keep is None:
        return error or future.result()
    try:
        return task.keep(future.result())
    except Exception as error:
        return error


class LostProcess(RunError):
    """A process that was killed."""


class InProcess(Executor):
    """Does each task at once, here."""

    workers = 1

    def submit(self, do: Callable[..., Any], /, *arguments: Any, **options: Any) -> Future:
        """The outcome of `do(*arguments, **options)`, which is done when this returns."""
        future: Future = Future()
        try:
            future.set_result(do(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future


class Processes(Executor):
    """Tasks in `workers` processes: one that is killed takes no other's task with it, and is replaced.

    Its own task is begun again up to `retries` times, which tasks must stand.
    """

    def __init__(self, workers: int, retries: int = 0) -> None:
        os.environ.update(ONE_THREAD | os.environ)  # before a process imports what computes
        self.workers, self.retries = workers, retries
        self._threads = ThreadPoolExecutor(workers)  # each of them has a process
        self._own = threading.local()
        self._processes: list[ProcessPoolExecutor] = []
        self._gate, self._stopped = threading.Lock(), False

    def submit(self, do: Callable[..., Any], /, *arguments: Any, **options: Any) -> Future:
        """The future outcome of `do(*arguments, **options)`."""
        return self._threads.submit(self._retried, do, arguments, options)

    def _retried(self, do: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]) -> Any:
        for _ in range(self.retries):
            with suppress(LostProcess):
                return self._alone(do, arguments, options)
        return self._alone(do, arguments, options)

    def _alone(self, do: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]) -> Any:
        with self._gate:  # no process begins once they have been asked to end
            if self._stopped:
                raise RuntimeError("it was not begun")
            if getattr(self._own, "process", None) is None:
                context = multiprocessing.get_context("spawn")
                self._own.process = ProcessPoolExecutor(1, mp_context=context, initializer=_begin)
                self._processes.append(self._own.process)
            future = self._own.process.submit(do, *arguments, **options)
        try:
            return future.result()
        except (BrokenExecutor, KeyboardInterrupt):
            self._own.process = None
            why = "" if self._stopped else ", perhaps because memory ran out"
            raise LostProcess(f"its process was stopped{why}") from None

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Wait for what runs; with `cancel_futures`, begin nothing more and ask what runs to save and end."""
        if cancel_futures:
            with self._gate:
                self._stopped = True
            for process in multiprocessing.active_children():
                process.terminate()
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        for each in self._processes:
            each.shutdown(wait)


def executor_for(workers: int) -> Executor:
    """Processes, so many at once; with 0, none but this one."""
    return Processes(workers) if workers else InProcess()


def _begin() -> None:
    """In a process of its own: Ctrl-C goes to the parent alone, which passes it on."""
    os.setpgid(0, 0)
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    """A process does not outlive its parent for long."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    while True:  # the first asks a training to save and stop, the next ends whatever is left
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE)
