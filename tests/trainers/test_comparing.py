"""Runs side by side: which are one group, and what it is called."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml

from swarm.policies.network import save_policy
from swarm.policies.policy_file import PolicyError
from swarm.population.statistics import mean_interval
from tests.policies.test_network import make
from trainers.jobs import comparison
from trainers.jobs.comparison import Contender, Group, compare, grouped
from trainers.jobs.statistics import Lives
from trainers.settings.composition import settings_from
from trainers.training.run_folder import RunFolder

EATING = [
    "learning.n_swimmers=3",
    "world.start_box=[[-1,1],[-1,1]]",
    "world.medium={box:[[-5,5],[-5,5]],shape:[64,64],edges:periodic,leaving:wrap,diffusivity:0.1,uptake:0.01}",
]


NONE = np.zeros((1, 3))


def contender(*words, gain=NONE, times=None, limit=np.nan):
    settings = settings_from(words)
    coupled = settings.test_world().is_shared
    lives = Lives(gain[None], np.zeros_like(gain), None if times is None else times[None], limit, coupled)
    return Contender(settings, settings.seed, lives, 80.0)


def groups(*runs):
    """Labels, and the seeds of each."""
    found = grouped([contender(*words.split()) for words in runs])
    return {group.label: [member.seed for member in group.members] for group in found}


def test_a_run_that_claims_endless_seeds_ends_at_the_first_that_is_not_there(tmp_path):
    text = yaml.safe_dump(dataclasses.asdict(settings_from(["n_seeds=1000000000000"])))
    (tmp_path / "settings.yaml").write_text(text)
    (tmp_path / "run.json").write_text('{"finished": true}')
    (tmp_path / "policy.safetensors").touch()
    with pytest.raises(PolicyError, match=r"seed_0/policy.safetensors must be a policy file"):
        compare([tmp_path], cells=2)


def test_the_interval_of_a_group_is_over_its_seeds_and_the_cells_they_share():
    gains = np.random.default_rng(0).normal(20.0, 3.0, (1, 40)) + np.array([[0.0], [0.1], [0.3]])
    members = [contender(f"seed={seed}", gain=gain[None]) for seed, gain in enumerate(gains)]
    row = Group("alike", members).row()
    assert [row["low"], row["high"]] == mean_interval(gains)
    assert row["high"] - row["low"] > 2 * np.ptp(mean_interval(gains.mean(axis=1, keepdims=True)))
    short = Group("short", [contender(limit=-0.1)]).row()  # lives of less than a turn
    assert (short["limit"], short["fraction_of_limit"]) == (pytest.approx(-0.1), None)


def test_tables_and_figures_name_settings_by_the_symbols_of_the_field():
    told = {
        "linear_n4 world.n_records=4 learning.discount=0.9": "linear_n4 N_T=4 γ=0.9",
        "world.life=80.0 my_world.life=3": "t_life=80.0 my_world.life=3",
        "world.field={type:gaussian_plume}": "world.field={type:gaussian_plume}",
    }
    assert {label: comparison.in_symbols(label) for label in told} == told
    group = Group("a_b world.n_records=4 50%", [contender()])
    (line,) = [line for line in comparison.table([group]).as_latex().splitlines() if "50" in line]
    assert line.startswith(r"a\_b $N_T$=4 50\% & 1 & 0.00 &")
    assert "| a_b N_T=4 50% | 1 | 0.00 |" in comparison.table([group]).as_markdown()


def test_times_to_the_egg_are_of_all_seeds_and_stand_in_the_table_where_there_is_one():
    times = np.array([[3.0, np.inf, 5.0]])
    members = [contender(f"seed={seed}", times=times + seed) for seed in range(2)]
    row = Group("egg", members).row()
    assert (row["arrived"], row["time_to_egg"], row["median_time_to_egg"]) == (4 / 6, 4.5, 4.5)
    shown = comparison.table([Group("egg", members), Group("none", [contender()])])
    assert shown.headings[-3:] == ["arrived", "time to egg", "median"]
    assert [row[-3:] for row in shown.rows] == [["66.7%", "4.5", "4.5"], [None] * 3]
    assert "arrived" not in comparison.table([Group("none", [contender()])]).headings


def test_units_of_an_interval_are_worlds_where_their_cells_are_coupled():
    gains = np.random.default_rng(0).normal(20.0, 3.0, (2, 6, 5))
    crowded = [contender(f"seed={i}", "experiment=race", gain=gain) for i, gain in enumerate(gains)]
    row = Group("race", crowded).row()
    assert [row["low"], row["high"]] == mean_interval(gains.mean(axis=-1))
    assert (row["worlds"], row["cells"]) == (6, 5)
    one = Group("one world", [contender("experiment=race", gain=gain[:1]) for gain in gains])
    assert (one.row()["low"], comparison.table([one]).rows[0][3]) == (None, None)
    free = Group("free", [contender(f"seed={i}", gain=gain) for i, gain in enumerate(gains)]).row()
    assert [free["low"], free["high"]] == mean_interval(gains.reshape(2, -1))


@pytest.mark.parametrize(
    ("words", "options", "sizes"),
    [
        (["experiment=race", "learning.n_swimmers=3"], {}, (1, 20)),  # which the experiment says
        (EATING, {}, (1, 3)),
        ([*EATING, "evaluation.worlds=2"], {}, (2, 3)),
        (EATING, {"cells": 2, "worlds": 4}, (4, 2)),
        (["learning.n_swimmers=3"], {"worlds": 2}, (2, 40)),
    ],
)
def test_coupled_runs_are_compared_in_the_crowd_of_their_tests(words, options, sizes, tmp_path):
    words = ["algorithm=ppo", "evaluation.life=1", *words]
    folder = RunFolder.create(tmp_path / "run", settings := settings_from(words))
    save_policy(make(settings.layers[0], 6, settings.layers[-1]), folder.policy)
    folder.mark_finished()
    (group,) = compare([folder.path], **options)
    assert group.lives.gain.shape == (1, *sizes)


def test_runs_that_differ_in_the_seed_alone_are_one_group():
    assert groups("seed=0", "seed=1") == {"linear_n4 swarm dqn": [0, 1]}


@pytest.mark.parametrize(
    ("runs", "seeds"),
    [
        (["seed=0", "seed=0"], [0]),
        (["world.life=80", "seed=1 world.life=80.0", "world.life=80.0"], [0, 1]),
        (["world.field=linear", "world.field={type:linear}"], [0]),
        (["world.flow={type:vortex,core:3}", "world.flow={core:3.0,type:vortex}"], [0]),
    ],
)
def test_one_training_counts_once_by_value(runs, seeds):
    assert list(groups(*runs).values()) == [seeds]


def test_a_run_that_is_named_twice_is_tested_once(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    tested = []
    monkeypatch.setattr(comparison, "_test_of", lambda folder, *_: tested.append(folder) or ())
    monkeypatch.setattr(comparison, "tested", lambda: [contender()])
    for name in ("a", "b"):
        folder = Path(name)
        folder.mkdir()
        (folder / "settings.yaml").touch()
        (folder / "run.json").write_text('{"finished": true}')
        (folder / "policy.safetensors").touch()
    Path("link").symlink_to("a")
    (group,) = compare([Path(each) for each in ("a", "./a", "link", "b/../a", "b", str(tmp_path / "b"))])
    assert tested == [Path("a"), Path("b")]
    assert len(group.members) == 1


def test_the_names_of_experiment_and_recipe_stand_for_what_comes_with_them():
    found = groups("experiment=linear_n2", "experiment=linear_n8", "experiment=linear_n8 recipe=paper")
    assert list(found) == ["linear_n2 swarm", "linear_n8 swarm", "linear_n8 paper"]
    assert list(groups("algorithm=dqn", "algorithm=ppo")) == ["dqn", "ppo"]


def test_whatever_else_differs_keeps_groups_apart():
    found = groups(
        "experiment=linear_n4 seed=0",
        "experiment=linear_n4 seed=1 world.concentration_noise=0.1",
        "experiment=linear_n8 seed=2",
    )
    assert found == {
        "linear_n4 world.concentration_noise=0.0": [0],
        "linear_n4 world.concentration_noise=0.1": [1],
        "linear_n8 world.concentration_noise=0.0": [2],
    }
