"""Kills training runs with SIGKILL at random moments, resumes them, and compares what they end with.

    python -m tests.trainers.kill_runs KILLS [FOLDER] [SEED]

Exits with 0 where every run that was killed, perhaps several times, ends bit for bit as one that never was.
"""

import contextlib
import dataclasses
import os
import random
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path

import torch

sys.path.insert(0, str(Path(__file__).parents[2]))

from swarm._support import files, provenance
from tests.short_runs import NOISE, assert_equal_runs, short_settings
from trainers import cli
from trainers.training import run as running  # noqa: F401
from trainers.training import run_folder as runs

os.environ["PYTHONWARNINGS"] = "ignore"  # of the process that cleans up after killed ones
SETTINGS = short_settings(
    n_seeds=2,
    checkpoint_every=1,
    world={"varying_speed": True, **NOISE},
    learning={"epochs": 8, "buffer_size": 2000},
)


def child(folder):
    """Train or resume in a process of its own; returns its number."""
    number = os.fork()
    if number:
        return number
    code = 1
    try:
        os.setsid()
        log = os.open(folder.with_suffix(".log"), os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        for stream in (1, 2):
            os.dup2(log, stream)
        if runs.is_run_folder(folder):
            cli.training.resume(folder)
        else:
            cli.training.begin(SETTINGS, folder)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(code)


def finished(number, folder):
    """Whether the child has come to its end; raises where it failed by itself."""
    done, status = os.waitpid(number, os.WNOHANG)
    if done and status != 0:
        raise SystemExit(f"a run failed:\n{folder.with_suffix('.log').read_text()}")
    return bool(done)


def run_to_end(folder):
    """A run that nobody kills; returns the seconds it took."""
    started, number = time.monotonic(), child(folder)
    while not finished(number, folder):
        time.sleep(0.01)
    return time.monotonic() - started


def killed_run(folder, longest, moments, most):
    """Kills a run up to `most` times, then lets it end; returns the number of kills."""
    for kills in range(most):
        number = child(folder)
        until = time.monotonic() + moments.uniform(0, longest)
        while time.monotonic() < until:
            if finished(number, folder):
                return kills
            time.sleep(0.001)
        os.kill(number, signal.SIGKILL)
        os.waitpid(number, 0)
    run_to_end(folder)
    return most


def main(wanted, parent, seed):
    torch.set_num_threads(1)
    provenance.commit()  # once: files may be edited meanwhile
    moments = random.Random(seed)
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):  # what every child would
        cli.training.begin(dataclasses.replace(SETTINGS, learning=short_settings().learning), parent / "warm")
    seconds = run_to_end(parent / "whole")
    whole, kills, count = runs.RunFolder(parent / "whole"), 0, 0
    while kills < wanted:
        count += 1
        folder = parent / f"killed_{count}"
        kills += killed_run(folder, seconds, moments, wanted - kills)
        run = runs.RunFolder(folder)
        assert run.finished
        assert_equal_runs(run, whole)
        left = [path for path in folder.rglob(".*") if path.name != files.LOCK]
        assert not left, left
    print(f"{kills} kills in {count} runs; all ended as the run that was not killed")


if __name__ == "__main__":
    folder = sys.argv[2] if len(sys.argv) > 2 else tempfile.mkdtemp()
    main(int(sys.argv[1]), Path(folder), int(sys.argv[3]) if len(sys.argv) > 3 else 0)
