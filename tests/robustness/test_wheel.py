"""The wheel: installed elsewhere, it finds its settings and its policies; alone, it is the environment."""

import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """A folder into which the built wheel has been unpacked, as an installer does."""
    pytest.importorskip("hatchling", reason="the build backend is not installed")
    built = tmp_path_factory.mktemp("built")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(built)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=120)
    (wheel,) = built.glob("chemoswarm-*.whl")
    folder = tmp_path_factory.mktemp("site")
    zipfile.ZipFile(wheel).extractall(folder)
    return folder


def run(elsewhere, code):
    """Output of a program that sees the unpacked wheel and not the source tree."""
    program = f"import sys; sys.path.insert(0, {str(elsewhere)!r}); {code}"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=elsewhere,
        check=False,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_an_installed_wheel_finds_its_settings(elsewhere):
    code = "from trainers.settings import composition"
    code += "; print(composition.config_folder(), *composition.names_of('experiment'))"
    folder, *experiments = run(elsewhere, code).split()
    assert Path(folder) == elsewhere / "trainers" / "configs"
    assert "linear_n4" in experiments
    words = "['experiment=linear_n8']"
    code = "from trainers.settings.composition import settings_from"
    code += f"; print(settings_from({words}).world['n_records'])"
    assert run(elsewhere, code).strip() == "8"


def test_an_installed_wheel_holds_the_shipped_policies(elsewhere):
    code = "import swarm; print(swarm.__file__); print(swarm.load_policy('zoo:linear_n4').card['experiment'])"
    place, experiment = run(elsewhere, code).split()
    assert Path(place).is_relative_to(elsewhere)
    assert experiment == "linear_n4"


def test_an_installed_wheel_holds_the_page_of_a_population(elsewhere):
    assert (elsewhere / "swarm" / "figures" / "page" / "assets" / "three.min.js").is_file()


def test_its_name_imports_and_is_the_same_package(elsewhere):
    code = "import chemoswarm, chemoswarm.envs.pettingzoo as outer, swarm.envs.pettingzoo as inner"
    code += "; from chemoswarm import World, sperm_swarm_v0; print(outer is inner, outer.__spec__.name)"
    code += "; import swarm; print(World is swarm.World, sperm_swarm_v0 is swarm.sperm_swarm_v0)"
    assert run(elsewhere, code).split() == ["True", "swarm.envs.pettingzoo", "True", "True"]
    missing = "import chemoswarm\ntry: import chemoswarm.nothing\nexcept ModuleNotFoundError as e: print(e)"
    assert "swarm.nothing" in run(elsewhere, f"exec({missing!r})")


def needed(requirements):
    """Distributions that a plain install brings, with all that they ask for."""
    found = {}
    while requirements:
        name, _, condition = requirements.pop().partition(";")
        name = re.match(r"[\w.-]+", name.strip())[0]
        if name in found or "extra" in condition or "python_version" in condition:
            continue
        found[name] = metadata.distribution(name)
        requirements += found[name].requires or []
    return found.values()


@pytest.fixture(scope="module")
def plain(elsewhere, tmp_path_factory):
    """Runs a program that sees the unpacked wheel, what a plain install brings with it, and nothing else."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    folder, size = tmp_path_factory.mktemp("plain"), 0
    for distribution in needed(project["dependencies"]):
        for file in distribution.files:
            top, place = file.parts[0], Path(distribution.locate_file(file))
            size += place.stat().st_size if place.is_file() else 0
            if top != ".." and not (folder / top).exists():
                (folder / top).symlink_to(distribution.locate_file(top))

    def program(code, *arguments):
        paths = f"import sys; sys.path[:0] = [{str(elsewhere)!r}, {str(folder)!r}]; {code}"
        command = [sys.executable, "-I", "-S", "-c", paths, *arguments]
        return subprocess.run(
            command, cwd=elsewhere, check=False, capture_output=True, text=True, timeout=120
        )

    program.size = size + sum(path.stat().st_size for path in elsewhere.rglob("*") if path.is_file())
    return program


def test_a_plain_install_is_small(plain):
    assert 20e6 < plain.size < 200e6 - 30e6, "pip and setuptools take up to 30 MB"


PLAIN = """
import numpy as np, swarm, swarm.envs.gymnasium
for name in swarm.__all__:
    try: getattr(swarm, name)
    except ModuleNotFoundError as error: print(f"{name}: {error}")
policy, env = swarm.load_policy("zoo:linear_n4"), swarm.parallel_env(3, life=4.0, medium=swarm.Medium())
seen, _ = env.reset(seed=0)
while env.agents: seen, *_ = env.step({agent: policy(each) for agent, each in seen.items()})
grid = np.ones((9, 9))
for ask in (
    lambda: env.medium,
    lambda: swarm.GriddedField({"c": grid, "x": np.arange(9.0), "y": np.arange(9.0)}, edges="clamped"),
    lambda: __import__("swarm.figures"),
    lambda: __import__("swarm.torchrl_env"),
    lambda: __import__("trainers.algorithms"),
    lambda: __import__("swarm.envs.jax"),
    lambda: __import__("swarm.envs.benchmarl"),
):
    try: ask(); print("?")
    except ModuleNotFoundError as error: print(f": {error}")
"""


def test_a_plain_install_lives_and_names_the_extra_for_the_rest(plain):
    done = plain(f"exec({PLAIN!r})")
    assert done.returncode == 0, done.stderr
    told = [line.split(": ", 1) for line in done.stdout.splitlines()]
    lacks = [name for name, _ in told if name]
    assert lacks == ["Optimal", "contest", "limit", "population_test"]
    pattern = r".+ needs? \w+: pip install 'chemoswarm\[(\w+)\]'"
    extras = [re.fullmatch(pattern, line)[1] for _, line in told]
    assert extras == ["results"] * 7 + ["torchrl", "train", "jax", "benchmarl"]


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--version"], 0, "chemoswarm 0.1.0\n"),
        (["train", "seed=1"], 2, "swarm: commands need hydra: pip install 'chemoswarm[train]'\n"),
        (["check"], 2, "swarm: commands need hydra: pip install 'chemoswarm[results]'\n"),
        ([], 2, "swarm: commands need hydra: pip install 'chemoswarm[results]'\n"),
    ],
)
def test_the_command_of_a_plain_install_is_a_line(plain, words, code, said):
    done = plain("from trainers.command import main; main()", *words)
    assert (done.returncode, done.stdout + done.stderr) == (code, said)
