"""Training: schedules, the paper's numbers, what is kept, stacks of seeds."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml

from swarm import Greedy, LinearField, RadialField, TaylorGreen, World, draw_starts, load_policy
from swarm.population.rollout import rollout
from tests.short_runs import go_on, short_settings, start, whole
from trainers.algorithms.base import learning_rate_at
from trainers.algorithms.dqn import epsilon_at
from trainers.settings import composition as composing
from trainers.settings.learning import DQNSettings
from trainers.settings.schema import EvaluationSettings, Settings
from trainers.training import run as running
from trainers.training import run_folder as runs
from trainers.training.loop import Training


def test_validating_the_untrained_policy_changes_nothing_that_is_learnt(tmp_path):
    settings = short_settings(n_seeds=2)
    bare = Training(settings)
    untrained = Training(settings).validation.gains(bare.algorithm.policy)
    while bare.epoch < settings.learning.epochs:
        bare.run_epoch()
    made = go_on(run := start(tmp_path / "run", settings), settings)
    np.testing.assert_array_equal(made.measures, bare.measures)
    np.testing.assert_array_equal(made.untrained, untrained)
    drawn = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "swarm.figures.training", lambda curves, **options: drawn.append((curves, options)) or None
        )
        patch.setattr("swarm.figures.save", lambda *_: None)
        running.draw(made, run)
    ((curves, options),) = drawn
    (curve,) = curves.values()
    decisions = made.measure("decisions")[:, 0]
    assert curve.moment.tolist() == [0, *decisions[[1, 3, 5]]]
    np.testing.assert_array_equal(curve.gain[:, 0], untrained)
    assert options["label"] == "decisions of each cell"


# --- the paper's numbers ------------------------------------------------------------------------------------

TABLE_1 = {
    "swimming velocity v": (World, "speed", 1.0),
    "path curvatures κ₁, κ₂": (World, "curvatures", (3.0, 5.0)),
    "swimming velocities v₁, v₂": (World, "speeds", (1.1, 0.9)),
    "integration time step Δt": (World, "time_step", 0.02),
    "t_life in training": (World, "life", 80.0),
    "t_life in tests": (EvaluationSettings, "life", 200.0),
    "gradient c_k of the linear field": (LinearField, "gradient_scale", 1.0),
    "constant c_0 of the linear field": (LinearField, "offset", 20.0),
    "gradient c_k of the radial field": (RadialField, "gradient_scale", 1.0),
    "constant c_0 of the radial field": (RadialField, "offset", 100.0),
    "flow parameter u₀": (TaylorGreen, "speed_scale", 0.1),
    "flow parameter k": (TaylorGreen, "wavenumber", math.pi / 10),
}
TABLE_2 = {
    "learning rate α": (DQNSettings, "learning_rate", 0.01),
    "learning rate decay": (DQNSettings, "learning_rate_decay", 0.1),
    "discount-rate parameter γ": (DQNSettings, "discount", 0.98),
    "ε of the ε-greedy policy": (DQNSettings, "epsilon_end", 0.1),
    "hidden layers and their nodes": (DQNSettings, "hidden", [24, 24, 24]),
    "epochs": (DQNSettings, "epochs", 1600),
    "decaying rate of ε": (DQNSettings, "epsilon_decay", 0.998),
}
TABLE_2_WITH_FLOW = {"hidden": [36, 36, 36], "epochs": 6000, "epsilon_decay": 0.9996}


@pytest.mark.parametrize("name", TABLE_1 | TABLE_2)
def test_every_number_of_the_papers_tables_is_the_default_of_one_field(name):
    owner, field, number = (TABLE_1 | TABLE_2)[name]
    assert getattr(owner(), field) == number
    places = [place[:2] for place in (TABLE_1 | TABLE_2).values()]
    assert places.count((owner, field)) == 1


STILL = ["linear_n2", "linear_n4", "linear_n8", "varying_speed", "radial"]


@pytest.mark.parametrize("experiment", [*STILL, "taylor_green_aware", "taylor_green_blind"])
def test_the_paper_recipe_has_the_papers_numbers_without_and_with_flow(experiment):
    settings, still = (
        composing.settings_from(["recipe=paper", f"experiment={experiment}"]),
        experiment in STILL,
    )
    assert settings.learning == DQNSettings(**({} if still else TABLE_2_WITH_FLOW))
    assert still or settings.evaluation.life == 400


def test_files_state_only_what_differs_from_the_typed_defaults():
    for algorithm in ("dqn", "ppo"):
        defaults = Settings(algorithm=algorithm).dotted()
        for file in composing.config_folder().glob(f"algorithm/{algorithm}/*.yaml"):
            stated = yaml.safe_load(file.read_text()).get("learning", {})
            assert not [name for name, value in stated.items() if value == defaults[f"learning.{name}"]], file


# --- schedules ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "epoch", "progress", "epsilon"),
    [
        ({}, 0, 0.5, 1.0),
        ({}, 2, 0.5, 0.996004),
        ({}, 500, 0.5, 0.36751),
        ({}, 1151, 0.5, 0.1),
        ({"epsilon_schedule": "linear", "epsilon_end": 0.05}, 7, 0.3, 0.525),
        ({"epsilon_schedule": "linear", "epsilon_end": 0.05}, 7, 0.6, 0.05),
        ({"epsilon_schedule": "linear", "epsilon_end": 0.05}, 7, 0.9, 0.05),
    ],
)
def test_epsilon_falls_exponentially_or_over_its_part_of_the_epochs_to_its_floor(
    changes, epoch, progress, epsilon
):
    assert epsilon_at(DQNSettings(**changes), epoch, progress) == pytest.approx(epsilon, abs=1e-5)


@pytest.mark.parametrize(
    ("changes", "updates", "progress", "rate"),
    [
        ({}, 0, 0.7, 0.01),
        ({}, 90, 0.7, 0.001),
        ({"learning_rate_schedule": "linear", "learning_rate": 3e-3}, 7, 0.0, 3e-3),
        ({"learning_rate_schedule": "linear", "learning_rate": 3e-3}, 7, 0.5, 1.515e-3),
        ({"learning_rate_schedule": "linear", "learning_rate": 3e-3}, 7, 1.0, 3e-5),
    ],
)
def test_the_learning_rate_falls_with_the_inverse_of_time_or_linearly(changes, updates, progress, rate):
    assert learning_rate_at(DQNSettings(**changes), updates, progress) == pytest.approx(rate)


# --- an epoch -----------------------------------------------------------------------------------------------


def trained(epochs=4, **options):
    made = Training(short_settings(**options))
    for _ in range(epochs):
        made.run_epoch()
    return made


def test_the_paper_recipe_updates_once_per_life_and_the_swarm_recipe_every_few_decisions():
    paper, swarm = trained(3, recipe="paper"), trained(3)
    decisions = paper.env.world.max_decisions
    assert paper.measure("updates")[:, 0].tolist() == [1, 2, 3]
    assert paper.measure("decisions")[:, 0].tolist() == [decisions, 2 * decisions, 3 * decisions]
    assert paper.measure("epsilon")[:, 0] == pytest.approx([1, 0.998, 0.998**2])
    assert paper.measure("learning_rate")[:, 0] == pytest.approx([0.01, 0.01 / 1.1, 0.01 / 1.2])
    rounds = math.ceil(decisions / 4)
    assert swarm.measure("updates")[:, 0].tolist() == [2 * rounds, 4 * rounds, 6 * rounds]


def test_validation_comes_when_it_is_due_and_after_the_last_epoch():
    made = trained(5, learning={"epochs": 5}, validation={"every": 2})
    assert np.isnan(made.measure("gain")[:, 0]).tolist() == [True, False, True, False, False]


def test_the_best_policy_by_validation_is_kept_or_the_last():
    for keep in ("best", "last"):
        made = trained(6, learning={"keep": keep}, validation={"every": 1})
        gains = made.measure("gain")[:, 0]
        epoch = int(np.argmax(gains)) if keep == "best" else 5
        assert made.best_epoch[0] == epoch + 1
        assert made.best_gain[0] == gains[epoch]
        made.algorithm.policy.load_state_dict(made.best)
        assert made.validation.gains(made.algorithm.policy)[0] == gains[epoch]


def test_there_is_no_fraction_of_a_limit_that_is_not_above_0():
    made = trained(2, seed=0, validation={"cells": 3, "life": 0.3, "every": 1})  # less than a turn
    assert made.validation.limits < 0
    assert np.isnan(made.measure("fraction_of_limit")).all()
    assert made.policies()[0].card["validation"]["fraction_of_limit"] is None


CROWDED = {"interactions": [{"type": "contact", "diameter": 0.4, "stiffness": 9.0}]}
CROWDED |= {"start_box": [[0.0, 1.0], [0.0, 1.0]]}


@pytest.mark.parametrize(
    ("recipe", "worlds", "world"), [("swarm", 1, {}), ("drqn", 3, {}), ("swarm", 3, CROWDED)], ids=str
)
def test_validation_plays_the_policy_as_a_population_test_does(recipe, worlds, world):
    made = trained(2, n_seeds=2, recipe=recipe, world=world, validation={"worlds": worlds, "life": 1.5})
    policies = made.policies()
    assert made.best_gain == pytest.approx(played(made, policies), abs=1e-3)
    assert made.validation.greedy == pytest.approx(played(made, [Greedy()] * 2), abs=1e-12)
    assert made.validation.limits == (None if world else pytest.approx(played(made, policies), abs=1.0))


def played(made, policies):
    """Mean gains of each seed's policy on the seed's validation starts, in NumPy, world by world."""
    world, gains = made.validation.env.world, []
    for seed, policy in zip(made.seeds, policies, strict=True):
        for first in range(0, 3 * made.validation.worlds, 3):
            which = {"population": "validation", "first": first}
            *_, last = rollout(world, policy, draw_starts(world, 3, seed, **which), seed, **which)
            gains.append(last.outcome.gain)
    return np.reshape(gains, (len(policies), -1)).mean(axis=1)


# --- stacks of seeds ----------------------------------------------------------------------------------------


ALONE = {
    "swarm": {},
    "paper": {"recipe": "paper"},
    "several steps": {"learning": {"n_steps": 3}},
    "noise": {"world": {"curvature_noise": 0.1, "concentration_noise": 0.05}},
    "recurrent": {"recipe": "drqn"},
    "ppo": {"recipe": "ppo"},
    "central critic": {"recipe": "ppo", "learning": {"critic": "central"}},
    "curvatures": {"recipe": "ppo", "world": {"action": "continuous"}},
}


@pytest.mark.parametrize("options", ALONE.values(), ids=ALONE)
def test_a_seed_trains_the_same_alone_and_in_a_stack_of_three(options):
    stack, alone = trained(2, n_seeds=3, seed=3, **options), trained(2, seed=4, **options)
    for name, tensor in stack.algorithm.policy.state_dict().items():
        expected = alone.algorithm.policy.state_dict()[name][0]
        np.testing.assert_allclose(tensor[1], expected, rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(stack.measures[:, 1], alone.measures[:, 0], rtol=1e-3, atol=1e-3)


def test_a_run_of_several_seeds_leaves_policies_tables_and_logs_of_each(tmp_path):
    """The best policy by validation is its own; every epoch is reported."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    settings = short_settings(n_seeds=3, learning={"epochs": 2}, tensorboard=True)
    run, seen = start(tmp_path / "run", settings), []
    made = go_on(run, settings, lambda made, seconds: seen.append(made.epoch))
    assert seen == [1, 2]
    policies = [load_policy(run.path / f"seed_{seed}") for seed in (3, 4, 5)]
    gains = [policy.card["validation"]["gain"] for policy in policies]
    assert [policy.card["seed"] for policy in policies] == [3, 4, 5]
    assert load_policy(run.path).card["seed"] == 3 + int(np.argmax(gains))
    pairs = [(int(row["epoch"]), int(row["seed"])) for row in run.rows(runs.METRICS)]
    assert pairs == [(epoch, seed) for epoch in (1, 2) for seed in (3, 4, 5)]
    assert [row["epoch"] for row in run.rows(runs.TIMINGS)] == ["1", "2"]
    promised = ("epoch", "seed", "training_gain", "loss", "q_mean", "epsilon", "learning_rate")
    assert made.columns == (*promised, "decisions", "updates", "gain", "fraction_of_limit")
    events = EventAccumulator(str(run.path / "tensorboard"))
    events.Reload()
    tags = {f"{name}/seed_{seed}" for name in ("loss", "epsilon", "gain") for seed in (3, 4, 5)}
    assert tags | {"time/seconds"} <= set(events.Tags()["scalars"])
    assert [event.step for event in events.Scalars("loss/seed_3")] == [1, 2]


# --- what is left behind ------------------------------------------------------------------------------------


def test_a_policy_file_says_what_it_was_made_for_and_holds_no_times_or_paths(tmp_path):
    settings = short_settings(learning={"epochs": 2})
    run = whole(tmp_path / "run", settings)
    card = load_policy(run.path).card
    assert card["experiment"] == "linear_n4"
    assert card["n_records"] == 4
    assert card["settings"]["learning"]["epochs"] == 2
    assert str(tmp_path) not in str(card)
    assert "time" not in card
