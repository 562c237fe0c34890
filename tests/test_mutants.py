"""The report on mutants: what it compares, and that its reasons are about code that is there."""

from __future__ import annotations

import ast
from pathlib import Path

import mutants
import pytest

ROOT = Path(__file__).parent.parent

MUTATED = """
class World:
    def xǁWorldǁlife__mutmut_orig(self, value):
        if value < 0:
            raise ValueError(f"life must be positive, got {value}")
        return value + 1

    def xǁWorldǁlife__mutmut_1(self, value):
        if value <= 0:
            raise ValueError(f"life must be positive, got {value}")
        return value + 1

    def xǁWorldǁlife__mutmut_2(self, value):
        if value < 0:
            raise ValueError(f"LIFE MUST BE POSITIVE, GOT {value}")
        return value + 1

    def xǁWorldǁlife__mutmut_3(self, value):
        if value < 0:
            raise ValueError(None)
        return value + 1
"""
CODES = {1: 0, 2: 0, 3: 1}


@pytest.fixture
def folder(tmp_path):
    """What mutmut leaves behind."""
    names = ", ".join(f'"swarm.world.xǁWorldǁlife__mutmut_{i}": {code}' for i, code in CODES.items())
    (tmp_path / "world.py").write_text(MUTATED, encoding="utf-8")
    (tmp_path / "world.py.meta").write_text(f'{{"exit_code_by_key": {{{names}}}}}', encoding="utf-8")
    return tmp_path


def test_a_mutant_is_told_by_its_function_and_the_lines_that_change(folder):
    first, second, third = mutants.mutants_of(folder)
    assert (first.module, first.function) == ("swarm.world", "World.life")
    assert (first.was, first.becomes) == ("if value < 0:", "if value <= 0:")
    assert [mutant.wording for mutant in (first, second, third)] == [False, True, False]


def test_a_survivor_without_a_reason_fails_and_one_with_a_reason_does_not(folder, monkeypatch, capsys):
    monkeypatch.setattr(mutants, "REASONS", folder / "none.toml")
    assert mutants.main(folder, None) == 1
    said = capsys.readouterr()
    assert "unexplained: swarm.world.World.life\n  - if value < 0:\n  + if value <= 0:" in said.err
    assert "| `all` | 3 | 1 | 0 | 2 | 0 |" in said.out
    reason = 'function = "swarm.world.World.life"\nkind = "boundary"\nwhy = "exactly 0"\n'
    reason += 'changes = [["if value < 0:", "if value <= 0:"]]\n'
    (folder / "some.toml").write_text(f"[[reason]]\n{reason}", encoding="utf-8")
    monkeypatch.setattr(mutants, "REASONS", folder / "some.toml")
    page = folder / "page.md"
    page.write_text(f"# Page\n\n{mutants.BEGIN}\nold\n", encoding="utf-8")
    assert mutants.main(folder, page) == 0
    assert "old" not in page.read_text(encoding="utf-8")
    assert "| `swarm.world.World.life` | boundary | 1 | exactly 0 |" in page.read_text(encoding="utf-8")


def test_every_reason_is_about_code_that_is_there():
    for function, was, _ in mutants.reasons():
        module, _, name = function.partition(".")[2].partition(".")
        source = (ROOT / f"swarm/{module}.py").read_text(encoding="utf-8")
        names = {node.name for node in ast.walk(ast.parse(source)) if hasattr(node, "name")}
        assert set(name.split(".")) <= names, function
        lines = {line.strip() for line in source.splitlines()}
        assert set(was.split(" ⏎ ")) <= lines, f"{function}: {was}"
