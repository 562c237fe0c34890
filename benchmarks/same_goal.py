"""Training time to the same goal: ours beside Stable-Baselines3's DQN, on the same cells.

The goal: the greedy policy's mean gain passes 97% and 99% of the limit on 100 validation cells. Time is of
the processor, on one thread, from the first decision on; making the environment and testing the policy are
left out. Both learn from cells that share a world. Ours has the settings as shipped; Stable-Baselines3 has
for each experiment those that a search for nothing but the time found on other seeds than those that are
measured (`python -m benchmarks.same_goal --search SECONDS`, from several starts, ours among them). Without
Stable-Baselines3 only ours is measured.
"""

from __future__ import annotations

import argparse
import importlib.util
import itertools
import random
from collections.abc import Callable, Iterable, Sequence
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import torch

from trainers.settings.composition import settings_from
from trainers.settings.schema import Settings
from trainers.training.loop import Training, Validation

MARKS = (0.97, 0.99)
AT_MOST = 1.0  # of Stable-Baselines3's time
SEEDS, SEARCH_SEEDS, CONFIRMING_SEEDS = range(5), range(100, 105), range(105, 110)
EXPERIMENTS = ("linear_n4", "linear_n8")
# What the search found to be better than the settings as shipped; for `linear_n8` it found nothing.
STABLE_BASELINES3: dict[str, dict[str, Any]] = {
    "linear_n4": {
        "n_swimmers": 60,
        "collect": 6,
        "updates_per_decision": 1.0,
        "batch_size": 256,
        "hidden": [48],
        "n_steps": 5,
        "discount": 0.98,
        "learning_rate": 1.5e-2,
        "target_rate": 0.1,
        "epsilon_start": 0.3,
    },
}
SPACE: dict[str, list[Any]] = {
    "n_swimmers": [40, 60, 80, 120],
    "collect": [1, 2, 3, 4, 6, 8, 12],  # decisions between two rounds of updates
    "updates_per_decision": [0.25, 0.5, 1.0],
    "batch_size": [64, 96, 128, 192, 256],
    "hidden": [[32], [48], [64], [96], [32, 32], [48, 48], [64, 64], [48, 48, 48]],
    "n_steps": [2, 3, 4, 5],
    "discount": [0.95, 0.97, 0.98, 0.99],
    "learning_rate": [3e-3, 5e-3, 7e-3, 1e-2, 1.5e-2],
    "target_rate": [0.05, 0.1, 0.2, 0.3],
    "epsilon_start": [0.05, 0.1, 0.2, 0.3, 0.5],
}


class Pace(NamedTuple):
    """How long to wait for a learner, and how closely to look."""

    longest: float  # seconds after which a seed is given up
    every: float  # the policy is tested whenever so much more time is spent, as a part of what was
    to_the_end: bool  # or only to the last mark


MEASURED, SEARCHED = Pace(20.0, 0.05, True), Pace(4.0, 0.1, False)
GIVE_UP = 1.4  # times the time of the best, beyond which a search looks no further at settings


class Watch:
    """A stopwatch that stands still while the policy is tested."""

    def __init__(self, validation: Validation, pace: Pace, marks: Sequence[float] = MARKS) -> None:
        assert validation.limits is not None
        self.validation, self.limit, self.pace = validation, float(validation.limits[0]), pace
        self.spent, self.checked, self.marks = 0.0, 0.0, marks
        self.reached = [float("inf")] * len(marks)
        self.since = process_time()

    @property
    def over(self) -> bool:
        """Whether there is nothing more to see."""
        done = max(self.reached) < float("inf") and not self.pace.to_the_end
        return done or self.spent > self.pace.longest

    def part_of_limit(self, network: Any) -> float:
        """The greedy policy's mean gain as a fraction of the limit."""
        return float(self.validation.gains(network)[0]) / self.limit

    def look(self, network: Any) -> None:
        """After a round of updates: stop, test where that is due, go on."""
        self.spent += process_time() - self.since
        if max(self.reached) == float("inf") and self.spent >= self.checked * (1 + self.pace.every):
            self.checked = self.spent
            part = self.part_of_limit(network)
            for place, mark in enumerate(self.marks):
                if part > mark:
                    self.reached[place] = min(self.reached[place], self.spent)
        self.since = process_time()


def settings_of(experiment: str, seed: int, changed: dict[str, Any]) -> Settings:
    """The experiment as shipped, but for the settings `changed`."""
    shipped, changed = settings_from([f"experiment={experiment}"]).learning, dict(changed)
    per_decision = changed.pop("updates_per_decision", shipped.updates / shipped.collect)
    changed["updates"] = max(1, round(changed.get("collect", shipped.collect) * per_decision))
    words = [f"learning.{name}={value}" for name, value in changed.items()]
    return settings_from([f"experiment={experiment}", f"seed={seed}", "compile=never", *words])


def ours(experiment: str, seed: int, changed: dict[str, Any], pace: Pace) -> list[float]:
    """Seconds to each mark, infinite where it is not passed; then the last policy's part of the limit."""
    training = Training(settings_of(experiment, seed, changed))
    return watched_training(training, pace)


def watched_training(training: Training, pace: Pace, marks: Sequence[float] = MARKS) -> list[float]:
    """Seconds to each mark, then the last policy's part of the limit."""
    algorithm, epochs = training.algorithm, training.settings.learning.epochs
    learn = algorithm.learn

    def watched(rollout: Any, progress: float) -> Any:
        result = learn(rollout, progress)
        watch.look(algorithm.policy)
        return result

    algorithm.learn = watched  # type: ignore[method-assign]
    training._validate = lambda: np.full(1, np.nan)  # type: ignore[method-assign]
    watch = Watch(training.validation, pace, marks)
    while training.epoch < epochs and not watch.over:
        training.run_epoch()
    return [*watch.reached, watch.part_of_limit(algorithm.policy)]


def stable_baselines3(experiment: str, seed: int, changed: dict[str, Any], pace: Pace) -> list[float]:
    """Seconds to each mark, infinite where it is not passed; then the last policy's part of the limit."""
    from stable_baselines3 import DQN

    settings = settings_of(experiment, seed, changed)
    learning = settings.learning
    total = learning.epochs * settings.training_world().max_decisions * learning.n_swimmers
    rate = learning.learning_rate
    options = {
        "learning_rate": lambda left: rate * left,
        "batch_size": learning.batch_size,
        "buffer_size": learning.buffer_size,
        "learning_starts": learning.batch_size,
        "gamma": learning.discount,
        "n_steps": learning.n_steps,
        "train_freq": learning.collect,
        "gradient_steps": learning.updates,
        "tau": learning.target_rate,
        "target_update_interval": learning.n_swimmers,  # every decision of all cells
        "exploration_initial_eps": learning.epsilon_start,
        "exploration_final_eps": learning.epsilon_end,
        "exploration_fraction": learning.epsilon_fraction,
        "policy_kwargs": {"net_arch": list(learning.hidden), "activation_fn": torch.nn.Tanh},
    }
    return watched_model(DQN, options, settings, total, pace, MARKS, lambda model: model.q_net.q_net)


def watched_model(
    kind: Callable[..., Any],
    options: dict[str, Any],
    settings: Settings,
    total: int,
    pace: Pace,
    marks: Sequence[float],
    network_of: Callable[[Any], Any],
) -> list[float]:
    """As `watched_training`, for a model of Stable-Baselines3 that learns from `total` decisions."""
    from stable_baselines3.common.callbacks import BaseCallback

    from swarm.envs.stable_baselines3 import SpermSwarmVecEnv

    checked, world = settings.validation, settings.training_world()
    cells = SpermSwarmVecEnv(settings.learning.n_swimmers, world=world)
    cells.seed(settings.seed)

    class Looking(BaseCallback):
        def _on_training_start(self) -> None:
            watch.since = process_time()

        def _on_rollout_start(self) -> None:  # after a round of updates
            watch.look(network)

        def _on_step(self) -> bool:
            return not watch.over

    model = kind("MlpPolicy", cells, seed=settings.seed, device="cpu", **options)
    network = network_of(model)
    validation = Validation(world.replace(life=checked.life), checked.cells, [settings.seed])
    watch = Watch(validation, pace, marks)
    model.learn(total, callback=Looking())
    return [*watch.reached, watch.part_of_limit(network)]


LEARNERS: dict[str, tuple[Callable[..., list[float]], dict[str, dict[str, Any]]]] = {
    "ours": (ours, {}),
    "Stable-Baselines3": (stable_baselines3, STABLE_BASELINES3),
    "Stable-Baselines3 with our settings": (stable_baselines3, {}),
}
SEARCHED_LEARNERS = ("ours", "Stable-Baselines3")


def measure(experiment: str) -> list[dict[str, Any]]:
    """Medians over seeds, the learners taking turns."""
    chosen = LEARNERS
    if importlib.util.find_spec("stable_baselines3") is None:
        chosen = {"ours": LEARNERS["ours"]}
    found: dict[str, list[list[float]]] = {name: [] for name in chosen}
    for seed in SEEDS:
        for name, (learner, changed) in chosen.items():
            found[name].append(learner(experiment, seed, changed.get(experiment, {}), MEASURED))
    medians = {name: np.median(np.array(values), axis=0) for name, values in found.items()}
    rows = []
    for name, values in found.items():
        row: dict[str, Any] = {"experiment": experiment, "learner": name}
        for place, mark in enumerate(MARKS):
            row[f"seconds to {mark:.0%}"] = float(medians[name][place])
            if "Stable-Baselines3" in medians:
                row[f"ratio at {mark:.0%}"] = float(
                    medians[name][place] / medians["Stable-Baselines3"][place]
                )
        row["at most"] = AT_MOST if name == "ours" and len(found) > 1 else None
        row["worst at the end"] = min(value[-1] for value in values)
        row["median at the end"] = float(medians[name][-1])
        rows.append(row)
    return rows


def search(
    learner: Callable[..., list[float]], experiment: str, start: dict[str, Any], seconds: float, seed: int
) -> dict[str, Any]:
    """The settings with the smallest geometric mean of the times to the marks.

    Begins with `start`; every trial draws one to three settings of the best so far anew, and what is better
    must be so on further seeds, too.
    """

    def time_of(settings: dict[str, Any], seeds: range, at_most: float = float("inf")) -> float:
        times: list[float] = []
        for each in seeds:
            *reached, _ = learner(experiment, each, settings, SEARCHED)
            times += np.minimum(reached, SEARCHED.longest).tolist()
            if len(times) > len(seeds) and geometric_mean(times) > at_most:
                break
        return geometric_mean(times)

    draw, best, end = random.Random(seed), start, process_time() + seconds
    shortest = time_of(best, SEARCH_SEEDS)
    print(f"{shortest:8.4f}  {best}", flush=True)
    while process_time() < end:
        chosen = draw.sample(list(SPACE), draw.choice([1, 1, 2, 2, 3]))
        changed = best | {name: draw.choice(SPACE[name]) for name in chosen}
        if changed == best:
            continue
        found = time_of(changed, SEARCH_SEEDS, GIVE_UP * shortest)
        if found < shortest:
            pairs = [(found, time_of(changed, CONFIRMING_SEEDS)), (shortest, time_of(best, CONFIRMING_SEEDS))]
            new, old = map(geometric_mean, pairs)
            if new < old:
                best, shortest = changed, new
                print(f"{shortest:8.4f}  {best}", flush=True)
    return best


def geometric_mean(numbers: Iterable[float]) -> float:
    """exp of the mean logarithm."""
    return float(np.exp(np.mean(np.log(list(numbers)))))


def run() -> list[dict[str, Any]]:
    """All rows."""
    torch.set_num_threads(1)
    return [row for experiment in EXPERIMENTS for row in measure(experiment)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--search", type=float, metavar="SECONDS", help="of processor time for each")
    parser.add_argument("--learner", choices=SEARCHED_LEARNERS, action="append", help="default: both")
    parser.add_argument("--experiment", choices=EXPERIMENTS, action="append", help="default: both")
    parser.add_argument("--seed", type=int, default=0, help="of the search")
    options = parser.parse_args()
    torch.set_num_threads(1)
    for name, experiment in itertools.product(
        options.learner or SEARCHED_LEARNERS, options.experiment or EXPERIMENTS
    ):
        print(name, experiment)
        learner, start = LEARNERS[name]
        search(learner, experiment, start.get(experiment, {}), options.search or 0.0, options.seed)
