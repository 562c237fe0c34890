"""The table of promises: every test that it names is there."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
PAGE = (TESTS.parent / "docs" / "promises.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (.+?) \| `(test_\w+\.py)::(test_\w+)` \|$", PAGE, re.MULTILINE)


@cache
def functions(file):
    """Tests of a file, by name, with their source."""
    (path,) = TESTS.rglob(file)
    source = path.read_text(encoding="utf-8")
    found = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]
    return {node.name: "\n".join(map(ast.unparse, node.decorator_list)) for node in found}


@pytest.mark.parametrize(("promise", "file", "name"), ROWS, ids=[row[2] for row in ROWS])
def test_every_promise_is_held_by_a_test_that_is_there(promise, file, name):
    assert name in functions(file)
    assert ("slow" in functions(file)[name]) == ("slow" in promise)


def test_every_row_names_a_test():
    rows = [line for line in PAGE.splitlines() if line.startswith("| ") and line != "| promise | test |"]
    assert len(rows) == len(ROWS) >= 50
