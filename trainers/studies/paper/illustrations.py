"""The paper's twelve figures of results, drawn for one recipe."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from swarm import figures
from swarm.policies.policy import AnyPolicy
from swarm.policies.strategies import Swinging
from swarm.population.contest import population_test
from swarm.population.results import RIVAL
from trainers.studies.paper.measurements import Case
from trainers.studies.paper.plan import EGG, RECORDS, STEADY, VARYING, VORTICES
from trainers.studies.stacks import Key, TrainingCurve
from trainers.studies.study import FIGURES

FIRST = {name: 2 + 2 * place for place, name in enumerate((*RECORDS, VARYING))}  # figure of a case
Drawn = Iterator[tuple[int, str, Any, str]]  # number, file, figure, caption


class Drawing(NamedTuple):
    recipe: str
    number: int  # in the paper's order of results
    path: str  # in the folder of the reproduction
    caption: str


def draw_all(
    recipe: str, curves: Mapping[Key, TrainingCurve], tests: Sequence[Case], folder: Path
) -> list[Drawing]:
    """The figures of every training curve and test under a recipe, in the paper's order."""
    drawn = []
    mine = (_test(case, recipe) for case in tests if recipe in case.recipes)
    for number, name, figure, caption in itertools.chain(_training(recipe, curves), *mine):
        path = f"{FIGURES}/{recipe}/{name}.png"
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        figures.save(figure, folder / path)
        drawn.append(Drawing(recipe, number, path, caption))
    return sorted(drawn, key=lambda each: each.number)


def _training(recipe: str, curves: Mapping[Key, TrainingCurve]) -> Drawn:
    """Gain against epoch for each N_T, of validation cells and of the training cells themselves."""
    found = {f"$N_T = {RECORDS[name]}$": curves[recipe, name] for name in RECORDS if (recipe, name) in curves}
    if not found:
        return
    validation, exploring = {}, {}
    for name, curve in found.items():
        validation[name] = figures.Curve(curve.epoch, np.array(curve.gain), curve.greedy, curve.limit)
        exploring[name] = figures.Curve(curve.training_epoch, np.array(curve.training_gain))
    caption = (
        "Gain during training, of validation cells that always take the best action. Bands reach from the "
        "worst to the best training seed."
    )
    yield 1, "training", figures.training(validation), caption
    caption = (
        "Gain during training, of the training cells themselves, which explore and live less long: the "
        "paper's own measure, averaged over stretches of epochs."
    )
    yield 1, "training_cells", figures.training(exploring), caption


def _test(case: Case, recipe: str) -> Drawn:
    """Figures of one test; the policy of each kind is the one that validation prefers."""
    policies: dict[str, AnyPolicy] = {
        stack.kind: stack.choice for stack in case.stacks if stack.recipe == recipe
    }
    if case.name in FIRST:
        policies["swinging"] = Swinging()
    results = population_test(case.world, policies, cells=case.cells, life=case.world.life, seed=case.seed)
    yield from {EGG: _radial, VORTICES: _vortices}.get(case.name, _linear)(case, results)


def _radial(case: Case, results: xr.Dataset) -> Drawn:
    caption = (
        "Around an egg: (a) path of one cell steered by the network, (b) centrelines of "
        f"{case.cells} cells, until they arrive. Darker is more concentrated."
    )
    yield 10, "radial", figures.radial(results, case.world, policy="dqn", cells=case.cells), caption


def _linear(case: Case, results: xr.Dataset) -> Drawn:
    where = f"N_T = {case.world.n_records}" + (", varying speed" if case.world.varying_speed else "")
    where += f", lives of {case.world.life:g}."
    enlarged, number = case.name == STEADY, FIRST[case.name]
    shown = ["dqn", RIVAL, "swinging"]
    figure = figures.comparison(results, case.world, policies=shown, enlarged=enlarged)
    caption = (
        "One cell under each strategy: (a) its curvature, (b) its path"
        f"{', enlarged at its start' * enlarged}, (c) its gain. {where}"
    )
    yield number, f"{case.name}_comparison", figure, caption
    figure = figures.centrelines_and_gains(results, case.world, policies=shown[:2])
    caption = f"(a) Centrelines of some cells, (b) gains of {case.cells} cells; lines mark the means. {where}"
    yield number + 1, f"{case.name}_population", figure, caption


def _vortices(case: Case, results: xr.Dataset) -> Drawn:
    kinds = [name for name in ("aware", "blind", "still") if name in results["policy"].values]
    shown = [name for name in kinds if name != "still"]
    where, life = f"{case.cells} cells in the Taylor–Green flow", f"lives of {case.world.life:g}."
    caption = (
        f"Centrelines of {where}, steered by the network that senses it, by the one that does not, and by "
        f"greedy; {life} Brighter is faster flow."
    )
    figure = figures.centrelines(results, case.world, policies=[*shown, RIVAL])
    yield 11, "taylor_green_centrelines", figure, caption
    caption = f"Gains of {where}, also under the network that was trained in still water; {life}"
    yield 12, "taylor_green_gains", figures.gains(results, policies=[*kinds, RIVAL]), caption
