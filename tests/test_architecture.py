"""The house keeps its plan: who may import whom, and what `import swarm` loads."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SWARM = sorted((ROOT / "swarm").glob("*.py"))

# Imports run one way: a module looks only at rooms above its own.
FLOORS = [
    {"checks", "arrays", "pieces", "streams", "files"},
    {"fields", "flows", "splines"},
    {"grids", "swimmer", "perception"},
    {"gridded"},
    {"parameter_checks"},
    {"parameters"},
    {"intervals"},
    {"world"},
    {"starts"},
    {"optimal_problem"},
    {"optimal_still", "optimal_vortices"},
    {"optimal_tables"},
    {"optimal_files"},
    {"strategies", "optimal", "network", "policy_files"},
    {"population", "statistics", "results", "provenance"},
]
FLOOR = {room: level for level, rooms in enumerate(FLOORS) for room in rooms}
HIGHEST = len(FLOORS)  # figures, faces and whatever else shows or serves the world

HEAVY = ("torch", "tensordict", "torchrl", "jax")
# Loaded by a face of their own only.
FACES_OF = {"torchrl_env": ("torch", "tensordict", "torchrl")}


def imports_of(path, *, at_import):
    """Modules that a file imports; only those that importing it imports, or all."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    pending, found = list(tree.body), set()
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} imports relatively"
            found |= {node.module} | {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)) and at_import:
            continue
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING" and at_import:
            pending += node.orelse
        else:
            pending += ast.iter_child_nodes(node)
    return found


@pytest.mark.parametrize("path", SWARM, ids=lambda path: path.stem)
def test_the_world_imports_no_trainers(path):
    assert not {name for name in imports_of(path, at_import=False) if name.split(".")[0] == "trainers"}


@pytest.mark.parametrize("path", SWARM, ids=lambda path: path.stem)
def test_the_world_imports_no_torch_or_jax_but_in_its_faces(path):
    allowed = FACES_OF.get(path.stem, ())
    found = {name.split(".")[0] for name in imports_of(path, at_import=True)}
    assert not found & set(HEAVY) - set(allowed)


@pytest.mark.parametrize(
    "path", [path for path in SWARM if path.stem != "__init__"], ids=lambda path: path.stem
)
def test_imports_run_one_way(path):
    floor = FLOOR.get(path.stem, HIGHEST)
    names = {name.split(".")[1] for name in imports_of(path, at_import=True) if name.startswith("swarm.")}
    above = {
        name
        for name in names
        if FLOOR.get(name, HIGHEST if (ROOT / f"swarm/{name}.py").exists() else -1) > floor
    }
    assert not above, f"swarm/{path.name} imports {above}, which come after it"


def test_every_package_that_is_imported_is_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = project["dependencies"] + [
        name for extra in project["optional-dependencies"].values() for name in extra
    ]
    declared = {re.match(r"[\w-]+", line)[0].lower() for line in wanted}
    known = packages_distributions()
    for path in [*SWARM, *(ROOT / "trainers").glob("*.py")]:
        for name in {name.split(".")[0] for name in imports_of(path, at_import=False)}:
            if name in sys.stdlib_module_names or name in ("swarm", "trainers"):
                continue
            names = {distribution.lower() for distribution in known.get(name, [name])}
            assert names & declared, f"{path.name} imports {name}, which pyproject.toml does not ask for"


def loaded_by(statement):
    code = f"import sys; {statement}; print(*sys.modules)"
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return {name.split(".")[0] for name in run.stdout.split()}


def test_importing_swarm_loads_nothing_heavy():
    assert not loaded_by("import swarm") & {
        *HEAVY,
        "scipy",
        "matplotlib",
        "xarray",
        "pandas",
        "pygame",
        "h5py",
        "trainers",
    }


def test_a_world_runs_without_scipy_or_xarray():
    statement = (
        "import numpy as np, swarm; w = swarm.World(flow='taylor_green', sense_flow=True); "
        "s = w.start(np.zeros((2, 2)), np.zeros(2), np.zeros((2, 4), int)); w.step(s, np.ones(2, int))"
    )
    assert not loaded_by(statement) & {*HEAVY, "scipy", "matplotlib", "xarray", "pandas"}
