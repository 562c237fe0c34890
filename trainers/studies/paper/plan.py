"""The plan of a reproduction: what is trained, with which seeds, and what is tested where."""

from dataclasses import dataclass

from swarm.physics.world import World
from trainers.studies.plan import TrainingPlan, around_egg

RECORDS = {"linear_n2": 2, "linear_n4": 4, "linear_n8": 8}  # N_T of the cases with one speed
STEADY, VARYING, EGG, VORTICES = "linear_n4", "varying_speed", "radial", "taylor_green"
AWARE, BLIND = "taylor_green_aware", "taylor_green_blind"
EXPERIMENTS = (*RECORDS, VARYING, EGG, AWARE, BLIND)
# the world of a test, and which trainings are tested in it, by what figures call them
TESTS = {name: {"dqn": name} for name in (*RECORDS, VARYING, EGG)}
TESTS[VORTICES] = {"aware": AWARE, "blind": BLIND, "still": STEADY}


@dataclass(frozen=True)
class Plan(TrainingPlan):
    recipes: tuple[str, ...] = ("swarm", "paper")
    n_seeds: int = 20
    experiments: tuple[str, ...] = EXPERIMENTS
    cells: int = 400  # of a test; none of them was ever seen in training or validation
    radial_cells: int = 100  # of the test around the egg
    swinging_cells: int = 40  # whose circles are fitted
    figure_cells: int = 40  # in figures: the first of the test's
    radial_figure_cells: int = 9
    radial_reach: float = 30.0  # they start in a square around the egg, so far to each side [length]
    seed: int = 100  # of the test population

    def test_world(self, test: str) -> World:
        return around_egg(self.world(next(iter(TESTS[test].values()))), self.radial_reach)
