"""Tables: one set of rows, written for people and for programs."""

import csv
import io

import numpy as np
import pytest

from swarm._support.tables import Table


def test_a_table_is_written_as_csv_and_as_markdown():
    rows = [
        {"policy": "dqn, κ", "gain": 29.123456789, "won": True, "limit": None},
        {"policy": "greedy", "gain": np.float64("nan"), "won": np.bool_(False), "limit": np.int64(30)},
    ]
    table = Table.of(rows)
    assert table.as_csv() == 'policy,gain,won,limit\n"dqn, κ",29.123456789,1,\ngreedy,,0,30\n'
    assert table.as_csv(digits=4).splitlines()[1] == '"dqn, κ",29.12,1,'
    assert list(csv.DictReader(io.StringIO(table.as_csv())))[1]["limit"] == "30"
    assert Table.of(rows, ["limit", "policy"]).as_markdown() == (
        "| limit | policy |\n| :-- | --: |\n| – | dqn, κ |\n| 30 | greedy |\n"
    )
    assert Table.of([]).as_csv() == ""
    with pytest.raises(ValueError, match="a row must have 2 values, got"):
        Table(["one", "two"], [["alone"]])
