"""The experiments on crowds in miniature, through everything that whole ones go through."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from swarm.policies import network
from trainers.studies import zoo
from trainers.studies.crowd import measurements as crowd
from trainers.studies.crowd.measurements import Sample, with_best
from trainers.studies.crowd.plan import SHIPPED, TRAININGS, CrowdPlan
from trainers.studies.crowd.report import STUDY
from trainers.training import run as running

WORDS = ("world.life=4.0", "learning.epochs=2", "learning.batch_size=16", "validation.life=4.0")
WORDS += ("evaluation.life=4.0", "validation.cells=5", "learning.n_worlds=1")
TINY = CrowdPlan(
    n_seeds=2,
    words=(*WORDS, "compile=never"),
    workers=0,
    crowds=((1, 3), (40, 2)),
    finely=((40, 1),),
    shares=(0.1, 0.5),
    races=10,
    shear_rates=(0.0, 0.08),
    shear_cells=6,
    films=2,
    film_cells=6,
)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The folder of the whole, a copy without the runs, and the verdicts."""
    folder = tmp_path_factory.mktemp("crowds")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(running, "draw", lambda training, run: None)  # of each training
        found = STUDY.carry_out(TINY, folder / "out", folder / "published").claims
    return SimpleNamespace(out=folder / "out", published=folder / "published", claims=found)


@pytest.mark.slow
def test_every_training_point_and_figure_is_there(done):
    assert {path.name for path in (done.out / "runs/swarm").iterdir()} == set(TRAININGS)
    names = {path.name.rsplit(".", 2)[0] for path in (done.out / "measured").iterdir()}
    assert names >= {"uptake_40", "race_0.5", "shear_0", "shear_0_choice", "film_both"}
    report = (done.published / "report.md").read_text()
    shown = re.findall(r"!\[.*?\]\((.*?)\)", report)
    assert len(shown) == 4
    assert all((done.published / path).read_bytes().startswith(b"\x89PNG") for path in shown)
    assert all(claim.claim in report and claim.verdict in report for claim in done.claims)
    assert {claim.verdict for claim in done.claims} <= {"yes", "no", "not shown"}
    assert "CrowdPlan" not in report
    assert not (done.published / "runs").exists()
    record = json.loads((done.out / "reproduction.json").read_text())
    assert record["trainings"]["crowd_uptake_ppo"]["settings"]["algorithm"] == "ppo"


@pytest.mark.slow
def test_what_is_finished_is_not_done_again(done, monkeypatch):
    monkeypatch.setattr(crowd, "measure", lambda point: pytest.fail(f"{point.name} is measured again"))
    assert STUDY.carry_out(TINY, done.out).claims == done.claims


@pytest.mark.slow
def test_policies_to_be_shipped_tell_of_their_tests(done, tmp_path, monkeypatch):
    assert zoo.ship(done.out, tmp_path) == sorted(SHIPPED)
    for name, where in SHIPPED.items():
        card = network.load_policy(tmp_path / f"{name}.safetensors").card
        assert card["experiment"] == name
        assert (card["test"]["test"], card["seeds"]) == (where, [0, 1])


@pytest.mark.slow
def test_quick_tests_the_shipped_policies(tmp_path):
    found = STUDY.carry_out(replace(TINY, quick=True, crowds=((40, 1),), films=1), tmp_path).claims
    assert not (tmp_path / "runs").exists()
    assert {len(claim.seeds) for claim in found if claim.seeds} == {1}
    assert {"race_own_0.5", "shear_learnt_over_greedy_0.08"} <= {claim.id for claim in found}
    assert "shipped" in (tmp_path / "report.md").read_text()


def test_the_best_shear_rate_is_chosen_among_other_cells():
    def sample(*arrived):
        return {"greedy": Sample((), {"arrived": np.array([arrived], float)})}

    found = {"shear_0": sample(0, 1), "shear_1": sample(1, 1), "shear_2": sample(0, 0)}
    found |= {"shear_0_choice": sample(0, 0), "shear_1_choice": sample(0, 0), "shear_2_choice": sample(1, 1)}
    best = with_best(found, (0.0, 1.0, 2.0))["shear_best"]
    assert best["greedy"] is found["shear_2"]["greedy"]
