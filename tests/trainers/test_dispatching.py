"""Work in processes of its own: results, crashes, interruption, and no process left behind."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from trainers.jobs import pool as dispatching
from trainers.jobs.pool import Progress, Stopped, Task, work_off


def tasks(*pieces):
    return [Task(str(place), do, arguments, 1.0) for place, (do, arguments) in enumerate(pieces)]


@pytest.mark.parametrize("workers", [0, 2])
def test_results_come_in_the_order_of_the_tasks(workers):
    assert work_off(tasks((math.sqrt, (9.0,)), (max, (1, 2)), (str, (5,))), workers, title="") == [
        3.0,
        2,
        "5",
    ]


@pytest.mark.parametrize("workers", [0, 1])
def test_a_task_that_fails_does_not_stop_the_others(workers):
    failed, done = work_off(tasks((math.sqrt, (-1.0,)), (math.sqrt, (4.0,))), workers, title="")
    assert isinstance(failed, Exception)
    assert "math domain error" in str(failed)
    assert done == 2.0


def test_a_process_that_is_killed_takes_no_other_with_it():
    died, done = work_off(tasks((os._exit, (7,)), (math.sqrt, (4.0,))), 2, title="")
    assert isinstance(died, RuntimeError)
    assert "ended with 7" in str(died)
    assert done == 2.0


def test_workers_compute_with_one_thread_each():
    assert work_off(tasks((os.getenv, ("OMP_NUM_THREADS",))), 1, title="") == [
        os.environ.get("OMP_NUM_THREADS", "1")
    ]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_ends_every_process_and_says_how_to_go_on(number):
    threading.Timer(1.5, os.kill, (os.getpid(), number)).start()
    began = time.monotonic()
    with pytest.raises(Stopped, match="goes on from there"):
        work_off(tasks((time.sleep, (60,)), (time.sleep, (60,))), 2, title="")
    assert time.monotonic() - began < 30
    assert not dispatching.multiprocessing.active_children()


def test_a_process_ends_with_its_parent(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(
        "import time\n"
        "from trainers.jobs.pool import Task, work_off\n"
        "def work():\n"
        "    import os, pathlib\n"
        f"    pathlib.Path({str(tmp_path / 'pid')!r}).write_text(str(os.getpid()))\n"
        "    time.sleep(60)\n"
        "if __name__ == '__main__':\n"
        "    work_off([Task('', work, (), 1.0)], 1, title='')\n"
    )
    parent = subprocess.Popen([sys.executable, str(script)], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 30
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    child = int((tmp_path / "pid").read_text())
    parent.kill()
    parent.wait()
    while time.monotonic() < deadline:
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            return
        with open(f"/proc/{child}/stat") as file:  # nobody may be there to take note of its end
            if file.read().split()[2] == "Z":
                return
        time.sleep(0.05)
    pytest.fail("the process outlived its parent")


def test_the_time_left_follows_from_the_work_that_is_done():
    work = [Task("a", max, (), 30.0), Task("b", max, (), 10.0)]
    progress = Progress(work, 1, "test")
    assert progress.seconds_left([0.0, 0.0], progress.began + 5) is None
    assert progress.seconds_left([0.5, 0.5], progress.began + 100) == pytest.approx(100)
    assert progress.seconds_left([1.0, 0.0], progress.began + 90) == pytest.approx(30)


def test_work_done_by_an_earlier_call_is_no_sign_of_speed():
    progress = Progress([Task("a", max, (), 30.0, part_done=lambda: 0.5)], 1, "test")
    assert progress.seconds_left([0.5], progress.began + 5) is None
    assert progress.seconds_left([0.75], progress.began + 10) == pytest.approx(10)


def test_the_last_long_task_does_not_get_faster_by_having_two_cores():
    progress = Progress([Task("a", max, (), 30.0), Task("b", max, (), 30.0)], 2, "test")
    assert progress.seconds_left([1.0, 0.5], progress.began + 30) == pytest.approx(20)
