"""Brains: what they decide, what is left of them when they are pruned, and their drawings."""

import itertools
import json
import re
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import pytest

from swarm import World, load_policy
from swarm.physics.starts import draw_starts
from swarm.policies.network import Network
from swarm.population.blocks.block import lives
from trainers.studies.minimal import drawing, search
from trainers.studies.minimal.brain import Brains, brains_of, gains, stacked
from trainers.studies.minimal.plan import MinimalPlan
from trainers.studies.minimal.tables import LookupTables

WORLD = World(life=6.0)
PUBLISHED = Path(__file__).parents[2] / "docs" / "results" / "minimal"
RANDOM = np.random.default_rng(0)


def random_brains(count, nodes, inputs=8, linked=True):
    weights = RANDOM.normal(size=(count, nodes + 1, inputs + nodes))
    weights[:, :, inputs:] *= np.tri(nodes + 1, nodes, -1) if linked else np.eye(nodes + 1)[-1:, :1].T.T
    return Brains(weights, RANDOM.normal(size=(count, nodes + 1)))


@pytest.mark.parametrize("hidden", [[], [5]])
def test_a_brain_decides_as_the_network_it_is_of(hidden):
    sizes = [8, *hidden, 2]
    layers = [(RANDOM.normal(size=(b, a)), RANDOM.normal(size=b)) for a, b in itertools.pairwise(sizes)]
    network = Network(*zip(*layers, strict=True), {"n_records": 4, "features": 2})
    seen = RANDOM.normal(size=(1, 200, 8)).astype(np.float32)
    np.testing.assert_array_equal(brains_of([network]).values(seen) > 0, network(seen) == 1)


def test_deeper_networks_have_no_brain():
    with pytest.raises(
        ValueError, match="a brain must have one hidden layer at most and two actions, got Net"
    ):
        brains_of([load_policy("zoo:linear_n2")])


def test_nodes_add_up_inputs_and_earlier_nodes():
    brain = Brains(np.array([[[2.0, 0, 0, 0], [0, 1, 3, 0], [0, 0.5, 0, 1]]]), np.array([[0.1, 0.0, -0.2]]))
    first = np.tanh(2 * 0.3 + 0.1)
    expected = 0.5 * -0.4 + np.tanh(-0.4 + 3 * first) - 0.2
    seen = np.array([[[0.3, -0.4]]])
    assert brain.values(seen)[0, 0] == pytest.approx(expected)
    assert brain.parameters.tolist() == [7]
    wider = stacked([brain, random_brains(1, 3, inputs=2)])
    assert wider.values(np.repeat(seen, 2, axis=0))[0, 0] == pytest.approx(expected)


def test_lives_side_by_side_are_those_of_each_alone():
    brains, starts = random_brains(3, 2), draw_starts(WORLD, 5, 0)
    found = gains(WORLD, brains, starts, 0, population="test")
    for place in range(3):
        alone = lives(WORLD, brains[place : place + 1], starts, 0, name="alone", population="test")["gain"]
        np.testing.assert_array_equal(found[place], alone)


def test_pruning_leaves_the_largest_numbers():
    brains = random_brains(2, 2)
    for left in (1, 7):
        flat = search.without_smallest(brains, left).flat
        assert np.count_nonzero(flat, axis=1).tolist() == [left, left]
        kept = np.abs(brains.flat[flat != 0])
        assert kept.min() >= np.abs(brains.flat[(flat == 0)]).max() or len(kept) > left
    sizes = [int(each.parameters.max()) for each in search.pruned(brains)]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[-1] == 1


def test_the_two_state_machine_holds_on_to_its_curvature_between_its_thresholds():
    pytest.importorskip("cma")
    plan = MinimalPlan(n_seeds=2, candidates=8, generations=8, fitness_cells=8)
    world = WORLD.replace(life=20.0)
    found = search.machine(world, plan)
    assert found.parameters.tolist() == [3, 3]
    low, high = (-found.biases[:, 0] - sign * found.weights[:, 0, 1] for sign in (1, -1))
    assert (low < high).all()
    starts = draw_starts(world, 10, 0, population="validation")
    assert (gains(world, found, starts, 0, population="validation").mean(axis=1) > 2.4).all()


def test_a_search_without_nodes_leaves_as_many_parameters_as_are_asked_for():
    pytest.importorskip("cma")
    plan = MinimalPlan(n_seeds=2, candidates=4, generations=1, fitness_cells=2)
    assert search.linear(WORLD, plan, 3).parameters.tolist() == [3, 3]


def test_a_table_decides_by_bins_of_the_two_newest_records():
    entries = np.zeros((1, 4 * 16))
    tables = LookupTables(4, entries)
    state = WORLD.start(*(part[None] for part in draw_starts(WORLD, 50, 0)))
    seen, places = WORLD.observation(state)[0], tables.place(WORLD, state)[0]
    entries[0, places[7]] = 1.0
    bins = np.clip(((seen / 1.2 + 1) * 2).astype(int), 0, 3)
    same = (bins[:, [0, 2]] == bins[7, [0, 2]]).all(-1) & (seen[:, [1, 3]] == seen[7, [1, 3]]).all(-1)
    np.testing.assert_array_equal(tables.act(WORLD, state)[0], same)


# --- drawings -----------------------------------------------------------------------------------------------


class TypedIn(NamedTuple):
    """What the lines of a drawing say, as a policy of two actions."""

    lines: list

    def decides(self, observation):
        text = "\n".join(self.lines).translate(str.maketrans("₀₁₂₃₄₅₆₇₈₉−", "0123456789-"))
        text = re.sub(r"([0-9]) (?=[cκh])", r"\1 * ", text).replace("κ2 where", "above =")
        columns = enumerate(np.moveaxis(observation, -1, 0))
        named = {f"{'cκ'[place % 2]}{place // 2}": column for place, column in columns}
        exec(text, {"tanh": np.tanh}, named)
        return named["above"]

    def act(self, world, state, uniform=None):
        return self.decides(world.observation(state).astype(float)).astype(np.int32)


def typed_in(path):
    """The formulas that a reader of a drawing can type in."""
    texts = ["".join(each.itertext()).strip() for each in ElementTree.parse(path).findall(".//{*}text")]
    return TypedIn([line for line in texts if re.match(r"h[₀-₉]+ = tanh|κ₂ where", line)])


@pytest.mark.parametrize("nodes", [0, 1, 12])
def test_what_is_typed_in_from_a_drawing_is_what_was_drawn(nodes, tmp_path):
    brain = search.without_smallest(random_brains(1, nodes), 6 + 12 * nodes)
    drawn = drawing.rounded(brain, 2)
    drawing.draw(drawn, 2, "a brain", tmp_path / "brain.svg")
    seen = RANDOM.normal(size=(1, 300, 8))
    np.testing.assert_array_equal(typed_in(tmp_path / "brain.svg").decides(seen), drawn.values(seen) > 0)
    assert np.abs(drawn.weights[0, -1]).max() == 1


def test_idle_nodes_are_not_drawn():
    brain = Brains(np.array([[[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 2]]]), np.zeros((1, 3)))
    assert drawing.formulas(drawing.rounded(brain, 1), 1) == ["h₀ = tanh(+ 1.0 κ₀)", "κ₂ where + 1.0 h₀ > 0"]


def test_words_tell_the_lag_and_the_thresholds():
    brain = Brains(np.array([[[1.0, 0.8, 0, 0, 0, 0, 0, 0]]]), np.array([[-0.4]]))
    told = drawing.words(brain, World())
    assert "-0.40 while the records are of κ₂ and +1.20 while they are of κ₁" in told
    assert "45° behind" in told
    older = Brains(np.array([[[0, 0, 1.0, 0, 0, 0, 0, 0]]]), np.array([[0.0]]))
    turned = np.degrees(World().mean_curvature * World().intervals[0])
    mean = np.mean(np.exp(-1j * np.radians(turned) * np.arange(4)))
    lag = -np.degrees(np.angle(np.exp(-1j * np.radians(turned)) - mean))
    assert f"{lag:.0f}° of a turn behind it" in drawing.words(older, World())


@pytest.mark.parametrize(
    ("torsions", "said"),
    [((7.7, 5.7), "135° behind"), ((-7.7, -5.7), "135° behind"), ((5.7, 7.9), "45° ahead of it")],
)
def test_in_space_words_tell_the_lag_with_which_brains_climb_most(torsions, said):
    world = World(n_records=4, curvatures=(6.4, 6.6), torsions=torsions, speed=2.0, life=30.0)
    brain = Brains(np.zeros((8, 1, 8)), np.zeros((8, 1)))
    brain.weights[:, 0, :8:2] = np.cos(np.radians(45.0) * (np.arange(8)[:, None] - 2 * np.arange(4)))
    starts = draw_starts(world, 20, 0)
    best = int(gains(world, brain, starts, 0, population="test").mean(axis=1).argmax())
    follows, ideal = drawing.words(brain[best : best + 1], world).split(" A helix ")
    assert ideal.endswith(f"that is {said}.")
    told, meant = (re.search(r"(\d+)° (?:of a turn )?(behind|ahead)", text) for text in (follows, ideal))
    assert told[2] == meant[2]
    assert abs(int(told[1]) - int(meant[1])) < 25


@pytest.mark.parametrize("path", sorted(PUBLISHED.glob("figures/brain_*.svg")), ids=lambda path: path.stem)
def test_the_published_drawing_gains_what_the_report_says(path):
    record = json.loads((PUBLISHED / "reproduction.json").read_text())
    case, plan, typed = path.stem.removeprefix("brain_"), record["plan"], typed_in(path)
    world = MinimalPlan(cases=(case,)).test_world(case)
    starts = draw_starts(world, plan["cells"], plan["seed"])
    gain = lives(world, typed, starts, plan["seed"], name="typed", population="test")["gain"]
    assert gain.mean() == pytest.approx(record["drawn"][case]["gain"], abs=1e-6)
    assert "\n".join(typed.lines) in (PUBLISHED / "report.md").read_text()
