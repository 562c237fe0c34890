"""Repeatability: the same settings on the same machine give the same run, bit for bit."""

import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from swarm import World
from swarm._support import streams
from swarm.physics.starts import draw_noise, draw_starts
from tests.short_runs import NOISE, assert_equal_runs, kept, short_settings, whole
from trainers.training import run_folder as runs

# What seed 0 draws, in the test population's first episode.
POSITION = [[8.985834851506375, 2.6695690346014533], [7.746067345000585, 2.795127958723176]]
HEADING = [-0.310025949372176, 0.39433476492078867]
PAST = [[0, 0, 0, 1], [0, 0, 0, 0]]
NOISE_OF_SEED_0 = [-1.2868471165710822, -0.008425312451525642, -0.8621112224123199]
EXPLORATION = 2279798377461480
NETWORK = 3730334278710825027

LARGE = {"n_swimmers": 400, "batch_size": 2048, "buffer_size": 20_000, "hidden": [64, 64], "epochs": 2}


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)


@pytest.mark.parametrize("threads", [1, 2])
def test_two_runs_with_the_same_threads_are_equal_bit_for_bit(tmp_path, threads):
    settings = short_settings(threads=threads, world=NOISE, learning=LARGE)
    first = whole(tmp_path / "first", settings)
    assert torch.get_num_threads() == threads
    assert_equal_runs(first, whole(tmp_path / "second", settings))


def test_another_seed_gives_another_run(tmp_path):
    one, other = (kept(whole(tmp_path / str(seed), short_settings(seed=seed))) for seed in (1, 2))
    weights = "loss.value_network_params.0.weight"
    assert not torch.equal(one[weights], other[weights])
    assert not torch.equal(one["buffer"], other["buffer"])


def test_the_global_generators_decide_nothing_and_stay_as_they_are(tmp_path):
    settings = short_settings(world=NOISE)
    found = []
    for seed in (1, 2):
        random.seed(seed)
        np.random.seed(seed)  # noqa: NPY002
        torch.manual_seed(seed)
        before = random.getstate(), np.random.get_state()[1].tolist(), torch.get_rng_state().tolist()  # noqa: NPY002
        found.append(whole(tmp_path / str(seed), settings))
        after = random.getstate(), np.random.get_state()[1].tolist(), torch.get_rng_state().tolist()  # noqa: NPY002
        assert before == after
    assert_equal_runs(*found)


@pytest.mark.slow
def test_another_process_with_other_hashes_gives_the_same_run(tmp_path):
    settings = short_settings(world=NOISE)
    expected = whole(tmp_path / "here", settings)
    code = (
        "from tests.short_runs import NOISE, short_settings, whole\n"
        f"whole({str(tmp_path / 'there')!r}, short_settings(world=NOISE))\n"
    )
    paths = os.pathsep.join([str(Path(__file__).parents[2]), str(Path(runs.__file__).parents[2])])
    environment = os.environ | {"PYTHONHASHSEED": "12345", "PYTHONPATH": paths}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
    assert_equal_runs(expected, runs.RunFolder(tmp_path / "there"))


@pytest.mark.slow
def test_compiled_runs_are_equal_bit_for_bit_and_resume_exactly(tmp_path):
    from tests.short_runs import Crash, go_on, start

    settings = short_settings(
        compile="always", world={"flow": "taylor_green", "sense_flow": True}, learning={"n_steps": 3}
    )
    expected = whole(tmp_path / "whole", settings)
    assert_equal_runs(expected, whole(tmp_path / "again", settings))

    def stop(made, seconds):
        if made.epoch == 3:
            raise Crash

    run = start(tmp_path / "resumed", settings)
    with pytest.raises(Crash):
        go_on(run, settings, stop)
    go_on(run, settings)
    assert_equal_runs(expected, run)


def test_starts_are_the_same_numbers_on_every_machine():
    assert [part.tolist() for part in draw_starts(World(), 2, 0)[:3]] == [POSITION, HEADING, PAST]
    assert streams.integer_seed("training", "exploration", 0, 0) == EXPLORATION
    assert streams.integer_seed("training", "network", 7) == NETWORK
    assert draw_noise(0, 1, 1)[0, 0] == pytest.approx(NOISE_OF_SEED_0, rel=1e-14)
