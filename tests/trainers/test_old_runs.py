"""What version 0.1 left behind: its policy files and finished runs are read, its unfinished ones refused."""

import json
import re
import shutil
from pathlib import Path

import pytest

from swarm import load_policy
from swarm.policies.network import zoo_names
from tests.trainers.test_cli import elsewhere, refused, run  # noqa: F401
from tests.trainers.test_ppo import RUN

OLD = Path(__file__).parent / "v0_1"  # of commit 8468b4f, with the settings that are stored in it


@pytest.fixture(autouse=True)
def old(elsewhere):  # noqa: F811
    shutil.copytree(OLD, "old")


def names_in(table):
    return {line.split()[0] for line in table.splitlines() if "±" in line}


@pytest.mark.parametrize("policy", ["old", "old/policy.safetensors", "zoo:linear_n2"])
def test_its_policies_are_tested_and_watched_as_those_of_a_dqn(policy):
    code, out, _ = run("evaluate", policy, "--cells", 3, "--life", 4)
    assert (code, names_in(out)) == (0, {"dqn", "greedy", "swinging"})
    assert run("watch", policy, "--cells", 2, "--life", 2, "--out", "page.html")[0] == 0
    assert '"name": "dqn"' in Path("page.html").read_text()


def test_its_shipped_policies_are_of_a_dqn():
    assert {load_policy(f"zoo:{name}").algorithm for name in zoo_names()} == {"dqn"}


def test_its_runs_are_compared_with_one_another_and_with_those_of_now(monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    assert run("train", "algorithm=ppo", *RUN, "hydra.run.dir=of_now")[0] == 0
    shutil.copytree("old", "averaged")
    settings = Path("averaged/settings.yaml")
    settings.write_text(settings.read_text().replace("average_rate: 1.0", "average_rate: 0.5"))
    code, out, _ = run("compare", "old", "of_now", "averaged", "--cells", 2)
    assert code == 0
    assert {re.split(r"  +", line)[0] for line in out.splitlines()[1:]} == {
        "swarm dqn",
        "swarm ppo",
        "swarm average_rate=0.5 dqn",
    }
    assert "nothing is left to learn" in run("train", "resume=old")[1]


def test_an_unfinished_run_is_refused_and_stays_as_it_was():
    record = json.loads(Path("old/run.json").read_text())
    Path("old/run.json").write_text(json.dumps({name: record[name] for name in record if name != "finished"}))
    said = refused("train", "resume=old")
    assert said == "swarm: old was begun by version 0.1: go on with that version, or train anew"
