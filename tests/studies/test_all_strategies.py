"""The table of all strategies in miniature, through everything that a whole one goes through."""

import csv
import re

import numpy as np
import pytest

from swarm import World
from tests.studies.test_minimal import WORDS, carried_out
from trainers.studies.strategies import report
from trainers.studies.strategies.measurements import ANY, LIMIT, Lived, WorldFindings
from trainers.studies.strategies.plan import DQN, OPTIMAL, PPO, STRATEGIES, StrategiesPlan
from trainers.studies.strategies.report import STUDY

pytest.importorskip("cma")

TINY = StrategiesPlan(
    n_seeds=2, words=WORDS, workers=0, worlds=("linear_n4", "radial"), generations=1, cells=4, egg_cells=3
)


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return carried_out(STUDY, TINY, tmp_path_factory.mktemp("strategies"))


def test_every_strategy_lives_in_every_world_or_it_is_said_why_not(out):
    with (out / "results.csv").open() as file:
        rows = {(row["world"], row["strategy"]): row for row in csv.DictReader(file)}
    assert {strategy for _, strategy in rows} == set(STRATEGIES)
    missing = {key: row["why not"] for key, row in rows.items() if not row["gain"]}
    assert missing.keys() == {("radial", PPO), ("radial", OPTIMAL)}
    assert "one speed" in missing["radial", PPO]
    seeds = [rows["linear_n4", each]["seeds"] for each in ("greedy", "minimal", DQN, PPO)]
    assert seeds == ["1", "2", "2", "2"]
    steady = {strategy: row for (world, strategy), row in rows.items() if world == "linear_n4"}
    assert float(steady[OPTIMAL]["of the limit"]) == pytest.approx(1, abs=2e-3)
    assert all(float(row["of the limit"]) < 1.002 for row in steady.values())
    assert float(steady[PPO]["of its own limit"]) < float(steady[PPO]["of the limit"])
    assert all(rows["radial", each]["arrived"] for each in ("greedy", "minimal", DQN))


def test_the_report_is_published_with_its_figure_and_its_reasons(out):
    published = out.with_name("published")
    told = (published / "report.md").read_text()
    assert {path: (published / path).stat().st_size > 1000 for path in re.findall(r"!\[.*?\]\((.*?)\)", told)}
    assert "any curvature in radial: action='continuous' must go with one speed" in told
    assert not (published / "runs").exists()


def test_fractions_are_of_each_cells_own_limit_and_times_of_all_or_none():
    most = np.array([10.0, 20.0, 30.0])
    lived = {
        "same": Lived(0.5 * most[None], np.ones((1, 3), bool), np.array([[4.0, 5.0, 6.0]])),
        "some": Lived(most[None], np.array([[True, False, True]]), np.zeros((1, 3))),
    }
    found = WorldFindings(World(field="radial"), lived, most, None, {})
    fraction = found.fraction("same")
    assert fraction.value == 0.5
    np.testing.assert_allclose(fraction.interval, 0.5, atol=1e-12)  # the spread of cells is that of the limit
    assert found.fraction("same", any_curvature=True) is None
    assert found.time_to_egg("same").value == 5
    assert found.time_to_egg("some") is None


def test_dashes_of_the_same_reason_are_told_once():
    one = WorldFindings(World(), {}, None, None, dict.fromkeys((*STRATEGIES, LIMIT, ANY), "too dark"))
    told = report.text(TINY, {"a": one, "b": one})
    assert told.count("too dark") == len(STRATEGIES) + 1  # all but the optimal, and both limits
    assert "- greedy in a, b: too dark." in told


def test_a_world_without_a_limit_shows_what_there_is_instead():
    lived = {"greedy": Lived(np.full((1, 3), 4.0), np.array([[True, False, True]]), np.zeros((1, 3)))}
    found = {name: WorldFindings(World(field=name), lived, None, None, {}) for name in ("radial", "linear")}
    table = report.overview(found)
    assert list(table.headings) == ["strategy", "radial, arrived", "linear, gain"]
    row = dict(zip(table.headings, table.texts[list(STRATEGIES).index("greedy")], strict=True))
    assert row["radial, arrived"].startswith("66.7% ± ")
    assert row["linear, gain"] == "4.00 ± 0.00"
