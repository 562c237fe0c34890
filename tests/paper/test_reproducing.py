"""A reproduction in miniature, through everything that a whole one goes through."""

import csv
import dataclasses
import json
import re
import shutil
from importlib import resources
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from swarm import figures
from swarm.optimal import physical_limit as optimal
from swarm.policies import network
from trainers.paper import stacks
from trainers.paper.plan import EXPERIMENTS, Plan, trainings
from trainers.paper.reproduction import FILES, ReproductionError, reproduce
from trainers.paper.zoo import ship
from trainers.training import loop as validating
from trainers.training.run_folder import RunFolder

WORDS = ("world.life=8.0", "learning.epochs=4", "learning.batch_size=16", "validation.every=2")
WORDS += ("validation.life=8.0", "validation.cells=3", "evaluation.life=8.0", "checkpoint_every=2")
WORDS += ("compile=never",)
COUNTS = {"cells": 6, "radial_cells": 3, "swinging_cells": 2, "figure_cells": 3, "radial_figure_cells": 2}
MINIATURE = Plan(n_seeds=2, words=WORDS, workers=0, **COUNTS)


@pytest.fixture(scope="module")
def sparing():
    """Spared is what takes most of the time: pixels of figures, and the limit in a flow, which is made up."""
    exact = optimal.limit_details

    def save(figure, path):
        assert isinstance(figure, Figure)
        path.write_bytes(b"\x89PNG")

    def details(world, starts):
        made_up = optimal.LimitDetails(0.18 * world.life, 0.1, {})
        return made_up if world.in_flow else exact(world, starts)

    def limit(world, starts):
        found = details(world, starts)
        return None if found is None else found.value

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "save", save)
        patch.setattr(optimal, "limit_details", details)
        patch.setattr(optimal, "limit", limit)
        patch.setattr(validating, "limit", limit)
        yield


@pytest.fixture(scope="module")
def done(tmp_path_factory, sparing):
    """The folder of a whole reproduction, a copy without the runs, and the claims."""
    folder = tmp_path_factory.mktemp("reproduction")
    found = reproduce(MINIATURE, folder / "out", folder / "published")
    return SimpleNamespace(out=folder / "out", published=folder / "published", claims=found)


@pytest.fixture
def shipped(done, tmp_path, monkeypatch):
    """A zoo made of the reproduction, in the place of the one that is shipped."""
    names = ship(done.out, tmp_path / "zoo")
    found = SimpleNamespace(files=lambda package: tmp_path, as_file=resources.as_file)
    monkeypatch.setattr(network, "resources", found)
    monkeypatch.setattr(stacks, "resources", found)
    return SimpleNamespace(folder=tmp_path / "zoo", names=names)


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_every_file_is_there_and_nothing_else(done):
    assert {path.name for path in done.out.iterdir()} == {*FILES, "runs", "zoo"}
    assert {path.name for path in done.published.iterdir()} == set(FILES)
    for path in done.published.rglob("*.*"):
        assert path.read_bytes() == (done.out / path.relative_to(done.published)).read_bytes()


def test_all_twelve_figures_of_the_paper_are_drawn_under_both_recipes_and_shown(done):
    report = (done.out / "report.md").read_text()
    shown = re.findall(r"!\[Figure (\d+), (\w+)\]\((.*?)\)", report)
    for recipe in ("swarm", "paper"):
        assert {int(number) for number, which, _ in shown if which == recipe} == set(range(1, 13))
    paths = {str(path.relative_to(done.out)) for path in (done.out / "figures").rglob("*.png")}
    assert {path for *_, path in shown} == paths
    assert all((done.out / path).read_bytes().startswith(b"\x89PNG") for path in paths)


def test_every_experiment_is_trained_once_and_radial_not_again(done):
    found = {str(path.parent.relative_to(done.out / "runs")) for path in done.out.rglob("settings.yaml")}
    assert found == {
        f"{recipe}/{name}" for recipe in ("swarm", "paper") for name in EXPERIMENTS if name != "radial"
    }
    assert RunFolder(done.out / "runs/swarm/varying_speed").finished
    assert not list(done.out.rglob("checkpoints"))


def test_claims_are_a_list_with_verdicts_under_both_recipes(done):
    claims = json.loads((done.out / "claims.json").read_text())
    assert claims == json.loads(json.dumps([each._asdict() for each in done.claims]))
    assert {claim["verdict"] for claim in claims} <= {"reproduced", "not reproduced", "reversed"}
    by_recipe = {recipe: [c["id"] for c in claims if c["recipe"] == recipe] for recipe in ("swarm", "paper")}
    assert by_recipe["swarm"] == by_recipe["paper"]
    trained = [claim for claim in claims if claim["recipe"]]
    assert all(claim["seeds"] == [0, 1] and claim["worst_seed"] is not None for claim in trained)
    report = (done.out / "report.md").read_text()
    assert all(claim["claim"] in report for claim in claims)


def test_tables_agree_with_the_lives_they_summarise(done):
    results = {(row["test"], row["recipe"], row["policy"]): row for row in rows(done.out / "results.csv")}
    for row in rows(done.out / "seeds.csv"):
        with xr.open_dataset(done.out / "lives" / f"{row['test']}.nc") as lives:
            label = f"{row['recipe']}/{row['policy']}/seed {row['seed']}"
            gain = lives["gain"].sel(policy=label).values
        assert float(row["gain"]) == pytest.approx(gain.mean(), rel=1e-5)
        assert float(row["std"]) == pytest.approx(gain.std(), rel=1e-5)
        whole = results[row["test"], row["recipe"], row["policy"]]
        assert float(whole["worst_seed"]) <= float(row["gain"]) + 1e-6
        assert int(whole["seeds"]) == 2
    assert {key[0] for key in results} == {*EXPERIMENTS[:5], "taylor_green"}
    assert ("taylor_green", "paper", "still") in results


def test_the_record_says_where_every_number_comes_from(done):
    record = json.loads((done.out / "reproduction.json").read_text())
    assert record["plan"]["seed"] == MINIATURE.seed
    assert record["plan"]["words"] == list(WORDS)
    assert set(record) >= {"versions", "commit", "trainings"}
    (radial,) = record["trainings"]["paper/radial"]
    assert radial["run"] == "paper/varying_speed"
    assert radial["settings"]["experiment"] == "radial"
    assert radial["seeds"] == [0, 1]


def test_the_authors_numbers_stand_beside_the_paper_recipe_only_with_their_test(done):
    table = rows(done.out / "results.csv")
    found = {(row["test"], row["policy"]): row["authors"] for row in table if row["authors"]}
    assert found.keys() == {(name, "dqn") for name in ("linear_n2", "linear_n4", "linear_n8")} | {
        ("taylor_green", "still")
    }
    assert all(row["recipe"] == "paper" and row["std_of_authors"] for row in table if row["authors"])
    assert "gain ± std of 400 cells of the population seed 100" in (done.out / "report.md").read_text()


SMALL = dataclasses.replace(MINIATURE, experiments=("linear_n2",), recipes=("paper",))


def test_a_finished_reproduction_trains_nothing_and_says_the_same(done, tmp_path, monkeypatch, sparing):
    shutil.copytree(done.out / "runs/paper/linear_n2", tmp_path / "runs/paper/linear_n2")
    monkeypatch.setattr(stacks, "do", lambda *arguments: pytest.fail("trained again"))
    reproduce(SMALL, tmp_path)
    before = {claim.id: claim for claim in done.claims if claim.recipe == "paper"}
    after = json.loads((tmp_path / "claims.json").read_text())
    for claim in after:
        if claim["recipe"] and claim["id"] in before:
            assert claim == json.loads(json.dumps(before[claim["id"]]._asdict()))


def test_a_training_that_was_stopped_goes_on_to_the_same_policies(done, tmp_path, sparing):
    from trainers.training import run as running

    (planned,) = trainings(SMALL, tmp_path)
    prepared = running.prepare(planned.settings)
    run = RunFolder.create(planned.folder, planned.settings)

    def stop(progress, seconds):
        if progress.epoch == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        running.train(prepared, run, report=stop)
    assert list(planned.folder.glob("checkpoints/epoch_*"))
    reproduce(SMALL, tmp_path)
    for seed in (0, 1):
        policy = f"runs/paper/linear_n2/seed_{seed}/policy.safetensors"
        assert (tmp_path / policy).read_bytes() == (done.out / policy).read_bytes()


def test_seeds_are_added_to_those_that_are_there(done, tmp_path, sparing):
    shutil.copytree(done.out / "runs/paper/linear_n2", tmp_path / "runs/paper/linear_n2")
    (beats, *_) = [
        claim
        for claim in reproduce(dataclasses.replace(SMALL, n_seeds=3), tmp_path)
        if claim.id == "dqn_beats_greedy_linear_n2"
    ]
    assert beats.seeds == (0, 1, 2)
    before = next(claim for claim in done.claims if (claim.id, claim.recipe) == (beats.id, "paper"))
    assert beats.by_seed["linear_n2/dqn"][:2] == before.by_seed["linear_n2/dqn"]
    assert RunFolder.open(tmp_path / "runs/paper/linear_n2-from-2")[1]["seed"] == 2
    assert [row["seeds"] for row in rows(tmp_path / "results.csv") if row["policy"] == "dqn"] == ["3"]
    stored = json.loads((tmp_path / "reproduction.json").read_text())["trainings"]["paper/linear_n2"]
    assert [each["seeds"] for each in stored] == [[0, 1], [2]]


def test_a_run_with_other_settings_is_set_aside_and_trained_again(done, tmp_path, capsys, sparing):
    shutil.copytree(done.out / "runs/paper/linear_n2", tmp_path / "runs/paper/linear_n2")
    reproduce(dataclasses.replace(SMALL, words=(*WORDS, "learning.discount=0.9")), tmp_path)
    assert (tmp_path / "runs/paper/linear_n2-set-aside-1/policy.safetensors").is_file()
    assert "has other settings" in capsys.readouterr().out
    assert RunFolder(tmp_path / "runs/paper/linear_n2").finished


def test_a_run_whose_policies_are_damaged_is_trained_again(done, tmp_path, sparing):
    folder = tmp_path / "runs/paper/linear_n2"
    shutil.copytree(done.out / "runs/paper/linear_n2", folder)
    (folder / "seed_1/policy.safetensors").write_bytes(b"damaged")
    reproduce(SMALL, tmp_path)
    again = (folder / "seed_1/policy.safetensors").read_bytes()
    assert again == (done.out / "runs/paper/linear_n2/seed_1/policy.safetensors").read_bytes()


def test_one_seed_is_enough_for_verdicts(tmp_path, sparing):
    found = reproduce(dataclasses.replace(SMALL, n_seeds=1), tmp_path)
    (beats,) = (claim for claim in found if claim.id == "dqn_beats_greedy_linear_n2")
    assert beats.seeds == (0,)
    assert beats.interval is not None  # over cells
    (rises,) = (claim for claim in found if claim.id == "gain_rises_linear_n2")
    assert rises.interval is None


def test_figures_of_an_earlier_reproduction_do_not_stay(done, tmp_path, sparing):
    shutil.copytree(done.out / "runs/paper/linear_n2", tmp_path / "runs/paper/linear_n2")
    shutil.copytree(done.out / "figures", tmp_path / "figures")
    shutil.copy(done.out / "reproduction.json", tmp_path)
    reproduce(SMALL, tmp_path)
    assert not (tmp_path / "figures/swarm/radial.png").exists()
    assert (tmp_path / "figures/paper/linear_n2_population.png").exists()


def test_nothing_is_overwritten_that_is_not_a_reproduction(tmp_path):
    (tmp_path / "report.md").write_text("mine")
    with pytest.raises(ReproductionError, match=r"report.md is there, but no reproduction.json"):
        reproduce(SMALL, tmp_path)
    assert (tmp_path / "report.md").read_text() == "mine"


def test_a_folder_that_cannot_be_is_said_before_anything_runs(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name, there in (("file", "file"), ("file/deep", "file"), ("loop", "loop")):
        with pytest.raises(ReproductionError, match=f"{name} must be a folder, but .*{there} is a file"):
            reproduce(SMALL, tmp_path / name)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("settings.yaml", "a: [", "cannot be read"),
        ("metrics.csv", "epoch,seed\n1,0\n", "must hold numbers in the columns"),
        ("metrics.csv", None, "must have 4 rows for each seed, one per epoch, got"),
    ],
)
def test_a_run_whose_files_are_damaged_is_set_aside(done, tmp_path, capsys, name, content, reason):
    (planned,) = trainings(SMALL, tmp_path)
    shutil.copytree(done.out / "runs/paper/linear_n2", planned.folder)
    file = planned.folder / name
    file.write_text(content or "".join(file.read_text().splitlines(keepends=True)[:-2]))
    assert not stacks.is_done(planned)
    assert reason in capsys.readouterr().out
    assert not planned.folder.exists()


def test_a_training_that_fails_is_named_and_leaves_no_report(tmp_path):
    (planned,) = trainings(SMALL, tmp_path)
    planned.folder.mkdir(parents=True)
    (planned.folder / "mine.txt").write_text("not a run")
    with pytest.raises(ReproductionError, match="1 of 1 trainings failed: paper/linear_n2: "):
        reproduce(SMALL, tmp_path)
    assert not (tmp_path / "report.md").exists()


@pytest.mark.slow
def test_quick_tests_the_shipped_policies_and_trains_nothing(shipped, tmp_path, sparing):
    out = tmp_path / "quick"
    found = reproduce(dataclasses.replace(MINIATURE, quick=True), out)
    assert not (out / "runs").exists()
    assert {claim.recipe for claim in found} == {None, "swarm"}
    assert not any(claim.id.startswith("gain_rises") for claim in found)
    report = (out / "report.md").read_text()
    assert "shipped" in report
    assert "no policies are shipped for the recipe `paper`" in report
    numbers = {int(number) for number in re.findall(r"!\[Figure (\d+),", report)}
    assert numbers == set(range(1, 13))
    assert json.loads((out / "reproduction.json").read_text())["trainings"]["swarm/linear_n2"][0]["shipped"]


def test_quick_without_curves_says_that_they_are_left_out(shipped, tmp_path, sparing):
    for file in shipped.folder.glob("*"):
        if file.suffix == ".json" or not file.name.startswith("linear_n2"):
            file.unlink()
    reproduce(dataclasses.replace(MINIATURE, quick=True), tmp_path / "quick")
    assert "Training curves are left out" in (tmp_path / "quick/report.md").read_text()


def test_quick_without_shipped_policies_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(network, "zoo_names", list)
    with pytest.raises(ReproductionError, match="no policies are shipped with this copy"):
        reproduce(Plan(quick=True), tmp_path / "quick")


@pytest.mark.parametrize("other", ["population.nc", "seed=0/run.json", "reproduction.json verdicts.json"])
def test_a_folder_of_other_results_is_refused_before_any_work(monkeypatch, tmp_path, other):
    for path in (tmp_path / each for each in other.split()):
        path.parent.mkdir(exist_ok=True)
        path.write_text("{}")
    monkeypatch.setattr(stacks, "train", None)
    named = other.split()[-1].split("/")[0]
    with pytest.raises(ReproductionError, match=f"that of an earlier reproduction of the same.* {named}$"):
        reproduce(Plan(quick=True), tmp_path)


def test_every_experiment_has_a_shipped_policy_with_a_card(done, shipped):
    assert sorted(shipped.names) == sorted(EXPERIMENTS) == sorted(network.zoo_names())
    tested = {
        (row["experiment"], row["seed"]): row
        for row in rows(done.out / "seeds.csv")
        if row["recipe"] == "swarm" and row["policy"] != "still"
    }
    for name in EXPERIMENTS:
        policy = network.load_policy(f"zoo:{name}")
        card = policy.card
        assert card["experiment"] == name
        assert card["recipe"] == "swarm"
        assert card["seeds"] == [0, 1]
        assert set(card) >= {"settings", "versions", "commit", "validation", "test"}
        row = tested[name, str(card["seed"])]
        assert row["chosen"] == "1"
        assert card["test"]["gain"]["mean"] == pytest.approx(float(row["gain"]), rel=1e-5)
        stored = json.loads((shipped.folder / f"{name}.json").read_text())
        assert stored.pop("training")["epoch"] == [2, 4]
        assert stored == card


def test_the_shipped_policy_is_the_one_that_validation_prefers(done, shipped):
    card = network.load_policy("zoo:linear_n8").card
    seeds = [network.load_policy(done.out / f"runs/swarm/linear_n8/seed_{seed}") for seed in (0, 1)]
    gains = [policy.card["validation"]["gain"] for policy in seeds]
    assert card["seed"] == int(np.argmax(gains))
    chosen = seeds[card["seed"]]
    observation = np.random.default_rng(0).normal(size=(5, 16))
    assert np.array_equal(
        network.load_policy("zoo:linear_n8").values(observation), chosen.values(observation)
    )


def test_the_policy_for_the_egg_is_tested_around_the_egg(shipped):
    radial, linear = (network.load_policy(f"zoo:{name}") for name in ("radial", "varying_speed"))
    assert radial.card["settings"]["evaluation"]["field"] == "radial"
    assert all(np.array_equal(a, b) for a, b in zip(radial.weights, linear.weights, strict=True))


def test_nothing_is_shipped_where_nothing_is_trained(tmp_path):
    with pytest.raises(ReproductionError, match="--ship must come with policies that are trained"):
        reproduce(Plan(quick=True), tmp_path / "out", ship=True)


@pytest.mark.slow
def test_a_whole_plan_trains_all_seeds_of_every_experiment_under_both_recipes(tmp_path):
    planned = trainings(Plan(), tmp_path)
    assert len(planned) == 14
    assert len({each.folder for each in planned}) == 12
    assert all(each.settings.seeds == list(range(Plan().n_seeds)) for each in planned)
