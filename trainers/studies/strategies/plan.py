"""The plan of the table: which strategies live in which worlds, and what is trained for it."""

import dataclasses
from dataclasses import dataclass

from swarm.physics.world import World
from trainers.settings.composition import SettingsError
from trainers.studies.minimal.plan import MinimalPlan
from trainers.studies.plan import TrainingPlan, around_egg

WORLDS = ("linear_n2", "linear_n4", "linear_n8", "varying_speed", "taylor_green_aware", "radial", "space")
DQN, PPO, MINIMAL, OPTIMAL = "dqn", "ppo", "minimal", "optimal"
STRATEGIES = {  # in the order of the table
    "random": "random",
    "swinging": "swinging",
    "greedy": "greedy",
    "adaptive": "adaptive, linear",
    "adaptive_on_off": "adaptive, on–off",
    MINIMAL: "minimal: three parameters",
    DQN: "DQN",
    PPO: "PPO, any curvature",
    OPTIMAL: "optimal",
}
TUNED = "tuning=ppo_swarm_continuous_n4"  # of PPO where curvatures are actions


@dataclass(frozen=True)
class StrategiesPlan(TrainingPlan):
    DECIDED = (*TrainingPlan.DECIDED, "world.action")
    # experiments, whose tests' worlds those of the table are
    worlds: tuple[str, ...] = WORLDS
    experiments: tuple[str, ...] = dataclasses.field(init=False)  # WORLD_ALGORITHM, what is trained
    parameters: int = 3  # of the smallest brain
    generations: int = 15  # of its search, whenever one parameter is taken away
    cells: int = 200  # of a test
    egg_cells: int = 100  # of a test around an egg
    egg_reach: float = 30.0  # they start in a square around it, so far to each side [length]
    seed: int = 500  # of the test populations

    def __post_init__(self) -> None:
        for name in self.worlds:
            world, rule = self.world(name), None
            if world.is_shared:
                rule = "each cell lives alone, got cells that share a medium, meet, race or see each other"
            elif world.is_continuous or world.n_actions != 2:
                rule = (
                    f"actions are two curvatures, got {'a range' if world.is_continuous else world.n_actions}"
                )
            if rule is not None:
                raise SettingsError(f"strategies must be compared where {rule}; experiment={name}")
        found = [f"{name}_{DQN}" for name in self.worlds]
        found += [f"{name}_{PPO}" for name in self.worlds if not isinstance(self.continuous(name), str)]
        object.__setattr__(self, "experiments", tuple(found))

    def chosen(self, experiment: str) -> tuple[str, ...]:
        """The words that choose the settings of a training."""
        name, algorithm = experiment.rsplit("_", 1)
        words = (f"experiment={name}", f"algorithm={algorithm}")
        return (*words, TUNED, "world.action=continuous") if algorithm == PPO else words

    def world(self, name: str) -> World:
        """The world of a test, with its life."""
        return around_egg(super().world(f"{name}_{DQN}"), self.egg_reach)

    def continuous(self, name: str) -> World | str:
        """The same world with curvatures as actions, or why there is none."""
        try:
            return self.world(name).replace(action="continuous")
        except SettingsError:
            raise
        except ValueError as error:
            return str(error)

    @property
    def search(self) -> MinimalPlan:
        return MinimalPlan(n_seeds=self.n_seeds, generations=self.generations)
