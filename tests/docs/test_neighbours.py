"""The table of other libraries: whole, and read off what pip and the programs said."""

from pathlib import Path

from tests.neighbours.__main__ import HEADINGS, NEIGHBOURS, reason, table

TABLE = Path(__file__).parents[2] / "docs" / "neighbours.txt"


def test_every_library_is_told_of_and_most_train():
    lines = [line for line in TABLE.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    rows = [[each.strip() for each in line.strip("|").split("|")] for line in lines]
    assert rows[0] == list(HEADINGS)
    assert [row[0] for row in rows[2:]] == list(NEIGHBOURS)
    trained = [row[0] for row in rows[2:] if not row[-1].startswith(("no:", "—"))]
    assert len(trained) >= 7
    programs = Path(__file__).parents[1] / "neighbours"
    names = {f"with_{name.lower().replace('-', '_')}.py" for name in trained}
    assert names <= {path.name for path in programs.glob("with_*.py")}


def test_pip_is_quoted_where_it_refuses():
    said = """ERROR: Cannot install a and b\nThe conflict is caused by:
    xuance 1.4.4 depends on numpy<2.0.0 and >=1.21.0
    moviepy 1.0.3 depends on numpy
    chemoswarm 0.1.0 depends on numpy>=2.1\n\nTo fix this you could try to: loosen"""
    quoted = "xuance 1.4.4 depends on numpy<2.0.0 and >=1.21.0; chemoswarm 0.1.0 depends on numpy>=2.1"
    assert reason(said) == quoted
    assert reason("Traceback\n  File x\nValueError: no\nhint") == "ValueError: no"
    assert "| a/b |" in table([dict.fromkeys(HEADINGS, "a|b")], "0.1.0")
