"""Settings: composed from files and words, checked before anything runs, every key with what it cannot be."""

import contextlib
import dataclasses

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from trainers.settings.composition import SettingsError, names_of, settings_from, settings_from_stored
from trainers.settings.schema import Settings

EXPERIMENTS = ["linear_n2", "linear_n4", "linear_n8", "varying_speed", "radial", "taylor_green_aware"]
EXPERIMENTS += ["taylor_green_blind", "crowd_uptake", "race", "shear", "film", "continuous_n4"]
EXPERIMENTS += ["binding", "space"]
DEFAULTS = Settings().dotted()
KEYS = [("dqn", key) for key in DEFAULTS] + [
    ("ppo", key) for key in Settings(algorithm="ppo").dotted() if key.startswith("learning.")
]
KEYS += [("drqn", f"learning.{name}") for name in ("seen", "nodes", "burn_in")]

WRONG = {  # for a key of each type: of another type, of the wrong sign, size
    bool: ["abc", 2, 0.5, None, [True], {}],
    int: ["abc", 1.5, -1, None, [1], {"a": 1}, float("nan"), float("inf")],
    float: ["abc", -1.0, None, [1.0], {}, float("nan"), float("inf"), -float("inf"), 1e300],
    str: ["no such thing", "", 5, None, ["linear"], {}],
    list: ["abc", 3, [], ["abc"], [-1, 2], [float("nan"), 1], None, {}, [[1], [2]]],
}
WRONG_PARTS = {  # of keys that are None or empty by default
    "evaluation.field": WRONG[str],
    "world.sensor": WRONG[str],
    "world.start_box": [*WRONG[list], [[0, 1]], [[1, 0], [0, 1]], [[0, 1e9], [0, 1]]],
    "world.interactions": ["no such thing", 5, None, ["contact", 3], {}, [{"type": "contact", "a": 1}]],
    "world.medium": ["abc", 3, [1], {"a": 1}, {"uptake": -1.0}, {"shape": 5}],
    "world.first_arrivals": [value for value in WRONG[int] if value is not None],
    "world.binding_rate": [value for value in WRONG[float] if value is not None],
    "world.curvature_range": [value for value in WRONG[list] if value is not None],
    "world.torsions": [*(value for value in WRONG[list] if value is not None), [1.0], ["a", 1.0]],
    "world.units": ["abc", 3, [1], {"a": 1}, ["µm"], ["µm", ""]],
    "world.spread": ["abc", 3, [1], {"a": 1}, {"speed": -1.0}, {"speed": 1.0}],
}
RIGHT = [  # only look wrong
    *(("learning.hidden", []), ("evaluation.field", None), ("world.sensor", None)),
    *(("world.start_box", None), ("world.torsions", [-1, 2])),
]
FREE = ("experiment", "recipe", "algorithm")  # any printable text: the name of the run; and what chooses keys
UNBOUNDED = ("noise", "diffusion", "learning_rate", "decay", "entropy", "weight", "max_gradient", "rate")


def nested(key, value):
    for name in reversed(key.split(".")):
        value = {name: value}
    return value


@pytest.mark.parametrize(("algorithm", "key"), [pair for pair in KEYS if pair[1] not in FREE])
def test_every_key_refuses_other_types_signs_and_sizes_by_name(algorithm, key):
    default = Settings(algorithm=algorithm).dotted()[key]
    for value in WRONG_PARTS.get(key) or WRONG[type(default)]:
        if (key, value) in RIGHT or (value == 1e300 and key.endswith(UNBOUNDED)):
            continue
        with pytest.raises(SettingsError) as error:
            settings_from_stored({"algorithm": algorithm} | nested(key, value))
        assert key.split(".")[-1] in str(error.value), value
        assert key.split(".")[0] in str(error.value), value
        assert "\n" not in str(error.value)


json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


names = st.sampled_from([*dataclasses.asdict(Settings()), "other"]) | st.text(max_size=5)
key_and_value = st.builds(nested, st.sampled_from(sorted(DEFAULTS)), json)


@given(stored=key_and_value | st.dictionaries(names, json, max_size=3))
@settings(max_examples=100)
def test_whatever_is_stored_there_are_settings_or_a_message(stored):
    with contextlib.suppress(SettingsError):
        assert isinstance(settings_from_stored(stored), Settings)


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("+foo=1", "a setting must be written key=value, got '+foo=1'"),
        ("", "a setting must be written key=value, got ''"),
        ("sed=1", "settings have no key 'sed'; did you mean 'seed'?"),
        ("learning.epoch=1", "settings have no key 'learning.epoch'; did you mean 'learning.epochs'?"),
        ("world._target_=os.system", "settings have no key 'world._target_'"),
        ("experiment=linear_4", "got 'linear_4'; did you mean 'linear_n4'?"),
        ("experiment=", "experiment must be one of binding, continuous_n4"),
        ("experiment=[linear_n2,linear_n4]", "experiment must be one of"),
        ("recipe=papers", "recipe must be one of paper, swarm, got 'papers'; did you mean 'paper'?"),
        ("tuning=nothing", "tuning must be one of"),
        ("seed=0,1", "seed"),
        ("seed=???", "seed"),
        ("seed=${seed}", "seed"),
        ("seed=${nothing}", "seed"),
        ("seed=99999999999999999999", "seed must be at most 9223372036854775807"),
        ("evaluate=yes", "evaluate must be true or false, got 'yes'"),
        ("world.sense_flow=true", "world.sense_flow must go with a flow"),
        ("world.curvatures=[5.0,3.0]", "world.curvatures must rise and be positive, got (5.0, 3.0)"),
        ("seed=[3", "the value cannot be read, other signs than letters need quotes, got 'seed=[3'"),
        ("world.flow=taylor-green", "did you mean 'taylor_green'?"),
        ("world.start_box=[[0,1e9],[0,1]]", "world.start_box must lie within"),
        ("learning.hidden=[0]", "learning.hidden[0] must be at least 1, got 0"),
        ("learning.hidden=[5000]", "learning.hidden must be at most 15 layers of at most 4096 nodes"),
        ("learning.hidden=[4096,4096]", "learning.hidden must make a policy of at most"),
        ("learning.epsilon_start=0.01", "learning.epsilon_end must not be above epsilon_start"),
        ("learning.target_rate=0", "learning.target_rate must be above 0, got 0"),
        ("validation.life=1e300", "validation.life must be at most"),
        ("device=gpu", "device must be cpu, mps, cuda or cuda:N, got 'gpu'"),
        ("compile=maybe", "compile must be one of always, auto, never, got 'maybe'"),
        ("hydra.job.chdir=true", "of Hydra's own keys only hydra.run.dir=DIR may be given"),
        ("+hydra.verbose=true", "of Hydra's own keys"),
        ("++hydra={run:{dir:a}}", "of Hydra's own keys"),
        ("~hydra", "of Hydra's own keys"),
        ("hydra@there=basic", "of Hydra's own keys"),
        ("'hydra'={searchpath:[a]}", "of Hydra's own keys"),
    ],
)
def test_a_bad_word_says_what_is_wrong(word, said):
    with pytest.raises(SettingsError) as error:
        settings_from([word])
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("experiment", EXPERIMENTS)
@pytest.mark.parametrize("recipe", ["swarm", "paper"])
def test_every_experiment_goes_with_every_recipe(experiment, recipe):
    made = settings_from([f"experiment={experiment}", f"recipe={recipe}"])
    assert (made.experiment, made.recipe) == (experiment, recipe)
    assert made.training_world().life == made.world["life"]
    assert made.test_world().life == made.evaluation.life


def test_the_experiments_and_recipes_are_those_promised():
    assert names_of("experiment") == sorted(EXPERIMENTS)
    assert names_of("recipe") == ["paper", "swarm"]
    assert names_of("algorithm") == ["dqn", "drqn", "evolution", "ppo"]
    made = settings_from()
    assert (made.experiment, made.recipe, made.seed) == ("linear_n4", "swarm", 0)


def test_words_win_over_files_and_files_over_defaults():
    made = settings_from(["experiment=linear_n8", "learning.batch_size=7"])
    assert made.world["n_records"] == 8
    assert made.learning.batch_size == 7
    assert made.learning.loss == "huber"
    assert made.learning.discount == 0.98


@pytest.mark.parametrize("experiment", ["linear_n4", "radial"])
def test_settings_come_back_from_what_a_run_stores(experiment):
    words = [f"experiment={experiment}", "world.start_box=[[-1,1],[-2,3]]", "learning.hidden=[4]"]
    made = settings_from(words)
    assert settings_from_stored(dataclasses.asdict(made)) == made


def test_an_interpolation_is_the_users_own_but_never_a_files():
    assert settings_from(["evaluation.seed=${seed}", "seed=4"]).evaluation.seed == 4
    with pytest.raises(SettingsError, match=r"stored settings: evaluation.seed must be a whole number"):
        settings_from_stored({"evaluation": {"seed": "${seed}"}})
    with pytest.raises(SettingsError, match=r"device must be cpu, mps, cuda or cuda:N, got '\$"):
        settings_from_stored({"device": "${oc.env:HOME}"})


def test_parts_of_a_world_have_parameters_of_which_all_are_stored():
    made = settings_from(["world.flow={type: vortex, core: 3}", "evaluation.field={type: radial}"])
    own = {"type": "vortex", "centre": [5.0, 5.0]}
    assert made.world["flow"] == made.training_world().flow.__dict__ | own
    assert made.evaluation.field["egg_radius"] == made.test_world().egg[1]
    assert settings_from_stored(dataclasses.asdict(made)) == made


COUPLED = "world.interactions=[{type: contact, diameter: 0.05, stiffness: 20.0}]"


@pytest.mark.parametrize(
    ("words", "cells"),
    [
        ([], (40, 40)),
        ([COUPLED], (7, 7)),
        ([COUPLED, "evaluation.cells=5"], (7, 5)),
        ([COUPLED, "validation.cells=4", "evaluation.cells=5"], (4, 5)),
        ([COUPLED, "recipe=swarm"], (100, 7)),  # which the recipe says
        (["experiment=film"], (200, 200)),
    ],
)
def test_coupled_cells_are_tested_in_the_crowd_that_was_trained_in(words, cells):
    recipe = [] if "recipe=swarm" in words else ["recipe=paper"]
    made = settings_from(["learning.n_swimmers=7", *recipe, *words])
    for each in (made, settings_from_stored(yaml.safe_load(made.as_yaml()))):
        assert (each.validation.cells, each.evaluation.cells) == cells
