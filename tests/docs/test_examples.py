"""The examples: short, built on what is public, and each of them runs.

Those for libraries that need an environment of their own run there; here their texts are checked.
"""

import ast
import importlib
import importlib.util
import math
import sys
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "examples"
FILES = sorted(FOLDER.glob("*.py"))
LONGEST = 67  # lines
OURS = ("swarm", "trainers")

pytestmark = [
    # as PettingZoo's wrapper in TorchRL says of every version but one
    pytest.mark.filterwarnings("ignore:PettingZoo in TorchRL is tested using version:UserWarning")
]


def load(name):
    """The example as a module; skips where the library that it is about is missing."""
    needed = {"jax_loop": "jax", "supersuit_vec": "supersuit", "stable_baselines3_dqn": "stable_baselines3"}
    needed |= {"cleanrl_loop": "torch", "torchrl_rollout": "torchrl"}
    needed |= {"rllib_ppo": "ray", "benchmarl_task": "benchmarl"}
    if name in needed:
        reason = f"{needed[name]} is not installed; examples/{name}.py says how"
        pytest.importorskip(needed[name], reason=reason, exc_type=ImportError)
    return load_as_it_is(name)


def load_as_it_is(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = sys.modules[name] = importlib.util.module_from_spec(spec)  # BenchMARL looks it up there
    spec.loader.exec_module(module)
    return module


def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def commands(name):
    """The shell commands of the example's docstring."""
    text = ast.get_docstring(tree(FOLDER / f"{name}.py"))
    starts = ("pip ", "python ", ".venv")
    return [line for line in text.splitlines() if line.startswith(starts)]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
class TestText:
    def test_is_short_and_says_how_it_is_run(self, path):
        assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST
        assert commands(path.stem)[-1].endswith(f"python examples/{path.name}")

    def test_is_named_in_the_documentation(self, path):
        pages = (FOLDER.parent / "docs").rglob("*.md")
        assert any(f"examples/{path.name}" in page.read_text(encoding="utf-8") for page in pages)

    def test_uses_nothing_private_and_only_modules_that_are_documented(self, path):
        api = (FOLDER.parent / "docs" / "api.md").read_text(encoding="utf-8")
        for node in ast.walk(tree(path)):
            modules, names = [], []
            if isinstance(node, ast.ImportFrom):
                assert not node.level, "examples stand alone"
                modules, names = [node.module], [alias.name for alias in node.names]
            elif isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.Attribute) and getattr(node.value, "id", None) != "self":
                names = [node.attr]
            names += [part for name in modules for part in name.split(".")]
            assert not [name for name in names if name.startswith("_") and not name.endswith("__")]
            for name in modules:
                assert name.split(".")[0] not in OURS or name in OURS or f"::: {name}\n" in api

    def test_what_it_takes_from_here_is_there(self, path):
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in OURS:
                reason = "what it is a face of is not installed"
                module = pytest.importorskip(node.module, reason=reason, exc_type=ImportError)
                assert all(hasattr(module, alias.name) for alias in node.names)
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in OURS:
                assert hasattr(importlib.import_module(node.value.id), node.attr)


def test_numpy_loop_lives_the_lives_of_a_population_test():
    import swarm

    example, world = load("numpy_loop"), swarm.World(life=30.0)
    gain = example.live(world, swarm.Greedy(), cells=5, seed=3)
    test = swarm.population_test(world, {}, cells=5, life=30.0, seed=3, limit=False)
    np.testing.assert_array_equal(gain, test["gain"].sel(policy="greedy").values)


def test_jax_loop_equals_numpy_to_rounding():
    assert load("jax_loop").main(worlds=2, cells=5, life=20.0) < 1e-12


def test_film_shows_every_decision(tmp_path):
    from PIL import Image

    import swarm

    path, policies = tmp_path / "swarm.gif", {"a": swarm.Greedy(), "b": swarm.Swinging()}
    load("film").main(path, cells=2, life=1.0, **policies)
    with Image.open(path) as film:
        assert film.n_frames == swarm.World(life=1.0).max_decisions
        assert film.size == (960, 360)


def test_cleanrl_loop_trains():
    gains = load("cleanrl_loop").main(episodes=2, cells=5, life=10.0)
    assert len(gains) == 2
    assert np.all(np.isfinite(gains))


def test_torchrl_rollouts_live_whole_lives():
    steered, drifting = load("torchrl_rollout").main(cells=3, life=20.0)
    assert steered > 0.5  # a quarter of what greedy gains
    assert math.isfinite(drifting)


def test_stable_baselines3_learns():
    assert math.isfinite(load("stable_baselines3_dqn").main(steps=1200, cells=5, life=10.0))


def test_supersuit_wraps_and_stacks_worlds():
    gains = load("supersuit_vec").main(chances=(0.0, 0.5), worlds=2, cells=4, life=40.0)
    assert gains[0.0] > gains[0.5]


@pytest.mark.filterwarnings("default")  # Ray and BenchMARL warn of themselves
class TestEnvironmentsOfTheirOwn:
    def test_rllib_learns(self):
        assert math.isfinite(load("rllib_ppo").main(iterations=1, cells=2, life=5.0, decisions=60))

    def test_benchmarl_learns(self, tmp_path):
        assert math.isfinite(
            load("benchmarl_task").main(iterations=1, cells=3, life=5.0, folder=tmp_path / "runs")
        )


@pytest.mark.skipif(importlib.util.find_spec("ray") is not None, reason="RLlib itself is there")
def test_rllib_is_given_the_parallel_environment(monkeypatch):
    from pettingzoo.test import parallel_api_test

    wrapper = mock.MagicMock(side_effect=lambda env: env)
    for name in ("", ".rllib.algorithms.ppo", ".rllib.env.wrappers.pettingzoo_env", ".tune.registry"):
        monkeypatch.setitem(sys.modules, f"ray{name}", mock.MagicMock())
    sys.modules["ray.rllib.env.wrappers.pettingzoo_env"].ParallelPettingZooEnv = wrapper
    env = load_as_it_is("rllib_ppo").make_env({"n_swimmers": 3, "life": 5.0})
    wrapper.assert_called_once_with(env)
    parallel_api_test(env, num_cycles=50)


def test_commands_of_the_examples_name_extras_and_pins_that_are_there():
    import tomllib

    project = tomllib.loads((FOLDER.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    pins = (FOLDER.parent / "constraints.txt").read_text(encoding="utf-8").splitlines()
    for path in FILES:
        for word in " ".join(commands(path.stem)).replace("'", "").split():
            if word.startswith(".["):
                assert set(word[2:-1].split(",")) <= set(project["optional-dependencies"])
            if "==" in word:
                assert word in pins
