"""Work in processes of its own: results, crashes, interruption, and no process left behind."""

import gc
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from trainers.jobs.executors import Processes, Task, executor_for, run_tasks
from trainers.training.run_folder import RunError


def run(workers, *pieces):
    """Results of pieces of work (do, argument, …)."""
    tasks = [Task(str(place), do, arguments) for place, (do, *arguments) in enumerate(pieces)]
    return run_tasks(tasks, executor_for(workers), title="")


@pytest.mark.parametrize("workers", [0, 2])
def test_results_come_in_the_order_of_the_tasks(workers):
    assert run(workers, (math.sqrt, 9.0), (max, 1, 2), (str, 5)) == [3.0, 2, "5"]


@pytest.mark.parametrize("workers", [0, 1])
def test_a_task_that_fails_does_not_stop_the_others(workers, capsys):
    failed, done = run(workers, (math.sqrt, -1.0), (math.sqrt, 4.0))
    assert isinstance(failed, ValueError)
    assert done == 2.0
    assert "0 failed: math domain error" in capsys.readouterr().err


@pytest.mark.parametrize("death", [(os._exit, 7), (signal.raise_signal, signal.SIGKILL)])
def test_a_process_that_is_killed_takes_no_other_with_it(death):
    died, done, waited = run(2, death, (time.sleep, 1.0), (math.sqrt, 4.0))
    assert isinstance(died, RuntimeError)
    assert "its process was stopped" in str(died)
    assert (done, waited) == (None, 2.0)


def killed_at_first(file, kills):
    """Kills its process so many times; then the number of its begins, which a file counts."""
    with open(file, "a") as counted:
        counted.write("x")
    if os.path.getsize(file) <= kills:
        os.kill(os.getpid(), signal.SIGKILL)
    return os.path.getsize(file)


def test_a_task_that_loses_its_process_is_begun_again_as_often_as_it_may(tmp_path):
    with Processes(1, retries=1) as executor:
        once, twice = (executor.submit(killed_at_first, str(tmp_path / str(n)), n) for n in (1, 2))
        assert once.result(60) == 2
        with pytest.raises(RunError, match="its process was stopped"):
            twice.result(60)


def test_workers_compute_with_one_thread_each():
    assert run(1, (os.getenv, "OMP_NUM_THREADS")) == [os.environ.get("OMP_NUM_THREADS", "1")]


def test_the_longest_task_is_begun_first():
    begun = []
    tasks = [Task("", begun.append, (seconds,), seconds) for seconds in (1.0, 3.0, 2.0)]
    run_tasks(tasks, executor_for(0), title="")
    assert begun == [3.0, 2.0, 1.0]


@pytest.fixture
def heard():
    """Ctrl-C arrives: no other handler is left, and no garbage collected meanwhile, because Python drops a
    KeyboardInterrupt that comes within a finalizer.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    gc.disable()
    yield
    gc.enable()
    signal.signal(signal.SIGINT, before)


def test_an_interruption_ends_every_process_and_says_how_to_go_on(heard):
    threading.Timer(1.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt, match="goes on from there"):
        run(2, *[(time.sleep, 60)] * 4)
    assert time.monotonic() - began < 30
    assert not multiprocessing.active_children()


def sleep_noted(file):
    file.write_text(str(os.getpid()))
    time.sleep(60)


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="processes are found by /proc")
def test_a_process_ends_with_its_parent(tmp_path):
    file, until = tmp_path / "process", time.monotonic() + 60
    code = f"from tests.trainers.test_executors import *; run(1, (sleep_noted, Path({str(file)!r})))"
    root = Path(__file__).parents[2]
    parent = subprocess.Popen([sys.executable, "-c", code], cwd=root, stderr=subprocess.DEVNULL)
    while not (file.exists() and file.read_text()) and time.monotonic() < until:
        time.sleep(0.05)
    parent.kill()
    parent.wait()
    state = Path(f"/proc/{file.read_text()}/stat")
    while state.exists() and state.read_text().split()[2] != "Z" and time.monotonic() < until:
        time.sleep(0.05)  # nobody may be there to take note of its end
    assert time.monotonic() < until
