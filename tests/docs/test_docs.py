"""The documentation does what it says: every Python block runs, every command and its options are there.

The blocks of a page share their names and a folder of their own, from top to bottom. A page in `IN_ORDER`
has its `swarm` commands run between its Python blocks, shortened by the words in `SHORT`.
"""

import inspect
import re
import runpy
import shlex
import textwrap
import tomllib
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import pytest
import typer

from swarm.policies.network import zoo_names

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
IN_ORDER = ("tutorial.md",)
SHORT = {
    "train": "learning.epochs=1 learning.n_swimmers=4 world.life=8 compile=never "
    "validation.cells=2 validation.life=8",
    "evaluate": "--cells 3 --life 8",
    "watch": "--cells 3 --life 2",
}
# Modules of `swarm` that nobody needs to call; all others are on the API page.


class Block(NamedTuple):
    """Code of a page."""

    language: str
    line: int  # of its first line
    code: str


def blocks_of(page):
    text = page.read_text(encoding="utf-8")
    found = []
    for match in re.finditer(r"^( *)```(\w+)[^\n]*\n(.*?)^\1```$", text, re.MULTILINE | re.DOTALL):
        line = text[: match.start(3)].count("\n") + 1
        found.append(Block(match[2], line, textwrap.dedent(match[3])))
    return found


def name_of(page):
    return page.relative_to(ROOT).as_posix()


def commands_of(page):
    """Words of every command in the page's shell blocks, without comments and environment folders."""
    for block in blocks_of(page):
        if block.language in ("sh", "bash", "console"):
            yield from words_of(block)


def words_of(block):
    for line in block.code.replace("\\\n", "").splitlines():
        if words := shlex.split(line, comments=True):
            yield [words[0].removeprefix(".venv/bin/"), *words[1:]]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(mpl, "rcParams", mpl.rcParams.copy())
    mpl.use("Agg")
    return tmp_path


def with_python(pages):
    return [page for page in pages if any(block.language == "python" for block in blocks_of(page))]


@pytest.mark.parametrize("page", with_python(PAGES), ids=name_of)
def test_python_blocks_run(page, folder):
    names = {}
    for block in blocks_of(page):
        if block.language == "python":
            # the empty lines make a traceback name the page's own
            exec(compile("\n" * (block.line - 1) + block.code, str(page), "exec"), names)
        elif block.language == "sh" and page.name in IN_ORDER:
            for line in block.code.splitlines():
                run_shortened(shlex.split(line, comments=True))
        elif block.language == "shell":  # of files that the page has made
            for words in words_of(block):
                CHECKS[words[0]](words[1:])


def test_one_s_own_field_is_drawn_in_forty_lines_and_functions_run_on_every_library(xp):
    blocks = [
        block.code for block in blocks_of(DOCS / "how-to" / "own_field.md") if block.language == "python"
    ]
    assert sum(bool(line.strip()) for block in blocks[:3] for line in block.splitlines()) <= 40
    names = {}
    exec(blocks[3].split("world =")[0], names)
    for name in ("ripples", "saddle"):
        values = names[name](xp.ones((4, 2), dtype=xp.float32))
        assert (values.shape[0], values.dtype) == (4, xp.float32)


def run_shortened(words):
    if words[0] != "swarm":
        return
    from typer.testing import CliRunner

    from trainers.cli import app

    shorter = (
        "" if words[2].endswith(".nc") else SHORT.get(words[1], "")
    )  # what is stored is as long as it is
    result = CliRunner().invoke(app, [*words[1:], *shorter.split()])
    assert result.exit_code == 0, result.output[-500:]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_their_options_are_there(page):
    for words in commands_of(page):
        check = CHECKS.get(words[0])
        assert check is not None, f"no check of {words[0]!r} is known"
        check(words[1:])


def check_swarm(words):
    from trainers.cli import app

    command = typer.main.get_command(app).commands[words[0]]
    if words[0] == "train":
        return check_train(words[1:])
    command.make_context(words[0], list(words[1:]))  # raises where an option is unknown
    for word in words:
        if word.startswith("zoo:"):
            assert word.removeprefix("zoo:") in zoo_names()
    return None


def check_train(words):
    """The settings are valid, in every combination of a sweep."""
    from trainers.jobs.sweep import expanded
    from trainers.settings.composition import settings_from

    flags = {"-m", "--multirun", "--show"}
    own = [
        word for word in words if word not in flags and not word.startswith(("hydra", "launcher", "resume="))
    ]
    assert not [word for word in own if word.startswith("-")]
    for combination in expanded(own) if {"-m", "--multirun"} & set(words) else [own]:
        settings_from(combination)


def check_make(words):
    goals = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert {word for word in words if "=" not in word} <= set(goals)


def check_pip(words):
    assert words[0] == "install"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for extras in re.findall(r"\.\[([\w,]+)\]", " ".join(words)):
        assert set(extras.split(",")) <= set(project["optional-dependencies"])


def check_python(words):
    if words[0] == "-m":
        from importlib.util import find_spec

        assert find_spec(words[1])
    elif words[0] != "-c":
        assert (ROOT / words[0]).is_file()


CHECKS = {
    "swarm": check_swarm,
    "make": check_make,
    "pip": check_pip,
    "python": check_python,
    **dict.fromkeys(("pytest", "mkdocs", "git", "cd", "export", "."), lambda words: None),
}


def test_arguments_on_the_environment_card_are_those_of_the_environment():
    from swarm.envs.pettingzoo import parallel_env

    text = (DOCS / "environment.md").read_text(encoding="utf-8")
    section = text[text.index("## Arguments") : text.index("## Other faces")]
    listed = dict(re.findall(r"^\| `(\w+)` \| `([^`]+)` \|", section, re.MULTILINE))
    actual = inspect.signature(parallel_env).parameters
    assert list(listed) == list(actual)
    assert {name: eval(value) for name, value in listed.items()} == {
        name: parameter.default for name, parameter in actual.items()
    }


def test_bounds_on_the_environment_card_are_those_of_the_spaces():
    import swarm

    text = (DOCS / "environment.md").read_text(encoding="utf-8")
    still, flow = swarm.World(), swarm.World(flow="taylor_green", sense_flow=True)
    for world in (still, flow):
        for bound in world.observation_bounds[: world.features]:
            assert f"±{bound:.3f}" in text


def test_everything_public_is_on_the_api_page():
    import swarm

    text = (DOCS / "api.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"^::: ([\w.]+)$", text, re.MULTILINE))
    public = [getattr(swarm, name) for name in swarm.__all__ if name != "__version__"]
    assert not {thing.__module__ for thing in public} - shown


def test_every_equation_of_the_paper_is_on_the_model_page():
    text = (DOCS / "model.md").read_text(encoding="utf-8")
    cited = {
        int(number) for group in re.findall(r"\(((?:\d+, )*\d+)\)", text) for number in group.split(", ")
    }
    assert cited >= set(range(1, 20))


def test_links_within_the_readme_lead_somewhere():
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", (ROOT / "README.md").read_text(encoding="utf-8")):
        assert re.match("https?://", target) or (ROOT / target).exists(), target


def test_site_builds_without_a_warning(tmp_path, monkeypatch):
    pytest.importorskip("mkdocs", reason="mkdocs is not installed: `make install` does")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    monkeypatch.chdir(ROOT)
    build(load_config(str(ROOT / "mkdocs.yml"), strict=True, site_dir=str(tmp_path / "site")))
    assert (tmp_path / "site" / "api" / "index.html").stat().st_size > 100_000


def test_cells_of_wide_tables_bear_their_headings_so_that_narrow_screens_can_stack_them():
    pytest.importorskip("mkdocs")
    import markdown

    stacked = runpy.run_path(str(DOCS / "assets" / "tables.py"))["StackedTables"]
    long = "a_name_that_is_longer_than_a_narrow_page_is_wide_and_goes_on"
    text = f"| one | `two` |\n|---|--:|\n| x | `{long}` |\n\n| a | b |\n|---|--:|\n| 1 | 2 ± 1e-05 |\n"
    extensions = ["tables", "pymdownx.inlinehilite", stacked()]
    wide, narrow = markdown.markdown(text, extensions=extensions).split("</table>")[:2]
    assert "data-wide" in wide
    assert 'data-label="two"' in wide
    assert "data-wide" not in narrow
    assert "2\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}1e\N{NON-BREAKING HYPHEN}05" in narrow
