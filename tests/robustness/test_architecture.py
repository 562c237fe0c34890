"""The house keeps its plan: no circles, few rooms, short files, and what `import swarm` loads.

Who may import whom is stated in `pyproject.toml` and held by import-linter (`make test`).
"""

import ast
import re
import runpy
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import swarm

ROOT = Path(__file__).parents[2]
PACKAGES = ("chemoswarm", "swarm", "trainers")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in SOURCES
}
ROOMS = sorted({path.parent for path in SOURCES})
HEAVY = ("torch", "tensordict", "torchrl", "jax")
MOST_LINES, MOST_OF_A_FUNCTION, MOST_IN_A_ROOM = 330, 45, 10


def imports_of(path):
    """All modules that a file imports anywhere: at its top, in functions, or for types only."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} imports relatively"
            found |= {
                f"{node.module}.{name.name}" if f"{node.module}.{name.name}" in MODULES else node.module
                for name in node.names
            }
    return found


def test_there_is_something_to_look_at():
    assert len(SOURCES) > 60
    assert len(ROOMS) > 10


def test_no_module_imports_itself_on_any_way():
    graph = {name: imports_of(path) & MODULES.keys() for name, path in MODULES.items()}
    done, way = set(), []

    def visit(name):
        assert name not in way, " imports ".join([*way[way.index(name) :], name])
        if name in done:
            return
        way.append(name)
        for other in sorted(graph[name]):
            visit(other)
        done.add(way.pop())

    for name in graph:
        visit(name)


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: str(room.relative_to(ROOT)))
def test_a_room_holds_few_things(room):
    modules = [path for path in room.glob("*.py") if path.name != "__init__.py"]
    rooms = [path for path in ROOMS if path.parent == room]
    assert len(modules) + len(rooms) <= MOST_IN_A_ROOM


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_and_functions_are_short(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            lines = body[-1].end_lineno - body[0].lineno + 1 if body else 0
            assert lines <= MOST_OF_A_FUNCTION, f"{node.name} has {lines} lines"


def test_every_package_that_is_imported_is_declared_and_the_version_is_the_distribution_s():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert swarm.__version__ == project["version"]
    wanted = project["dependencies"] + [
        name for extra in project["optional-dependencies"].values() for name in extra
    ]
    declared = {re.match(r"[\w-]+", line)[0].lower() for line in wanted}
    known = packages_distributions()
    for path in SOURCES:
        for name in {name.split(".")[0] for name in imports_of(path)}:
            if name in sys.stdlib_module_names or name in PACKAGES:
                continue
            names = {each.lower().replace("_", "-") for each in known.get(name, [name])}
            assert names & declared, f"{path.name} imports {name}, which pyproject.toml does not ask for"


def fresh(code):
    """What a new interpreter prints."""
    command = [sys.executable, "-W", "error", "-c", code]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def loaded_by(statement):
    return {name.split(".")[0] for name in fresh(f"import sys; {statement}; print(*sys.modules)").split()}


def test_importing_swarm_loads_nothing_heavy():
    heavy = {*HEAVY, "scipy", "matplotlib", "xarray", "pandas", "pygame", "h5py", "trainers"}
    assert not loaded_by("import swarm") & heavy


def test_a_world_runs_without_scipy_or_xarray():
    statement = (
        "import numpy as np, swarm; w = swarm.World(flow='taylor_green', sense_flow=True); "
        "s = w.start(np.zeros((2, 2)), np.zeros(2), np.zeros((2, 4), int)); w.step(s, np.ones(2, int))"
    )
    assert not loaded_by(statement) & {*HEAVY, "scipy", "matplotlib", "xarray", "pandas"}


def seconds(imports):
    return float(
        fresh(f"from time import perf_counter as now; t = now(); import {imports}; print(now() - t)")
    )


def test_importing_swarm_takes_at_most_twice_as_long_as_what_it_stands_on():
    ratios = []
    for _ in range(8):  # by turns, so that what else the machine does falls on both
        foundation = seconds("numpy, gymnasium, pettingzoo")
        ratios.append(seconds("swarm") / foundation)
        if min(ratios) <= 1.6:
            break
    assert min(ratios) <= 2


def test_public_names_exist_and_the_heavy_ones_are_loaded_when_they_are_asked_for():
    assert list(swarm.__all__) == sorted(swarm.__all__)
    assert set(swarm.__all__) <= set(dir(swarm))
    assert {"World", "parallel_env", "population_test", "limit", "load_policy"} <= set(swarm.__all__)
    heavy = {name: f"swarm.{swarm._LAZY[name]}" for name in sorted(swarm._LAZY)}
    before, after = fresh(
        f"import sys, swarm; heavy = {heavy!r}\n"
        "print(*[module for module in heavy.values() if module in sys.modules])\n"
        "for name in swarm.__all__: getattr(swarm, name)\n"
        "print(*[name for name in heavy if heavy[name] in sys.modules and name in vars(swarm)])"
    ).splitlines()
    assert (before, after.split()) == ("", list(heavy))
    with pytest.raises(AttributeError, match="module 'swarm' has no attribute 'swimmer_zoo'"):
        _ = swarm.swimmer_zoo


def test_the_picture_of_the_house_is_what_the_code_draws():
    drawn = runpy.run_path(str(ROOT / "docs" / "assets" / "architecture.py"))
    assert drawn["PICTURE"].read_text(encoding="utf-8") == drawn["picture"]()
