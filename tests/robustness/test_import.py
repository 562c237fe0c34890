"""`import swarm` is light, and offers what it promises."""

import subprocess
import sys
from pathlib import Path

import pytest

import swarm

ROOT = Path(__file__).parents[2]
LAZY = sorted(name for name in swarm.__all__ if name in swarm._LAZY)


def fresh(code):
    """What a new interpreter prints."""
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return run.stdout


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


def test_heavy_names_are_loaded_when_they_are_asked_for():
    modules = {name: f"swarm.{swarm._LAZY[name]}" for name in LAZY}
    loaded = fresh(
        f"import sys, swarm; modules = {modules!r}\n"
        "print(*[module for module in modules.values() if module in sys.modules])\n"
        "for name in modules: getattr(swarm, name)\n"
        "print(*[name for name in modules if modules[name] in sys.modules and name in vars(swarm)])"
    )
    before, after = loaded.splitlines()
    assert before == ""
    assert after.split() == LAZY


def test_all_names_are_listed_and_exist():
    assert list(swarm.__all__) == sorted(swarm.__all__)
    assert set(swarm.__all__) <= set(dir(swarm))
    assert {"World", "parallel_env", "population_test", "limit", "load_policy"} <= set(swarm.__all__)
    for name in swarm.__all__:
        assert getattr(swarm, name) is not None


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'swarm' has no attribute 'swimmer_zoo'"):
        _ = swarm.swimmer_zoo


def test_the_version_is_that_of_the_distribution():
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert swarm.__version__ == project["version"]
