"""An algorithm from a user's package: by its name in every command, with settings and metrics of its own."""

import sys
from pathlib import Path

import pytest

from tests.trainers.test_cli import SHORT, elsewhere, refused, run  # noqa: F401

MINE = """
from typing import ClassVar
from pydantic.dataclasses import dataclass
from trainers.settings.learning import RULES, DQNSettings, Positive

@dataclass(config=RULES, frozen=True, kw_only=True)
class Settings(DQNSettings):
    learner: ClassVar = "its_learner:Learner"
    scale: Positive = 1.0

@dataclass(config=RULES, frozen=True, kw_only=True)
class Nobody(DQNSettings):
    learner: ClassVar = "json:dumps"
"""
LEARNER = """
from trainers.algorithms.dqn import DQN

class Learner(DQN):
    metrics = (*DQN.metrics, "scaled")

    def learn(self, rollout, progress):
        measured = super().learn(rollout, progress)
        return measured and measured | {"scaled": self.settings.scale * measured["loss"]}
"""
POINTS = """[chemoswarm.algorithms]
mine = its_settings:Settings
nobody = its_settings:Nobody
other = pathlib:Path
broken = no_such_module:Settings
"""


@pytest.fixture(autouse=True)
def package(tmp_path_factory, monkeypatch):
    """A package with algorithms among its entry points."""
    folder = tmp_path_factory.mktemp("package")
    (folder / "its_settings.py").write_text(MINE)
    (folder / "its_learner.py").write_text(LEARNER)
    (folder / "its-1.0.dist-info").mkdir()
    (folder / "its-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: its\nVersion: 1.0\n")
    (folder / "its-1.0.dist-info" / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(folder)
    yield
    for name in ("its_settings", "its_learner"):
        sys.modules.pop(name, None)


def test_it_is_trained_resumed_tested_and_compared_by_its_name():
    words = [word for word in SHORT if "epochs" not in word] + ["learning.epochs=1", "learning.scale=3.0"]
    assert run("train", *words, "algorithm=mine", "hydra.run.dir=mine")[0] == 0
    heading, first, *_ = (line.split(",") for line in Path("mine/metrics.csv").read_text().splitlines())
    row = dict(zip(heading, first, strict=True))
    assert float(row["scaled"]) == pytest.approx(3 * float(row["loss"]))
    assert "nothing is left to learn" in run("train", "resume=mine")[1]
    assert "mine " in run("evaluate", "mine", "--cells", 2, "--life", 4)[1]
    assert run("train", *words[:-1], "hydra.run.dir=stock")[0] == 0
    found = {line.split()[0] for line in run("compare", "mine", "stock", "--cells", 2)[1].splitlines()[1:]}
    assert found == {"mine", "dqn"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["algorithm=min"],
            "must be one of broken, dqn, drqn, evolution, mine, nobody, other, ppo, got 'min'; did you mean",
        ),
        (["algorithm=mine", "learning.scale=0.0"], "learning.scale must be above 0, got 0.0"),
        (["algorithm=mine", "learning.scal=1.0"], "no key 'learning.scal'; did you mean 'learning.scale'?"),
        (["learning.scale=1.0"], "settings have no key 'learning.scale'"),
        (["algorithm=nobody"], "algorithm 'nobody' must have an Algorithm as learner, got 'json:dumps'"),
        (["algorithm=other"], "must be registered by LearningSettings, got <class 'pathlib.Path'>"),
        (["algorithm=broken"], "swarm: algorithm 'broken' must be importable from no_such_module:Settings"),
    ],
)
def test_what_is_wrong_with_it_is_said(words, said):
    assert said in refused("train", *words)
