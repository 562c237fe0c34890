"""The plan of the study: which networks are trained, searched and pruned, and where they are tested."""

import dataclasses
import itertools
from dataclasses import dataclass

from swarm.optimal.problem import why_no_limit
from swarm.physics.perception import Memory
from swarm.physics.world import World
from trainers.settings.composition import SettingsError
from trainers.studies.plan import TrainingPlan

DQN, EVOLUTION = "dqn", "evolution"
ATTAINABLE = {"linear_n2": 28.2}  # about the most that two records allow, where the limit is out of reach
VALIDATION = "validation.cells=50"
SHORT = ("learning.epochs=40", "world.life=40.0")  # of evolution strategies: half a life ranks as well


@dataclass(frozen=True)
class MinimalPlan(TrainingPlan):
    DECIDED = (*TrainingPlan.DECIDED, "learning.hidden")
    experiments: tuple[str, ...] = dataclasses.field(init=False)  # an algorithm on a rung of the ladder
    cases: tuple[str, ...] = ("linear_n4",)  # experiments to find the smallest brain for
    nodes: tuple[int, ...] = (0, 1, 2, 3, 4, 8, 24)  # of one tanh layer; 0: none
    algorithms: tuple[str, ...] = (DQN, EVOLUTION)
    thinned: tuple[int, ...] = (0,)  # rungs whose search goes on with ever fewer parameters
    most_thinned: int = 24  # parameters where that begins at most: the largest are left
    candidates: int = 16  # of a generation of a search
    generations: int = 15  # of a search that goes on with one parameter less
    genomes: int = 60  # of a generation of NEAT
    neat_generations: int = 60
    fitness_cells: int = 20  # whose mean gain is a fitness
    fitness_life: float = 40.0  # [time]
    records: tuple[int, ...] = (2, 3, 4, 6, 8, 12, 16)  # N_T of lookup tables, in the world of the first case
    bins: tuple[int, ...] = (2, 4, 8, 16)  # of each concentration in a table
    cells: int = 100  # of validation and of the test
    seed: int = 300  # of validation and test populations

    def __post_init__(self) -> None:
        found = itertools.product(self.cases, self.algorithms, self.nodes)
        object.__setattr__(self, "experiments", tuple(rung(*each) for each in found))
        for case in self.cases:
            world = self.test_world(case)
            rule = why_no_limit(world)
            if world.is_continuous or world.n_actions != 2:
                rule = rule or f"two curvatures, got {'a range' if world.is_continuous else world.n_actions}"
            if world.sensor.names != Memory.names:
                rule = rule or f"the sensor memory, got {world.sensor.name}"
            if rule is not None:
                raise SettingsError(f"the smallest brain must have {rule}; experiment={case}")

    def chosen(self, experiment: str) -> tuple[str, ...]:
        """The words that choose the settings of a rung."""
        case, algorithm, nodes = experiment.rsplit("_", 2)
        hidden = "" if nodes == "0" else nodes
        words = (f"experiment={case}", f"algorithm={algorithm}", f"learning.hidden=[{hidden}]", VALIDATION)
        return (*words, *SHORT) if algorithm == EVOLUTION else words

    def test_world(self, case: str) -> World:
        """The world of a test, with its life."""
        return self.world(rung(case, DQN, 0))

    def training_world(self, case: str) -> World:
        """The world whose gains are fitness."""
        settings = self.settings(self.recipes[0], rung(case, DQN, 0))
        return settings.training_world().replace(life=self.fitness_life)


def rung(case: str, algorithm: str, nodes: int) -> str:
    return f"{case}_{algorithm}_{nodes}"
