"""The paper's twelve figures of results, drawn for one recipe."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm import figures
from swarm.policies.policy import AnyPolicy
from swarm.policies.strategies import Swinging
from swarm.population.contest import population_test
from swarm.population.results import RIVAL
from trainers.paper.measurements import Case
from trainers.paper.plan import EGG, RECORDS, STEADY, VARYING, VORTICES
from trainers.paper.stacks import Curves, TrainingCurve

if TYPE_CHECKING:
    import xarray as xr

FOLDER = "figures"
FIRST = {name: 2 + 2 * place for place, name in enumerate((*RECORDS, VARYING))}  # figure of a case
Drawn = Iterator[tuple[int, str, Any, str]]  # number, file, figure, caption


class Drawing(NamedTuple):
    """A figure that was drawn."""

    recipe: str
    number: int  # in the paper's order of results
    path: str  # in the folder of the reproduction
    caption: str


def draw_training(recipe: str, curves: Curves, folder: Path) -> list[Drawing]:
    """Figure 1: gain against epoch for each N_T, of validation cells and of the training cells themselves."""
    found = {f"$N_T = {RECORDS[name]}$": curves[recipe, name] for name in RECORDS if (recipe, name) in curves}
    return _saved(_training(found), recipe, folder) if found else []


def draw_tests(tests: Sequence[tuple[Case, int]], recipe: str, folder: Path) -> list[Drawing]:
    """Figures of every test, each with so many cells."""
    return [
        each
        for case, cells in tests
        for each in _saved(_test(case._replace(cells=cells), recipe), recipe, folder)
    ]


def _saved(drawn: Drawn, recipe: str, folder: Path) -> list[Drawing]:
    saved = []
    for number, name, figure, caption in drawn:
        path = f"{FOLDER}/{recipe}/{name}.png"
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        figures.save(figure, folder / path)
        saved.append(Drawing(recipe, number, path, caption))
    return saved


def _training(curves: Mapping[str, TrainingCurve]) -> Drawn:
    validation = {
        name: figures.Curve(curve.epoch, np.array(curve.gain), curve.greedy, curve.limit)
        for name, curve in curves.items()
    }
    caption = (
        "Gain during training, of validation cells that always take the best action. Bands reach from the "
        "worst to the best training seed."
    )
    yield 1, "training", figures.training(validation), caption
    exploring = {
        name: figures.Curve(curve.training_epoch, np.array(curve.training_gain))
        for name, curve in curves.items()
    }
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
    if case.name == EGG:
        yield (
            10,
            "radial",
            figures.radial(results, case.world, policy="dqn", cells=case.cells),
            "Around an egg: (a) path of one cell steered by the network, (b) centrelines of "
            f"{case.cells} cells, until they arrive. Darker is more concentrated.",
        )
    else:
        yield from (_vortices if case.name == VORTICES else _linear)(case, results)


def _linear(case: Case, results: xr.Dataset) -> Drawn:
    where = f"N_T = {case.world.n_records}" + (", varying speed" if case.world.varying_speed else "")
    where += f", lives of {case.world.life:g}."
    enlarged, number = case.name == STEADY, FIRST[case.name]
    yield (
        number,
        f"{case.name}_comparison",
        figures.comparison(results, case.world, policies=["dqn", RIVAL, "swinging"], enlarged=enlarged),
        "One cell under each strategy: (a) its curvature, (b) its path"
        f"{', enlarged at its start' * enlarged}, (c) its gain. {where}",
    )
    yield (
        number + 1,
        f"{case.name}_population",
        figures.centrelines_and_gains(results, case.world, policies=["dqn", RIVAL]),
        f"(a) Centrelines of some cells, (b) gains of {case.cells} cells; lines mark the means. {where}",
    )


def _vortices(case: Case, results: xr.Dataset) -> Drawn:
    kinds = [name for name in ("aware", "blind", "still") if name in results["policy"].values]
    shown: Iterable[str] = [name for name in kinds if name != "still"]
    life = f"lives of {case.world.life:g}."
    yield (
        11,
        "taylor_green_centrelines",
        figures.centrelines(results, case.world, policies=[*shown, RIVAL]),
        f"Centrelines of {case.cells} cells in the Taylor–Green flow, steered by the network that senses it, "
        f"by the one that does not, and by greedy; {life} Brighter is faster flow.",
    )
    yield (
        12,
        "taylor_green_gains",
        figures.gains(results, policies=[*kinds, RIVAL]),
        f"Gains of {case.cells} cells in the Taylor–Green flow, also under the network that was trained in "
        f"still water; {life}",
    )
