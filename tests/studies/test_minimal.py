"""The study of the smallest brain in miniature, through everything that a whole one goes through."""

import csv
import dataclasses
import random
import re

import numpy as np
import pytest

from swarm._support.streams import generator
from trainers.studies.minimal import measurements, neuroevolution
from trainers.studies.minimal.plan import MinimalPlan
from trainers.studies.minimal.report import STUDY
from trainers.training import run as running

pytest.importorskip("cma")
neat = pytest.importorskip("neat")

WORDS = ("world.life=4.0", "learning.epochs=1", "learning.batch_size=16", "learning.n_swimmers=4")
WORDS += ("validation={cells: 4, life: 4.0}", "evaluation.life=8.0", "compile=never")
TINY = MinimalPlan(
    n_seeds=2,
    words=WORDS,
    workers=0,
    nodes=(0, 2),
    most_thinned=4,
    candidates=4,
    generations=1,
    genomes=12,
    neat_generations=2,
    fitness_cells=3,
    fitness_life=4.0,
    records=(2, 3),
    bins=(2,),
    cells=4,
)


def carried_out(study, plan, folder):
    """The folder that a plan reports into, beside which it is published."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(running, "draw", lambda training, run: None)  # of each training
        study.carry_out(plan, folder / "out", folder / "published")
    return folder / "out"


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return carried_out(STUDY, TINY, tmp_path_factory.mktemp("minimal"))


def test_every_rung_and_figure_is_there(out):
    with (out / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["method"] for row in rows} == set(measurements.METHODS)
    assert [row["parameters"] for row in rows if row["method"] == "evolution"] == ["9", "21"]
    assert [row["parameters"] for row in rows if row["method"] == "thinned"] == ["4", "3", "2", "1"]
    report = (out / "report.md").read_text()
    shown = re.findall(r"!\[.*?\]\((.*?)\)", report)
    assert {"figures/parameters.png", "figures/brain_linear_n4.svg"} == set(shown)
    published = out.with_name("published")
    assert all((published / path).stat().st_size > 1000 for path in shown)
    assert not (published / "runs").exists()


def test_what_was_searched_is_not_searched_again(out, monkeypatch):
    monkeypatch.setattr(measurements, "rungs", lambda *_: pytest.fail("searched again"))
    before = (out / "results.csv").read_bytes()
    STUDY.carry_out(dataclasses.replace(TINY, records=()), out)  # tables are no searches
    assert (out / "results.csv").read_bytes() == before


def test_networks_of_neat_are_those_of_the_package_and_global_chance_stays_as_it_was():
    state = random.getstate()
    found = neuroevolution.champions(TINY.training_world("linear_n4"), TINY, 0)
    assert random.getstate() == state
    assert len({*found.parameters.tolist()}) == len(found)
    config = neuroevolution._config(8, 40)
    random.seed(1)
    population = neat.Population(config)
    for _ in range(12):  # of which some grow
        for genome in population.population.values():
            genome.mutate(config.genome_config)
    random.setstate(state)
    seen = generator("test", "start", 0).normal(size=(1, 6, 8))
    for genome in population.population.values():
        network = neat.nn.FeedForwardNetwork.create(genome, config)
        theirs = [network.activate(row)[0] for row in seen[0].tolist()]
        ours = neuroevolution.brain_of(genome, config).values(seen)[0]
        np.testing.assert_allclose(np.tanh(ours), np.array(theirs), rtol=1e-9)
