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


def test_text_that_a_spreadsheet_would_compute_is_text_and_all_else_stays():
    for text in ("=1+1", "+cmd|x", "@SUM(A1)", "-2+3", "\tx"):
        assert Table(["name"], [[text]]).as_csv().splitlines()[1].strip('"') == f"'{text}"
    for text in ("-0.5", "+1e3", "a=b", "−1", ""):
        assert Table(["name", "n"], [[text, -1.5]]).as_csv() == f"name,n\n{text},-1.5\n"


def test_a_printed_table_takes_names_literally(capsys):
    heading, *names = words = ["[b]run[/b]", "[red]x[/red]", ":smile:", "[/nothing]"]
    print_table([heading], [[name] for name in names])
    assert [line.strip() for line in capsys.readouterr().out.splitlines()] == words


WIDE = ["policy", "gain", "95% interval of the mean", "over greedy", "verdict", "what was found"]
LONG = "a sentence of many words, some of which_are_much_longer_than_a_narrow_column_is_wide, and so on"
ROWS = [
    ["zoo:linear_n4", "29.12 ± 0.31", "29.01 … 29.23", "+10.12", "reproduced", LONG],
    ["runs/" + "long-name-" * 6, "-19.00 ± 10.31", "–", "1.2e-05", "FAILED", ""],
]


@pytest.mark.parametrize("width", [30, 40, 60, 80, 200])
def test_a_printed_table_cuts_nothing_however_narrow(capsys, monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    print_table(WIDE, ROWS)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= width
    for number in (each for row in ROWS for each in row[1:5]):
        assert any(number in line for line in lines)
    letters = "".join("".join(lines).split())
    assert all(letters.count(letter) >= "".join(LONG.split()).count(letter) for letter in set(LONG) - {" "})
    assert width < 40 or any(line.startswith("zoo:linear_n4") for line in lines)
    assert "…" in ROWS[0][2]
    assert sum(line.count("…") for line in lines) == 1  # that of the interval


def test_a_printed_table_is_of_80_columns_where_there_is_no_terminal(capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    print_table(WIDE, ROWS)
    assert 70 < max(map(len, capsys.readouterr().out.splitlines())) <= 80
