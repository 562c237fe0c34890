"""Exact resume: a run that crashes anywhere and goes on ends as the run that never crashed, bit for bit."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from swarm._support import files
from tests.short_runs import NOISE, Crash, assert_equal_runs, go_on, short_settings, start, whole
from trainers.algorithms.dqn import DQN
from trainers.training import checkpoint as checkpoints
from trainers.training import run as running
from trainers.training.loop import Validation
from trainers.training.run_folder import RunFolder

CROWD = {
    "medium": {
        "box": [[2.0, 8.0], [-3.0, 3.0]],
        "shape": [32, 32],
        "edges": "periodic",
        "leaving": "wrap",
        "diffusivity": 0.024,
        "uptake": 0.05,
        "substeps": 2,
    },
    "interactions": [{"type": "contact", "diameter": 0.5, "stiffness": 20.0}],
    "spread": {"speed": 0.1},
    "interval_rule": "common",
    "start_box": [[4.0, 6.0], [-1.0, 1.0]],
    "life": 2.5,
}
SETTINGS = {
    "swarm": short_settings(),
    "paper": short_settings("paper"),
    "seeds, noise, clocks": short_settings(n_seeds=2, world={"varying_speed": True, **NOISE}),
    "vortices, two worlds": short_settings(
        world={"flow": "taylor_green", "sense_flow": True}, learning={"n_worlds": 2, "n_steps": 3}
    ),
    "exact intervals": short_settings(
        "paper", n_seeds=2, world={"varying_speed": True, "interval_rule": "exact", "curvature_noise": 0.1}
    ),
    "space": short_settings(
        world={"torsions": [7.7, 5.7], "curvatures": [5.5, 7.5], "speed": 2.0, "life": 1.0}
    ),
    "crowd": short_settings(world=CROWD, learning={"n_worlds": 2}, validation={"life": 2.0}),
    "crowd, central critic": short_settings(
        "ppo", world=CROWD, learning={"critic": "central"}, validation={"life": 2.0}
    ),
    "curvatures": short_settings("ppo", n_seeds=2, world={"action": "continuous"}),
    "recurrent": short_settings("drqn", n_seeds=2, world={"binding_rate": 800.0}),
}
PHASES = {
    "preparing": [(running, "_go_on")],
    "collecting": [(DQN, "collect")],
    "updating": [(DQN, "learn")],
    "validating": [(Validation, "gains")],
    "writing tables": [(RunFolder, "append"), (RunFolder, "rewrite")],
    "writing checkpoints": [(checkpoints, "write"), (files, "_flush"), (os, "replace")],
    "keeping policies": [(running, "save_policy")],
}

# Every phase with some settings, and all settings in the phases where they differ.
PAIRS = [(name, phase) for name in ("swarm", "seeds, noise, clocks") for phase in PHASES]
DEEP_Q = [name for name, settings in SETTINGS.items() if settings.algorithm != "ppo"]
PAIRS += [(name, phase) for name in DEEP_Q for phase in ("collecting", "writing checkpoints")]
PAIRS = sorted(set(PAIRS))


@pytest.fixture(autouse=True)
def no_waiting_for_the_disk(monkeypatch):
    """Nothing here pulls the plug of the machine."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


@pytest.fixture(scope="module")
def reference(request, tmp_path_factory):
    """Settings, the run with them that never crashed, and how often it came to each phase."""
    settings, counts = SETTINGS[request.param], dict.fromkeys(PHASES, 0)
    with pytest.MonkeyPatch.context() as patch:
        for phase, places in PHASES.items():

            def count(phase=phase):
                counts[phase] += 1

            before(patch, places, count)
        run = whole(tmp_path_factory.mktemp("whole") / "run", settings)
    return settings, run, counts


def before(patch, places, do):
    """From now on, `do` comes before every call of what is at the places."""
    for owner, name in places:

        def wrapped(original):
            def call(*arguments, **options):
                do()
                return original(*arguments, **options)

            return call

        patch.setattr(owner, name, wrapped(getattr(owner, name)))


@pytest.mark.parametrize(("reference", "phase"), PAIRS, indirect=["reference"])
def test_a_run_that_crashes_in_a_phase_ends_as_if_it_had_not(reference, phase, tmp_path, monkeypatch):
    """The run crashes early in the phase, is resumed, crashes late in it, and is resumed again."""
    settings, expected, counts = reference
    assert counts[phase] >= 1
    run, crashes = start(tmp_path / "run", settings), 0
    for turn in (counts[phase] // 4, counts[phase] // 3):
        calls = iter(range(10**6))

        def crash(calls=calls, turn=turn):
            if next(calls) == turn:
                raise Crash

        with monkeypatch.context() as patch:
            before(patch, PHASES[phase], crash)
            try:
                go_on(run, settings)
            except Crash:
                crashes += 1
    assert crashes >= 1
    go_on(run, settings)
    assert_equal_runs(run, expected)


@pytest.mark.parametrize("reference", SETTINGS, indirect=True)
def test_a_run_stopped_and_resumed_after_every_epoch_ends_as_if_it_had_not(reference, tmp_path):
    settings, expected, _ = reference

    def stop(made, seconds):
        if made.epoch % settings.checkpoint_every == 0:
            raise Crash

    run = start(tmp_path / "run", settings)
    for _ in range(3):
        with pytest.raises(Crash):
            go_on(run, settings, stop)
    go_on(run, settings)
    assert_equal_runs(run, expected)


def test_a_run_that_is_resumed_at_its_end_is_as_it_was(tmp_path):
    settings = SETTINGS["swarm"]
    run, expected = whole(tmp_path / "run", settings), whole(tmp_path / "whole", settings)
    go_on(run, settings)
    assert_equal_runs(run, expected)
    assert [row["epoch"] for row in run.rows("timings.csv")] == list("123456")


def killed(kills, tmp_path):
    """Kills that many runs with SIGKILL; the script compares what they end with."""
    script = Path(__file__).with_name("kill_runs.py")
    done = subprocess.run(
        [sys.executable, str(script), str(kills), str(tmp_path)], capture_output=True, text=True, timeout=1200
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_runs_killed_at_random_moments_end_as_if_they_had_not(tmp_path):
    assert "3 kills" in killed(3, tmp_path)


@pytest.mark.slow
def test_runs_killed_at_a_hundred_random_moments_end_as_if_they_had_not(tmp_path):
    assert "100 kills" in killed(100, tmp_path)
