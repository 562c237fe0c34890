"""The command line: what each command says to bad input, and what it does with good."""

import json
import os
import pickle
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import yaml
from typer.testing import CliRunner

import swarm
from swarm import Network, load_policy, save_policy
from swarm._support.tables import percent
from swarm.population.results import load_population, world_of
from tests.short_runs import short_settings, start, whole
from trainers import cli
from trainers.cli import app, listing
from trainers.cli.app import ORDER

COMMAND = [sys.executable, "-m", "trainers.command"]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(Path(cli.__file__).parents[2]), "OMP_NUM_THREADS": "1"}
SHORT = [
    *("learning.epochs=2", "learning.n_swimmers=3", "learning.batch_size=8", "learning.buffer_size=100"),
    *("world.life=4", "validation.life=4", "validation.cells=2", "evaluation.life=4", "evaluation.cells=3"),
    "tensorboard=false",
]


@pytest.fixture(autouse=True)
def elsewhere(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def run(*words):
    """Exit code and output of a command; what is no message but an exception is raised."""
    result = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    return result.exit_code, result.stdout, result.stderr


def refused(*words):
    """What a command says that fails, in one line, having written nothing."""
    before = sorted(Path().rglob("*"))
    code, _, err = run(*words)
    assert code not in (0, None), words
    assert sorted(Path().rglob("*")) == before
    lines = [line for line in err.splitlines() if line.startswith("swarm: ")]
    assert len(lines) == 1, err
    assert "Traceback" not in err
    return lines[0]


def usage(*words):
    """What a command says whose arguments cannot be understood."""
    code, _, err = run(*words)
    assert code == 2
    assert "Usage" in err
    return " ".join(re.sub("[│╭╮╰╯─]", " ", err).split()).lower()


def policy(path="policy.safetensors", **card):
    """A small policy of random weights."""
    generator = np.random.default_rng(0)
    weights = [generator.standard_normal((4, 8)), generator.standard_normal((2, 4))]
    save_policy(Network(weights, [np.zeros(4), np.zeros(2)], {"n_records": 4, "features": 2} | card), path)
    return path


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--seed", "1"], "a setting must be written key=value, got '--seed'"),
        (["device=cuda:77"], "device must be one that torch finds here"),
        (["learning.buffer_size=10000000000000"], "GiB of memory"),
        (["resume=a", "seed=1"], "nothing else may be given, got resume=a seed=1"),
        (["resume=a", "hydra.run.dir=b"], "nothing else may be given"),
        (["-m", "seed=0,x"], "seed"),
        (["-m", "seed=0,1", "learning.epochs=0"], "learning.epochs must be at least 1, got 0"),
        (["-m", "resume=a"], "resume"),
        (["hydra.run.dir=/dev/null/run", *SHORT], "/dev/null"),
        (["hydra.run.dir=/proc/x", *SHORT], ": /proc/x"),
    ],
)
def test_train_refuses_what_it_cannot_do(words, said):
    assert said in refused("train", *words)


def test_train_makes_a_folder_says_where_it_is_trains_and_tests():
    code, out, _ = run("train", "seed=5", "evaluate=true", "evaluation.worlds=2", *SHORT)
    assert code == 0
    (folder,) = Path("runs").iterdir()
    assert folder.name.startswith("linear_n4-swarm-seed5-")
    first, *_ = out.splitlines()
    assert first == f"training linear_n4 by dqn, recipe swarm, seed 5: settings and all else in {folder}"
    assert {"metrics.csv", "policy.safetensors", "training.png"} <= {path.name for path in folder.iterdir()}
    assert load_policy(folder).card["seed"] == 5
    summary = folder / "evaluation" / "summary.json"
    first = json.loads(summary.read_text())
    assert (first["cells"], first["worlds"], first["life"]) == (3, 2, 4.0)
    summary.parent.rename("elsewhere")
    code, out, _ = run("train", f"resume={folder}")
    assert code == 0
    assert "is finished after 2 epochs; nothing is left" in out
    assert json.loads(summary.read_text()) == first


def test_show_only_shows():
    code, out, _ = run("train", "--show", "seed=5", *SHORT)
    assert code == 0
    assert yaml.safe_load(out)["seed"] == 5
    assert list(Path().iterdir()) == []


def test_a_sweep_is_shown_by_what_differs_and_what_does_not():
    code, out, _ = run("train", "-m", "--show", "seed=0,1", "learning.hidden=[8],[9]", *SHORT[:1])
    assert code == 0
    count, *lines = out.splitlines()
    names = [line for line in lines if not line.startswith(" ")]
    assert count == "4 runs"
    assert names[:2] == ["learning.hidden=[8],seed=0", "learning.hidden=[9],seed=0"]
    assert yaml.safe_load("\n".join(lines[1:3])) == {"learning.hidden": [8], "seed": 0}
    same = yaml.safe_load(out[out.index(names[-1]) + len(names[-1]) :])
    assert names[-1] == "in all of them"
    assert (same["learning.epochs"], same["world.field"]) == (2, "linear")
    assert list(Path().iterdir()) == []


def test_commands_are_listed_in_the_order_of_their_use():
    _, out, _ = run("--help")
    assert re.findall(r"^│ (\w+) ", out, re.MULTILINE)[-len(ORDER) :] == list(ORDER)


@pytest.mark.parametrize("command", ["train", "evaluate", "watch"])
def test_help_names_what_can_be_chosen(command):
    code, out, _ = run(command, "--help")
    assert code == 0
    assert "taylor_green_blind" in out
    assert "{" not in out.replace("{policy}", "")


@pytest.mark.parametrize(
    ("command", "own"), [("minimal", "learning.hidden=[7]"), ("strategies", "world.action=continuous")]
)
def test_help_names_the_extra_and_the_plan_keeps_what_it_decides(command, own, tmp_path):
    assert "(chemoswarm[evolution])" in run(command, "--help")[1]
    for word in ("algorithm=ppo", "recipe=paper", "seed=3", "n_seeds=2", own):
        code, _, error = run(command, "experiment=linear_n4", word, "--out", str(tmp_path / "out"))
        assert code == 2
        assert f"{own.partition('=')[0]} are the plan's to choose, got {word!r}" in error
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("section", "name", "said"),
    [
        ("experiments", "linear_n8", "world.n_records=8"),
        ("recipes", "paper", "validation.every=50"),
        ("algorithms", "ppo", "Schulman et al. 2017"),
        ("zoo", "zoo:linear_n4", percent(load_policy("zoo:linear_n4").card["test"]["fraction_of_limit"])),
        ("fields", "radial", "offset=100"),
        ("fields", "gridded", "path=…"),
        ("flows", "shear", "height=10"),
        ("sensors", "memory_with_neighbours", "k=3"),
        ("rewards", "arrival", "winner of the race"),
        ("algorithms", "dqn", "hidden=[24, 24, 24]"),
        ("interactions", "contact", "stiffness=100"),
    ],
)
def test_list_tells_what_is_chosen_by_name_and_its_defaults(monkeypatch, section, name, said):
    monkeypatch.setenv("COLUMNS", "3000")
    code, out, _ = run("list", section)
    assert code == 0
    (line,) = [line for line in out.splitlines() if line.split() and line.split()[0] == name]
    assert said in line


def test_list_tells_of_a_part_that_a_user_has_registered(monkeypatch):
    monkeypatch.setenv("COLUMNS", "3000")
    monkeypatch.setitem(
        swarm.rewards._kinds, "mine", type("Mine", (), {"__doc__": "Nothing\nat all.\n\nMore."})
    )
    monkeypatch.setitem(swarm.rewards._renamed, "mine", {})
    assert "Nothing at all." in run("list", "rewards")[1]
    assert "did you mean 'rewards'?" in refused("list", "reward")
    assert [line for line in run("list")[1].splitlines() if line.isupper()] == [
        each.upper() for each in listing.SECTIONS
    ]


@pytest.mark.parametrize(
    "words", ["list zoo", "evaluate greedy --cells 2 --life 2", "train --show", "--help"]
)
def test_a_command_whose_output_nobody_reads_ends_as_others_do(words):
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([*COMMAND, *words.split()], stdout=writer, stderr=subprocess.PIPE, env=ENVIRONMENT)
    os.close(writer)
    assert (done.returncode, done.stderr) == (-signal.SIGPIPE, b"")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["greeedy"], "did you mean 'greedy'?"),
        (["nowhere/at/all"], "nowhere/at/all"),
        (["zoo:nothing"], "nothing"),
        (["greedy", "--experiment", "linear_n3"], "did you mean"),
        (["greedy", "--life", "nan"], "life must be a finite number above 0, got nan"),
        (["greedy", "--noise", "0,much"], "--noise must be numbers, separated by commas, got '0,much'"),
        (["greedy", "--noise", "0.1,0.1"], "levels of noise must be at least one, and rise"),
        (["greedy", "--noise", "0", "--noise-kind", "curvatur"], "did you mean 'curvature'?"),
        (["greedy", "--noise-kind", "curvature"], "--noise-kind must come with --noise"),
        (["greedy", "--share", "0.5"], "--share must come with --against, got 0.5 alone"),
        (["greedy", "--against", "random", "--share", "1"], "share must lie between 0 and 1, got 1"),
        (["greedy", "--against", "greedy"], "must compete against another, got 'greedy' twice"),
        (["greedy", "--against", "random"], "first_arrivals must go with a field that has an egg"),
        (["greedy", "--against", "randm", "--experiment", "radial"], "did you mean 'random'?"),
        (["zoo:radial", "--against", "zoo:linear_n8"], "policy 'zoo:linear_n8' must be able to steer cells"),
        (["zoo:radial", "--against", "greedy", "--worlds", "7"], "worlds must be a multiple of 2"),
        (["greedy", "--against", "random", "--noise", "0,0.1"], "--noise must be one level with --against"),
        (["greedy", "--worlds", "0"], "worlds must be a whole number of at least 1, got 0"),
        (["greedy", "--noise", "0,0.1", "--out", "taken"], "taken must be a new or an empty folder"),
        (["policy.safetensors", "--experiment", "linear_n8"], "must fit what the world's cells observe"),
        (["greedy", "--out", "taken"], "taken must be a new or an empty folder"),
        (["greedy", "--out", "/dev/null/out", "--cells", "2", "--life", "2"], "/dev/null"),
        (["pickle.safetensors"], "it looks like a pickle"),
    ],
)
def test_evaluate_refuses_what_it_cannot_do(words, said):
    policy()
    Path("pickle.safetensors").write_bytes(pickle.dumps(print))
    Path("taken").mkdir()
    Path("taken/notes.txt").write_text("mine")
    assert said in refused("evaluate", *words)


@pytest.mark.parametrize(
    "settings",
    [
        "text",
        {"world": {"n_records": -1}},
        {"world": {"_target_": "os.system"}},
        {"world": {"life": "${oc.env:HOME}"}},
        {"world": {"start_box": [[1e9, 1e9], [0, 0]]}},
        {"evaluation": {"cells": 0}},
        {"evaluation": {"field": "../../etc/passwd"}},
    ],
)
def test_evaluate_refuses_a_card_that_describes_no_world(settings):
    policy(settings=settings)
    if settings == "text":
        assert run("evaluate", "policy.safetensors", "--life", "2", "--cells", "2")[0] == 0
    else:
        refused("evaluate", "policy.safetensors", "--life", "2")


def test_evaluate_draws_gain_against_noise():
    policy(experiment="linear_n4")
    short = ["--cells", "2", "--life", "4"]
    words = ["evaluate", "policy.safetensors", *short, "--noise-kind", "curvature"]
    code, out, _ = run(*words, "--noise", "0.5,0", "--noise", "1", "--out", "found")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()[1:7]] == ["0", "0", "0.5", "0.5", "1", "1"]
    assert {path.name for path in Path("found").iterdir()} == {"noise.nc", "noise.csv", "noise.png"}


def test_evaluate_fills_a_folder_to_watch_and_rebuilds_the_sensor_of_the_training():
    sensor = {"type": "memory_with_neighbours", "k": 1, "range": 2.5}
    words = ("world.sensor={type: memory_with_neighbours, k: 1, range: 2.5}", "hydra.run.dir=seeing")
    assert run("train", "seed=1", *SHORT, *words)[0] == 0
    assert load_policy("seeing").card["sensor"] == sensor
    sizes = ["--cells", "3", "--life", "4", "--seed", "2"]
    code, out, said = run("evaluate", "seeing", *sizes, "--out", "found")
    assert code == 0, said
    assert "gain" in out
    summary = json.loads(Path("found/summary.json").read_text())
    assert (summary["cells"], summary["life"], summary["seed"]) == (3, 4.0, 2)
    assert {"gains.png", "centerlines.png"} <= {path.name for path in Path("found").iterdir()}
    assert world_of(load_population("found/population.nc")).described()["sensor"] == sensor
    assert "written to page.html" in run("watch", "found/population.nc", "--out", "page.html")[1]
    text = Path("page.html").read_text(encoding="utf-8")
    assert all(f'"name": "{name}"' in text for name in ("dqn", "greedy", "swinging"))


def test_evaluate_races_policies_against_each_other():
    words = ["evaluate", "zoo:radial", "--against", "greedy", "--share", "0.25", "--cells", "8"]
    code, out, _ = run(*words, "--worlds", "8", "--life", "20", "--out", "found")
    assert code == 0
    assert {line.split()[0] for line in out.splitlines()[-3:-1]} == {"zoo:radial", "greedy"}
    assert {path.name for path in Path("found").iterdir()} == {"contest.nc", "contest.csv"}
    with xr.open_dataset("found/contest.nc", engine="h5netcdf") as found:
        assert found["crowd"].values.tolist() == [0.25, 0.75]
        assert found.sizes["world"] == 8


@pytest.mark.slow
def test_evaluate_keeps_the_noise_that_a_policy_was_trained_with():
    world = {"concentration_noise": 0.25}
    policy(settings={"world": world})
    for words, expected in (([], 0.25), (["--noise", "0"], 0.0), (["--noise", "0.5"], 0.5)):
        out = f"found{expected}"
        run("evaluate", "policy.safetensors", "--cells", "2", "--life", "2", "--out", out, *words)
        assert world_of(load_population(f"{out}/population.nc")).concentration_noise == expected


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "compare must name folders of runs, got nowhere"),
        (["unfinished"], "unfinished must be finished; to go on with it: swarm train resume=unfinished"),
        (["finished", "--cells", "0"], "cells must be a whole number"),
        (["finished", "--out", "finished"], "finished must be a new or an empty folder"),
        (["finished", "--format", "pdf"], "--format must be md or tex without --out, got 'pdf'"),
        (["finished", "--out", "new", "--format", "tex,pfd"], "got 'pfd'; did you mean 'pdf'?"),
        (["finished", "--life", "-1"], "life must"),
    ],
)
def test_compare_refuses_what_it_cannot_do(words, said):
    settings = short_settings(learning={"epochs": 1})
    start("unfinished", settings)
    whole("finished", settings).mark_finished()
    assert said in refused("compare", *words)
    assert not Path("new").exists()


def test_compare_prints_and_writes_tables_and_figures_in_every_format():
    whole("finished", short_settings(learning={"epochs": 1})).mark_finished()
    words = ["compare", "finished", "--cells", "2", "--life", "3"]
    code, printed, _ = run(*words, "--format", "md")
    assert (code, printed.splitlines()[1][:5]) == (0, "| :--")
    assert run(*words, "--out", "found", "--format", "md,tex, pdf,svg")[0] == 0
    beginnings = {"md": b"| runs", "tex": rb"\begin{tabular}", "csv": b"runs,"}
    beginnings |= {"pdf": b"%PDF", "svg": b"<?xml"}
    found = {path.suffix[1:]: path.read_bytes() for path in Path("found").iterdir()}
    assert {kind: found.pop(kind)[: len(start)] for kind, start in beginnings.items()} == beginnings
    assert json.loads(found.pop("json"))["groups"][0]["life"] == 3.0
    assert not found


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["greedy", "--out", "nowhere/a.gif"], "nowhere"),
        (["greedy", "--out", "loop/a.gif"], "the folder of loop/a.gif must be there"),
        (["greedy", "--life", "nan", "--out", "a.gif"], "life must be a finite number above 0"),
        (["greedy", "--out", "a.xyz"], "out must end in .gif, .mp4, .html, got a.xyz"),
        (["text.nc", "--out", "a.html"], "holds no results of a population test: it must be a NetCDF"),
        (["text.nc", "--life", "3", "--out", "a.html"], "--life must be left out, text.nc holds lives"),
    ],
)
def test_watch_refuses_what_it_cannot_do(words, said):
    Path("text.nc").write_text("no numbers")
    Path("loop").symlink_to("loop")
    assert said in refused("watch", *words)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "file"], "file"),
        (["--out", "new", "--seeds", "0"], "--seeds must be a whole number of at least 1, got 0"),
        (["--out", "new", "--jobs", "0"], "--jobs must be a whole number of at least 1, got 0"),
    ],
)
def test_reproduce_refuses_what_it_cannot_do(words, said):
    Path("file").write_text("mine")
    assert said in refused("reproduce", *words)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["evaluate"], "missing argument 'policy'"),
        (["evaluate", "greedy", "--cells", "many"], "invalid value for '--cells'"),
        (["evaluate", "greedy", "--sells", "4"], "no such option"),
        (["compare"], "missing argument 'run run ...'"),
        (["reproduce"], "missing option '--out'"),
        (["check", "--fast"], "no such option"),
        (["trian"], "no such command 'trian'"),
    ],
)
def test_arguments_that_cannot_be_understood_are_named(words, said):
    assert said in usage(*words)


def process(*words, command=COMMAND):
    """A command in a process of its own."""
    return subprocess.run([*command, *words], capture_output=True, text=True, env=ENVIRONMENT)


def test_bad_input_ends_a_process_with_one_line_and_an_exit_code():
    done = process("train", "learning.epochs=0")
    assert done.returncode == 2
    assert done.stderr == "swarm: learning.epochs must be at least 1, got 0\n"
    assert done.stdout == ""


def test_a_folder_that_is_gone_is_said():
    Path("gone").mkdir()
    code = "import os; from trainers.command import main; os.chdir('gone'); os.rmdir(os.getcwd()); main()"
    done = process("train", "--show", command=[sys.executable, "-c", code])
    assert done.returncode == 2
    assert done.stderr == "swarm: the current folder must be there, but was removed: change to another\n"


def test_help_answers_at_once():
    def seconds(*words, command=COMMAND):
        began = time.perf_counter()
        assert process(*words, command=command).returncode == 0
        return time.perf_counter() - began

    slowdown = seconds(command=[sys.executable, "-c", "import typer.main"]) / 0.15  # of a busy machine
    assert min(seconds("--help") for _ in range(3)) < 0.5 * max(1, slowdown)
