"""The paper's twelve figures of results, drawn for one recipe."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from swarm import figures
from swarm.policies.policy import Policy
from swarm.policies.strategies import Swinging
from swarm.population.contest import population_test
from swarm.population.results import RIVAL
from trainers.paper.curves import Curves
from trainers.paper.measurements import Case
from trainers.paper.statements import EGG, RECORDS, STEADY, VARYING, VORTICES

if TYPE_CHECKING:
    import xarray as xr

FOLDER = "figures"
FIRST = {name: 2 + 2 * place for place, name in enumerate((*RECORDS, VARYING))}  # figure of a case


class Drawing(NamedTuple):
    """A figure that was drawn."""

    recipe: str
    number: int  # in the paper's order of results
    path: str  # in the folder of the reproduction
    caption: str


def draw_training(recipe: str, curves: Curves, folder: Path) -> list[Drawing]:
    """Figure 1: gain against epoch for each N_T, of validation cells and of the training cells themselves."""
    found = {f"$N_T = {RECORDS[name]}$": curves[recipe, name] for name in RECORDS if (recipe, name) in curves}
    if not found:
        return []
    validation = {
        name: figures.Curve(curve.epoch, np.array(curve.gain), curve.greedy, curve.limit)
        for name, curve in found.items()
    }
    exploring = {
        name: figures.Curve(curve.training_epoch, np.array(curve.training_gain))
        for name, curve in found.items()
    }
    return [
        _saved(
            figures.training(validation),
            folder,
            Drawing(
                recipe,
                1,
                "training.png",
                "Gain during training, of validation cells that always take the best action. Bands reach "
                "from the worst to the best training seed.",
            ),
        ),
        _saved(
            figures.training(exploring),
            folder,
            Drawing(
                recipe,
                1,
                "training_cells.png",
                "Gain during training, of the training cells themselves, which explore and live less long: "
                "the paper's own measure, averaged over stretches of epochs.",
            ),
        ),
    ]


def draw_tests(tests: Sequence[tuple[Case, int]], recipe: str, folder: Path) -> list[Drawing]:
    """Figures of every test, each with so many cells."""
    return [each for case, cells in tests for each in draw_case(case._replace(cells=cells), recipe, folder)]


def draw_case(case: Case, recipe: str, folder: Path) -> list[Drawing]:
    """Figures of one test; the policy of each kind is the one that validation prefers."""
    policies: dict[str, Policy] = {
        stack.kind: stack.choice for stack in case.stacks if stack.recipe == recipe
    }
    if case.name in FIRST:
        policies["swinging"] = Swinging()
    results = population_test(case.world, policies, cells=case.cells, life=case.world.life, seed=case.seed)
    if case.name == EGG:
        return [_radial(case, recipe, results, folder)]
    if case.name == VORTICES:
        return _vortices(case, recipe, results, folder)
    return _linear(case, recipe, results, folder)


def _linear(case: Case, recipe: str, results: xr.Dataset, folder: Path) -> list[Drawing]:
    where = f"N_T = {case.world.n_records}" + (", varying speed" if case.world.varying_speed else "")
    life = f"lives of {case.world.life:g}"
    enlarged = case.name == STEADY
    one = figures.comparison(results, case.world, policies=["dqn", RIVAL, "swinging"], enlarged=enlarged)
    many = figures.centrelines_and_gains(results, case.world, policies=["dqn", RIVAL])
    number = FIRST[case.name]
    return [
        _saved(
            one,
            folder,
            Drawing(
                recipe,
                number,
                f"{case.name}_comparison.png",
                "One cell under each strategy: (a) its curvature, (b) its path"
                f"{', enlarged at its start' * enlarged}, (c) its gain. {where}, {life}.",
            ),
        ),
        _saved(
            many,
            folder,
            Drawing(
                recipe,
                number + 1,
                f"{case.name}_population.png",
                f"(a) Centrelines of some cells, (b) gains of {case.cells} cells; lines mark the means. "
                f"{where}, {life}.",
            ),
        ),
    ]


def _radial(case: Case, recipe: str, results: xr.Dataset, folder: Path) -> Drawing:
    caption = (
        "Around an egg: (a) path of one cell steered by the network, (b) centrelines of "
        f"{case.cells} cells, until they arrive. Darker is more concentrated."
    )
    figure = figures.radial(results, case.world, policy="dqn", cells=case.cells)
    return _saved(figure, folder, Drawing(recipe, 10, "radial.png", caption))


def _vortices(case: Case, recipe: str, results: xr.Dataset, folder: Path) -> list[Drawing]:
    kinds = [name for name in ("aware", "blind", "still") if name in results["policy"].values]
    shown = [name for name in kinds if name != "still"]
    life = f"lives of {case.world.life:g}"
    lines = figures.centrelines(results, case.world, policies=[*shown, RIVAL])
    return [
        _saved(
            lines,
            folder,
            Drawing(
                recipe,
                11,
                "taylor_green_centrelines.png",
                f"Centrelines of {case.cells} cells in the Taylor–Green flow, steered by the network that "
                f"senses it, by the one that does not, and by greedy; {life}. Brighter is faster flow.",
            ),
        ),
        _saved(
            figures.gains(results, policies=[*kinds, RIVAL]),
            folder,
            Drawing(
                recipe,
                12,
                "taylor_green_gains.png",
                f"Gains of {case.cells} cells in the Taylor–Green flow, also under the network that was "
                f"trained in still water; {life}.",
            ),
        ),
    ]


def _saved(figure: object, folder: Path, drawing: Drawing) -> Drawing:
    path = f"{FOLDER}/{drawing.recipe}/{drawing.path}"
    (folder / path).parent.mkdir(parents=True, exist_ok=True)
    figures.save(figure, folder / path)
    return drawing._replace(path=path)
