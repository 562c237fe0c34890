"""The wheel: installed elsewhere, it finds its settings and its policies."""

import subprocess
import sys
import zipfile
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
