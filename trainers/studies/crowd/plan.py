"""The plan of the experiments on crowds: what is trained, and in which worlds it is measured.

Sizes follow what a decision costs, measured on one core: 0.7 ms for a world of 40 cells in the medium of
50 × 150 nodes, the coarsest that `Medium.check` allows, 3 ms for one of 640; 0.03 ms for a race of 20 cells;
12 µs a cell in shear, whose egg is 48 clouds; 0.3 s for a film of 200 cells that touch. So lives in the film
are short, and its worlds are few.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from swarm._support.streams import Population
from swarm.physics.fields import ShearedSource
from swarm.physics.flows import ShearFlow, StillWater
from swarm.physics.world import World
from trainers.studies.plan import TrainingPlan
from trainers.studies.stacks import Stack

UPTAKE, FINE, RACE, SHEAR, FILM = "uptake", "fine", "race", "shear", "film"
ALONE, CROWD = "linear_n4", "crowd_uptake"
TRAININGS = {  # and the words that choose their settings
    ALONE: ("experiment=linear_n4",),
    "crowd_uptake_wake": (
        "experiment=crowd_uptake",
        "learning={n_swimmers: 1, n_worlds: 40}",
        "validation.cells=1",
    ),
    CROWD: ("experiment=crowd_uptake",),
    "crowd_uptake_160": ("experiment=crowd_uptake", "learning.n_swimmers=160", "validation.cells=160"),
    "crowd_uptake_ppo": ("experiment=crowd_uptake", "algorithm=ppo", "learning.critic=central"),
    RACE: ("experiment=race",),
    # who never wins is paid nothing, so all begin near the egg, and it lets five in
    "race_arrival": (
        "experiment=race",
        "world={reward: arrival, first_arrivals: 5, life: 60.0, start_box: [[1.5, 6.0], [-2.0, 2.0]]}",
        "learning={n_worlds: 16, epochs: 60, n_steps: 10, keep: last}",
        "validation={life: 60.0, every: 20}",
    ),
    SHEAR: ("experiment=shear",),
}
TESTED = {  # in each experiment: what figures call a policy, and what it was trained on
    UPTAKE: {
        "alone": ALONE,
        "wake": "crowd_uptake_wake",
        "crowd": CROWD,
        "crowd_160": "crowd_uptake_160",
        "crowd_ppo": "crowd_uptake_ppo",
    },
    FINE: {"wake": "crowd_uptake_wake", "crowd": CROWD},
    RACE: {"own": RACE, "arrival": "race_arrival"},
    SHEAR: {"learnt": SHEAR},
    FILM: {"alone": ALONE},
}
SHIPPED = {  # the trainings, and POINT/KIND of what their cards tell
    CROWD: f"{UPTAKE}_40/crowd",
    RACE: f"{RACE}_0.5/own",
    SHEAR: f"{SHEAR}_0.08/learnt",
}
VARIANTS = {"neither": (), "contact": (0,), "dipoles": (1,), "both": (0, 1)}  # of the film's interactions


@dataclass(frozen=True)
class CrowdPlan(TrainingPlan):
    experiments: tuple[str, ...] = tuple(TRAININGS)
    # cells of a world that eat, and how many such worlds
    crowds: tuple[tuple[int, int], ...] = ((1, 40), (10, 16), (40, 10), (160, 6), (640, 5))
    finely: tuple[tuple[int, int], ...] = ((40, 10),)  # of them, those that also live on a finer mesh
    shares: tuple[float, ...] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # of the learnt in a race
    races: int = 400  # worlds for each share: at 0.1 they are 40 turns
    shear_rates: tuple[float, ...] = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32)  # γ [1 / time]
    shear_cells: int = 1000
    # cells in shear start anywhere in a stretch of water that is long beside what the egg has released
    shear_box: tuple[tuple[float, float], tuple[float, float]] = ((-20.0, 20.0), (-5.0, 5.0))
    films: int = 4  # worlds
    film_cells: int = 200
    seed: int = 200  # of the test populations

    def chosen(self, experiment: str) -> tuple[str, ...]:
        """The words that choose the settings of a training, or of the film, in which nobody is trained."""
        return TRAININGS.get(experiment) or super().chosen(experiment)


class Point(NamedTuple):
    """One place of a figure: a world, who lives in it, and whose policies are tested."""

    experiment: str
    value: str  # number of cells, share of the crowd, shear rate, variant
    world: World
    cells: int
    worlds: int
    seed: int
    stacks: tuple[Stack, ...]
    population: Population = "test"

    @property
    def name(self) -> str:
        return f"{self.experiment}_{self.value}" + "_choice" * (self.population != "test")


def points(plan: CrowdPlan, trained: Mapping[str, Stack]) -> list[Point]:
    """Every place of every figure, for the stacks there are of each training."""

    def tested(experiment: str) -> tuple[Stack, ...]:
        kinds = TESTED[experiment].items()
        return tuple(trained[name]._replace(kind=kind) for kind, name in kinds if name in trained)

    def at(experiment: str, value: object, world: World, cells: int, worlds: int) -> Point:
        return Point(experiment, str(value), world, cells, worlds, plan.seed, tested(experiment))

    eating, racing, film = plan.world(CROWD), plan.world(RACE), plan.world(FILM)
    found = [at(UPTAKE, cells, eating, cells, worlds) for cells, worlds in plan.crowds]
    if tested(FINE):
        found += [at(FINE, cells, finer(eating), cells, worlds) for cells, worlds in plan.finely]
    if tested(RACE):
        cells = plan.settings(plan.recipes[0], RACE).evaluation.cells
        found += [at(RACE, share, racing, cells, plan.races) for share in plan.shares]
    for rate, world in sheared(plan):
        here = at(SHEAR, f"{rate:g}", world, plan.shear_cells, 1)
        found += [here, here._replace(population="validation")]
    for name, chosen in VARIANTS.items():
        world = film.replace(interactions=tuple(film.interactions[i] for i in chosen))
        found.append(at(FILM, name, world, plan.film_cells, plan.films))
    return found


def finer(world: World) -> World:
    """The same world with meshes of half the width."""
    medium = world.medium
    assert medium is not None
    nx, ny = medium.shape
    return world.replace(medium=dataclasses.replace(medium, shape=(2 * nx, 2 * ny)))


def sheared(plan: CrowdPlan) -> Iterator[tuple[float, World]]:
    """Every shear rate and its world: the flow, and the cloud that it has drawn out."""
    world = plan.world(SHEAR)
    assert isinstance(world.field, ShearedSource)
    for rate in plan.shear_rates:
        field = dataclasses.replace(world.field, velocity_gradient=((0.0, rate), (0.0, 0.0)))
        flow = ShearFlow(rate, 1.0) if rate else StillWater()
        yield rate, world.replace(field=field, flow=flow, start_box=plan.shear_box)
