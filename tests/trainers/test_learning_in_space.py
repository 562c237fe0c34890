"""Training in space: settings, what every command makes of a run, and results that hold quaternions."""

import os
from pathlib import Path

import numpy as np
import pytest

from swarm import World, figures
from swarm.figures.evaluation import POPULATION
from swarm.optimal import physical_limit
from swarm.population.results import load_population, world_of
from tests.trainers.test_cli import SHORT, refused, run
from trainers.settings.composition import SettingsError, checked, settings_from
from trainers.training.run_folder import TEST

SPACE = ("experiment=space", *SHORT, "world.life=1", "validation.life=1", "evaluation.life=1")


@pytest.fixture(autouse=True)
def elsewhere(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    monkeypatch.setattr(physical_limit, "SPHERES", (4, 6, 8))  # coarse and quick
    monkeypatch.setattr(figures, "save", lambda figure, path: None)  # pixels take most of the time


def test_the_experiment_is_the_default_world_of_space():
    settings = settings_from(["experiment=space"])
    assert settings.training_world() == World.in_space(life=settings.training_world().life)
    assert settings.test_world().dimensions == 3


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"torsions": [7.7]}, r"world\.torsions must"),
        ({"torsions": [7.7, "x"]}, r"world\.torsions must"),
        ({"torsions": 5}, r"world\.torsions must"),
        ({"torsion": [7.7, 5.7]}, r"did you mean 'world\.torsions'"),
        ({"medium": {"uptake": 0.1}}, "medium must"),
        ({"first_arrivals": 2, "field": "radial"}, "first_arrivals must"),
        ({"action": "continuous"}, "action must|action='continuous' must"),
        ({"interactions": ["contact"]}, "interactions must"),
        ({"spread": {"speed": 0.1}}, "spread must"),
        ({"flow": "taylor_green"}, "flow must"),
        ({"start_box": [[0, 1], [0, 1]]}, r"world\.start_box must"),
    ],
)
def test_what_does_not_go_with_space_is_refused_in_one_line(changes, said):
    with pytest.raises(SettingsError, match=said) as refusal:
        checked({"world": {"torsions": [7.7, 5.7]} | changes})
    assert "\n" not in str(refusal.value)


def test_every_command_takes_a_run_in_space():
    code, out, _ = run("train", *SPACE, "evaluate=true", "hydra.run.dir=run")
    assert (code, "greedy" in out) == (0, True)
    assert run("evaluate", "run", "--cells", 3, "--life", 1, "--record", "ends", "--out", "blocks")[0] == 0
    whole, blocks = (load_population(Path(folder) / POPULATION) for folder in (f"run/{TEST}", "blocks"))
    assert world_of(whole).torsions == (7.7, 5.7)
    np.testing.assert_allclose(np.square(whole["start_heading"]).sum("quaternion"), 1)
    np.testing.assert_array_equal(blocks["gain"], whole["gain"])
    assert "space swarm dqn" in run("compare", "run", "--cells", 3, "--life", 1)[1]
    assert "space" in run("list", "experiments")[1]
    assert "first_arrivals must" in refused("evaluate", "run", "--against", "greedy")
