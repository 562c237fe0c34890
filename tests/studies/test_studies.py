"""What all studies have in common: whose folder they write to, and what is refused before any work."""

import json

import pytest

from tests.trainers.test_cli import refused
from trainers.settings.composition import SettingsError
from trainers.studies.crowd.plan import CrowdPlan
from trainers.studies.crowd.report import STUDY as CROWD
from trainers.studies.minimal.plan import MinimalPlan
from trainers.studies.minimal.report import STUDY as MINIMAL
from trainers.studies.paper.plan import Plan
from trainers.studies.paper.report import STUDY as PAPER
from trainers.studies.strategies.plan import StrategiesPlan
from trainers.studies.strategies.report import STUDY as STRATEGIES
from trainers.training.run_folder import RunError

PLANS = {"paper": Plan(), "crowd": CrowdPlan(), "minimal": MinimalPlan()}
PLANS["strategies"] = StrategiesPlan(worlds=("linear_n4",))
STUDIES = {"paper": PAPER, "crowd": CROWD, "minimal": MINIMAL, "strategies": STRATEGIES}


def results(folder, *paths, record="{}"):
    """A folder that holds these files."""
    for path in paths:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(record)
    return folder


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_goes_on_in_its_own_folder_and_in_no_other_studys(name, tmp_path):
    record = json.dumps({"plan": PLANS[name].recorded()})
    folder = results(tmp_path, "reproduction.json", "results.csv", "report.md", "mine.png", record=record)
    for other, study in STUDIES.items():
        if other == name:
            study.check(folder)
        else:
            with pytest.raises(RunError, match=r"got one that holds another.s reproduction\.json$"):
                study.check(folder)


@pytest.mark.parametrize("study", STUDIES.values(), ids=STUDIES)
@pytest.mark.parametrize(
    ("paths", "named"),
    [
        (["report.md"], "report.md"),
        (["figures/a.png", "runs/a"], "figures"),
        (["notes.txt", "population.nc"], "population.nc"),
        (["seed=0/run.json"], "seed=0"),
        (["reproduction.json"], "another's reproduction.json"),
    ],
)
def test_a_folder_of_other_results_is_refused_before_any_work(study, paths, named, tmp_path):
    results(tmp_path, *paths)
    for plain, published in ((tmp_path, None), (tmp_path / "new", tmp_path)):
        with pytest.raises(RunError, match=f"must be a new folder or .* got one that holds {named}$"):
            study.carry_out(None, plain, published)


@pytest.mark.parametrize("named", ["file", "file/deep", "loop"])
def test_a_folder_that_cannot_be_is_said_before_any_work(named, tmp_path):
    results(tmp_path, "file")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(RunError, match=f"{named} must be a folder, but .*{named[:4]} is a file"):
        PAPER.carry_out(None, tmp_path / named)


def test_unfinished_work_and_notes_are_no_results(tmp_path):
    for study in STUDIES.values():
        study.check(results(tmp_path, "runs/swarm/a", "measured/b", "searched/c", ".cache/d", "notes.txt"))


ALONE = "compared where each cell lives alone, got cells that share a medium, meet, race or see each other"


@pytest.mark.parametrize(
    ("plan", "worlds", "said"),
    [
        (StrategiesPlan, ("linear_n4", "film"), f"strategies must be {ALONE}; experiment=film"),
        (StrategiesPlan, ("race",), f"strategies must be {ALONE}; experiment=race"),
        (StrategiesPlan, ("crowd_uptake",), f"strategies must be {ALONE}; experiment=crowd_uptake"),
        (StrategiesPlan, ("continuous_n4",), "are two curvatures, got a range; experiment=continuous_n4"),
        (MinimalPlan, ("radial",), "the smallest brain must have a linear field, got RadialField"),
        (MinimalPlan, ("continuous_n4",), "must have two curvatures, got a range; experiment=continuous_n4"),
        (
            MinimalPlan,
            ("taylor_green_aware",),
            "must have the sensor memory, got memory_with_flow",
        ),
        (MinimalPlan, ("film",), "the smallest brain must have cells that are alike and alone"),
        (MinimalPlan, ("linear_n5",), "experiment must be one of"),
    ],
)
def test_worlds_that_cannot_be_studied_are_refused_by_rule_and_name(plan, worlds, said):
    with pytest.raises(SettingsError, match=said):
        plan(**{"worlds" if plan is StrategiesPlan else "cases": worlds})


@pytest.mark.slow
@pytest.mark.parametrize("command", ["minimal", "strategies"])
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nodes"], "a setting must be written key=value, got 'nodes'"),
        (["--seeds", "0"], "--seeds must be a whole number of at least 1, got 0"),
        (["--jobs", "0"], "--jobs must be a whole number of at least 1, got 0"),
    ],
)
def test_what_cannot_be_understood_is_said_before_anything_begins(command, words, said):
    assert said in refused(command, *words, "--out", "not_made")
