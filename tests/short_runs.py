"""Training runs that take a fraction of a second, and what two equal runs have in common."""

import dataclasses
import json
from pathlib import Path

import torch
from safetensors.torch import load_file

from trainers.settings.learning import ALGORITHMS
from trainers.settings.schema import EvaluationSettings, Settings, ValidationSettings
from trainers.training import loop as training
from trainers.training import run as running
from trainers.training import run_folder as runs

NOISE = {"concentration_noise": 0.05, "curvature_noise": 0.05, "rotational_diffusion": 0.01}
SWARM = {
    "n_swimmers": 5,
    "collect": 4,
    "updates": 2,
    "batch_size": 16,
    "buffer_size": 150,
    "double": True,
    "target_rate": 0.1,
    "loss": "huber",
    "learning_rate": 3e-3,
    "learning_rate_schedule": "linear",
    "epsilon_end": 0.05,
    "epsilon_schedule": "linear",
    "keep": "best",
}
PAPER = {"batch_size": 16, "buffer_size": 60}
DRQN = SWARM | {"nodes": 5, "hidden": [], "burn_in": 3, "n_steps": 2}
PPO = {"n_swimmers": 5, "collect": 4, "passes": 2, "batch_size": 8}


def short_settings(recipe="swarm", world=None, learning=None, validation=None, **changes):
    """Settings of a run of six epochs of a few decisions."""
    base = {"swarm": SWARM, "paper": PAPER, "ppo": PPO, "drqn": DRQN}[recipe]
    values = {"epochs": 6, "hidden": [6, 6]} | base | (learning or {})
    if "evaluation" in changes:
        changes["evaluation"] = EvaluationSettings(**changes["evaluation"])
    defaults = {"recipe": recipe, "checkpoint_every": 2, "tensorboard": False, "compile": "never", "seed": 3}
    algorithm = recipe if recipe in ("ppo", "drqn") else "dqn"
    return Settings(
        algorithm=algorithm,
        world={"life": 4.0} | (world or {}),
        learning=ALGORITHMS[algorithm](**values),
        validation=ValidationSettings(**({"cells": 3, "life": 4.0, "every": 2} | (validation or {}))),
        **(defaults | changes),
    )


class Crash(BaseException):
    """What a test throws into a run; nothing may catch it."""


def start(folder, settings):
    """A new run."""
    return runs.RunFolder.create(Path(folder), settings)


def go_on(run, settings, report=None):
    """Train, as the commands do, from wherever the run is; returns the training."""
    made = training.Training(settings)
    running.train(made, run, report=report)
    return made


def whole(folder, settings):
    """A run from beginning to end; returns its folder."""
    run = start(folder, settings)
    go_on(run, settings)
    return run


def kept(run):
    """Everything that two equal runs share, by name: bytes and tensors."""
    found = {
        str(path.relative_to(run.path)): path.read_bytes()
        for path in run.path.rglob("*")
        if path.name in (runs.POLICY, runs.METRICS)
    }
    newest = max(path for path in (run.path / runs.CHECKPOINTS).iterdir())
    found["checkpoint"] = newest.name
    found |= load_file(newest / "state.safetensors")
    found |= json.loads((newest / "manifest.json").read_text())["record"]
    return found


def assert_equal_runs(one, other):
    """Bit for bit the same policies, metrics, weights, optimiser, buffer, counters."""
    first, second = kept(one), kept(other)
    assert first.keys() == second.keys()
    for name, value in first.items():
        if isinstance(value, torch.Tensor):
            same = (
                torch.equal(value.view(torch.uint8), second[name].view(torch.uint8)) if value.ndim else True
            )
            assert same, name
            assert value.ndim or value.item() == second[name].item(), name
        else:
            assert value == second[name], name


def replaced(settings, **changes):
    """The same settings but for some."""
    return dataclasses.replace(settings, **changes)
