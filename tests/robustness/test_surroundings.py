"""Whatever a user's terminal, folders and settings are: the work is done, or refused in a line before it."""

import io
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import swarm
from swarm._support import files, terminal
from swarm.population.results import ResultsError, load_population
from trainers.training import run_folder as runs

ROOT = Path(__file__).parents[2]
SHORT = [
    *("learning.epochs=1", "learning.n_swimmers=2", "learning.batch_size=4", "learning.buffer_size=50"),
    *("world.life=2", "validation.life=2", "validation.cells=2", "tensorboard=false", "hydra.run.dir=run"),
]
COMMAND = "from trainers.command import main; main()"


def process(code, *words, **options):
    """A Python process in the current folder."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | options.pop("env", {})
    return subprocess.run([sys.executable, "-c", code, *words], env=environment, text=True, **options)


def dead_pipe():
    reader, writer = os.pipe()
    os.close(reader)
    return os.fdopen(writer, "w")


def closed():
    stream = open(os.devnull, "w")  # noqa: SIM115
    stream.close()
    return stream


STREAMS = {
    "full": lambda: Path("/dev/full").open("w"),  # noqa: SIM115
    "dead": dead_pipe,
    "closed": closed,
    "none": lambda: None,
}


@pytest.mark.parametrize("stream", STREAMS)
def test_work_goes_on_where_nobody_reads_how_far_it_is(monkeypatch, stream):
    broken = STREAMS[stream]()
    monkeypatch.setattr(sys, "stderr", broken)
    monkeypatch.setattr(terminal, "FIRST", 0.0)
    with terminal.Progress("work", 2) as bar:
        bar.show(1, text="[half]")
        bar.say("[done]")
    terminal.tell("told")
    with terminal.dispensable("figure.png"):
        raise ValueError
    told = terminal.Told(sys.stderr)
    assert told.write("text") == 4
    assert not told.isatty()
    if broken is not None:
        broken.close()


def test_progress_is_told_where_there_is_no_terminal_with_the_time_left(monkeypatch):
    monkeypatch.setattr(terminal, "FIRST", 0.05)
    monkeypatch.setattr(terminal, "QUIET", 0.05)
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert [terminal.duration(each) for each in (7.6, 100, 7290)] == ["8 s", "2 min", "2 h 2 min"]
    with terminal.Progress("work", 8, 1) as outer:
        time.sleep(0.12)  # nothing can be told of it
        outer.show(1.5)
        time.sleep(0.01)
        outer.show(2)
        with terminal.Progress("part", 1.0) as inner:
            inner.show(0.1)
            time.sleep(0.01)
            inner.show(0.25, text="a quarter")
            time.sleep(0.12)
        time.sleep(0.12)
    told = sys.stderr.getvalue().splitlines()
    kinds = [re.sub(r"\d+ s", "…", line) for line in told]
    expected = ["work 12%, …", "part a quarter 25%, …, about … left", "work 25%, …, about … left"]
    assert list(dict.fromkeys(kinds)) == expected


@pytest.mark.parametrize(
    "redirected",
    [
        ">/dev/full 2>&-",
        *(pytest.param(each, marks=pytest.mark.slow) for each in ("2>/dev/full", ">&- 2>&- <&-")),
    ],
)
def test_a_run_is_trained_whatever_its_streams(monkeypatch, tmp_path, redirected):
    monkeypatch.chdir(tmp_path)
    words = f'"{sys.executable}" -c "{COMMAND}" train {" ".join(SHORT)} {redirected}'
    done = subprocess.run(["sh", "-c", words], env=os.environ | {"PYTHONPATH": str(ROOT)}, timeout=300)
    assert done.returncode == 0
    assert runs.RunFolder(Path("run")).finished


def test_results_that_cannot_be_written_are_an_error_of_a_line():
    with open("/dev/full", "w") as full:
        done = process(COMMAND, "train", "--show", stdout=full, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (2, "swarm: No space left on device: standard output\n")


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("when", ["module", "command"])
def test_ctrl_c_is_a_line_while_modules_are_loaded_too(tmp_path, number, when):
    stop = f"import os, signal\nos.kill(os.getpid(), signal.{number})\n"
    (tmp_path / "loaded.py").write_text(stop)
    code = (
        "import sys, trainers.command as command\n"
        f"sys.path.insert(0, {str(tmp_path)!r})\n"
        f"def run(): {'import loaded' if when == 'module' else '; '.join(stop.splitlines())}\n"
        "command._run = run\n"
        "command.main()\n"
    )
    done = process(code, capture_output=True)
    assert (done.returncode, done.stderr) == (2, "swarm: stopped\n")


DRAWN = """
import hashlib, numpy as np
from swarm import figures
figures.save(figures.training({figures.plain("=a $x$ [b]"): figures.Curve([1, 2], [0.0, 1.0])}), "figure.png")
print(hashlib.sha256(open("figure.png", "rb").read()).hexdigest())
"""


@pytest.mark.slow
def test_figures_are_ours_whatever_the_user_s_matplotlib(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    dark = "text.usetex: true\nsavefig.transparent: true\naxes.facecolor: black\nfont.size: 30\n"
    settings = {
        "none": (b"", {}),
        "dark": (dark.encode(), {}),
        "latin-1": ("axes.facecolor: ü".encode("latin-1"), {}),
        "backend": (b"", {"MPLBACKEND": "nothing"}),
    }
    found = {}
    for name, (text, env) in settings.items():
        Path("matplotlibrc").write_bytes(text)
        done = process(DRAWN, env=env, capture_output=True)
        assert done.returncode == 0, done.stderr
        found[name] = done.stdout
    assert len(set(found.values())) == 1, found


def test_a_tilde_is_the_home_at_every_door(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    files.write_text("~/text", "text")
    assert files.read_bytes("~/text", at_most=9) == b"text"
    with files.new_folder("~/deep/new") as folder:
        (folder / "settings.yaml").write_text("{}")
    assert runs.is_run_folder(Path("~/deep/new"))
    assert runs.RunFolder.open(Path("~/deep/new"))[0].path == tmp_path / "deep/new"
    swarm.save_policy(swarm.load_policy("zoo:linear_n2"), "~/policy.safetensors")
    assert swarm.load_policy("~/policy.safetensors").card["n_records"] == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["deep", "policy.safetensors", "text"]


@pytest.mark.parametrize("name", ["\udcff", "r\udcc3\udcbcn", "l\udce9/x"])
def test_a_name_that_no_file_can_have_everywhere_is_refused(name):
    for door in (files.expanded, files.check_new_folder, runs.RunFolder, swarm.load_policy, load_population):
        with pytest.raises((ValueError, ResultsError), match="must be a path in UTF-8"):
            door(name)


def test_folders_that_are_asked_for_at_once_have_names_of_their_own(tmp_path):
    (tmp_path / "job").write_text("taken")
    (tmp_path / "job-3").symlink_to("nowhere")
    found = []
    threads = [
        threading.Thread(target=lambda: found.append(files.reserved(tmp_path / "job").name)) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == sorted(f"job-{number}" for number in (2, *range(4, 11)))
    with pytest.raises(OSError, match="job"):
        files.reserved(tmp_path / "job" / "inside")


ERRORS = {
    "of a full disk": lambda hidden: OSError(28, "No space left on device"),
    "of the system": lambda hidden: FileNotFoundError(2, "No such file", str(hidden / "x.nc")),
    "of a renaming": lambda hidden: OSError(39, "Directory not empty", str(hidden), None, "other"),
    "of a library": lambda hidden: OSError(f"unable to open {hidden}/.x.nc.0123456789ab"),
}


@pytest.mark.parametrize("error", ERRORS)
def test_messages_name_the_target_and_no_temporary_file(tmp_path, error):
    with pytest.raises(OSError, match=r"results") as raised, files.new_folder(tmp_path / "results") as hidden:
        raise ERRORS[error](hidden)
    assert hidden.name not in str(raised.value)
    assert "None" not in str(raised.value)


def test_of_two_who_make_the_same_folder_the_second_is_told_so(tmp_path):
    def make(*others):
        with files.new_folder(tmp_path / "results") as folder:
            (folder / "theirs").write_text("ours" if others else "theirs")
            for other in others:
                other()

    with pytest.raises(FileExistsError, match="results must be a new or an empty folder"):
        make(make)
    assert (tmp_path / "results/theirs").read_text() == "theirs"
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["theirs"]
    assert [path.name for path in tmp_path.iterdir()] == ["results"]
