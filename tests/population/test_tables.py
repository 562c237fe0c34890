"""Tables: one set of rows, written for people and for programs."""

import csv
import io

import numpy as np
import pytest

from swarm._support.tables import Table
from swarm._support.terminal import print_table


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


@pytest.mark.parametrize("text", ["=1+1", "+cmd|x", "@SUM(A1)", "-2+3", "\tx"])
def test_text_that_a_spreadsheet_would_compute_is_text(text):
    assert Table(["name"], [[text]]).as_csv().splitlines()[1].strip('"') == f"'{text}"


@pytest.mark.parametrize("text", ["-0.5", "+1e3", "a=b", "−1", ""])
def test_numbers_and_plain_text_stay_as_they_are(text):
    assert Table(["name", "n"], [[text, -1.5]]).as_csv() == f"name,n\n{text},-1.5\n"


def test_a_printed_table_takes_names_literally(capsys):
    print_table(["[b]run[/b]"], [["[red]x[/red]"], [":smile:"], ["[/nothing]"]])
    assert [line.strip() for line in capsys.readouterr().out.splitlines()] == [
        "[b]run[/b]",
        "[red]x[/red]",
        ":smile:",
        "[/nothing]",
    ]
