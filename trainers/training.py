"""Training: collect, learn, validate, keep; a run stopped anywhere goes on as if it had never been."""

from __future__ import annotations

import dataclasses
import logging
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torchrl import torchrl_logger

from swarm import provenance
from swarm.network import save_policy
from swarm.torchrl_env import SwarmEnv
from swarm.world import World
from trainers import checkpoints, runs
from trainers.checkpoints import CheckpointError
from trainers.collecting import Explorer
from trainers.dqn import Learner
from trainers.runs import METRIC_COLUMNS, RunError, RunFolder
from trainers.settings import LearningSettings, Settings
from trainers.validating import Validation

WORTH_COMPILING = 100_000  # decisions, from which compiling is the faster way (`benchmarks/training_path.py`)
Log = Callable[[list[dict[str, Any]], dict[str, Any]], None]
MEASURES = METRIC_COLUMNS[2:]  # all but epoch and seed


class TrainingError(RunError):
    """Training cannot go on."""


class Interrupted(RunError):
    """The user stopped the run; everything is saved."""


def epsilon_at(settings: LearningSettings, epoch: int, progress: float) -> float:
    """ε in an epoch (from 0); `progress` is the part of all epochs that is over."""
    if settings.epsilon_schedule == "exponential":
        return max(settings.epsilon_end, settings.epsilon_start * settings.epsilon_decay**epoch)
    fallen = min(1.0, progress / settings.epsilon_fraction)
    return settings.epsilon_start + (settings.epsilon_end - settings.epsilon_start) * fallen


def learning_rate_at(settings: LearningSettings, updates: int, progress: float) -> float:
    """Learning rate after `updates` updates."""
    if settings.learning_rate_schedule == "inverse_time":
        return settings.learning_rate / (1 + settings.learning_rate_decay * updates)
    return settings.learning_rate * (1 + (settings.learning_rate_end - 1) * progress)


class Training:
    """All that a run carries from one epoch to the next."""

    @torch.inference_mode()
    def __init__(self, settings: Settings) -> None:
        torchrl_logger.setLevel(logging.WARNING)
        torch.set_num_threads(settings.threads)
        self.settings = settings
        self.seeds = settings.seeds
        learning = settings.learning
        world = settings.training_world()
        fast = settings.compile == "always" or (
            settings.compile == "auto" and learning.epochs * world.max_decisions >= WORTH_COMPILING
        )
        self.explorer = self._make_explorer(world, fast)
        self.env = self.explorer.env
        self.learner = Learner(world.observation_size, world.n_actions, learning, self.seeds, settings.device)
        checked = settings.validation
        self.validation = Validation(
            world.replace(life=checked.life), checked.cells, self.seeds, settings.device
        )
        self.epoch = 0
        self.decisions = 0
        self.best_gain = np.full(len(self.seeds), -np.inf)
        self.best_epoch = np.zeros(len(self.seeds), np.int64)
        self.best = self.learner.played.flat.clone()
        self.measures = np.zeros((0, len(self.seeds), len(MEASURES)))

    def _make_explorer(self, world: World, compile: bool) -> Explorer:
        settings, learning = self.settings, self.settings.learning
        env = SwarmEnv(
            learning.n_worlds * len(self.seeds),
            None if settings.device == "cpu" else settings.device,
            n_swimmers=learning.n_swimmers,
            seeds=self.seeds,
            compile_step=compile,
            world=world,
        )
        return Explorer(env, discount=learning.discount, n_steps=learning.n_steps, compile=compile)

    # --- one epoch ------------------------------------------------------------------------------------------

    def run_epoch(self) -> None:
        """One life of every cell, with rounds of updates in between, then validation where it is due."""
        settings, learning = self.settings, self.settings.learning
        self.env.restart()
        longest = self.env.world.max_decisions
        losses, values, done = [], [], 0
        while done < longest and (done == 0 or not self.explorer.everyone_done()):
            progress = (self.epoch + done / longest) / learning.epochs
            epsilon = epsilon_at(learning, self.epoch, progress)
            decisions = min(learning.collect or longest, longest - done)
            rows = self.explorer.collect(self.learner.online, epsilon, decisions)
            self._check_rewards(rows["reward"])
            self.learner.remember(rows)
            done += len(rows) // self.explorer.cells
            loss, value = self.learner.learn(
                lambda updates, p=progress: learning_rate_at(learning, updates, p)
            )
            losses.append(loss)
            values.append(value)
        self.decisions += done
        self.epoch += 1
        gain = np.full(len(self.seeds), np.nan)
        if self.epoch % settings.validation.every == 0 or self.epoch == learning.epochs:
            gain = self._validate()
        self._measure(torch.stack(losses), torch.stack(values), epsilon, gain)

    def _validate(self) -> np.ndarray:
        """Mean gain (seeds,) of the greedy policies; the best one of each seed is kept."""
        network = self.learner.played
        gain = self.validation.gains(network)
        self._check_finite("gain", gain)
        better = gain > self.best_gain if self.settings.learning.keep == "best" else np.ones(len(gain), bool)
        self.best_gain = np.where(better, gain, self.best_gain)
        self.best_epoch = np.where(better, self.epoch, self.best_epoch)
        mask = torch.as_tensor(better, device=network.flat.device)[:, None]
        self.best = torch.where(mask, network.flat, self.best)
        return gain

    def _check_rewards(self, reward: Tensor) -> None:
        """Raises TrainingError where a reward (rows, seeds) is not finite: it would spoil the buffer for
        good.
        """
        wrong = ~reward.isfinite()
        if wrong.any():
            row, place = wrong.nonzero()[0].tolist()
            raise TrainingError(
                f"reward must be finite, got {reward[row, place]} for cell {row % self.explorer.cells} of "
                f"seed {self.seeds[place]} in epoch {self.epoch + 1}: the field or the flow gives such values"
            )

    def _check_finite(self, name: str, values: np.ndarray) -> None:
        """Raises TrainingError where a seed's value (seeds,) is not finite."""
        for seed, value in zip(self.seeds, values, strict=True):
            if not np.isfinite(value):
                raise TrainingError(
                    f"{name} must be finite, got {value} in epoch {self.epoch} of seed {seed}: "
                    "a lower learning.learning_rate may help"
                )

    def _measure(self, losses: Tensor, values: Tensor, epsilon: float, gain: np.ndarray) -> None:
        """This epoch's row of metrics for each seed; raises TrainingError where something is not finite.

        training_gain: mean gain of the training cells, which explore; loss, q_mean: means over the epoch's
        rounds of the last batch's loss and chosen value; gain, fraction_of_limit: validation (NaN where none
        was due).
        """
        training_gain = self.explorer.gains().double().mean(-1)
        limits = self.validation.limits
        row = np.empty((len(self.seeds), len(MEASURES)))
        columns = {
            "training_gain": training_gain.cpu().numpy(),
            "loss": losses.double().mean(0).cpu().numpy(),
            "q_mean": values.double().mean(0).cpu().numpy(),
            "epsilon": epsilon,
            "learning_rate": self.learner.optimiser.param_groups[0]["lr"],
            "decisions": self.decisions,
            "updates": self.learner.updates,
            "gain": gain,
            "fraction_of_limit": np.nan if limits is None else gain / limits,
        }
        for place, name in enumerate(MEASURES):
            row[:, place] = columns[name]
        checked = {name: columns[name] for name in ("training_gain", "loss", "q_mean")}
        checked["sum of the weights"] = self.learner.online.flat.double().sum(-1).cpu().numpy()
        for name, checked_values in checked.items():
            self._check_finite(name, checked_values)
        self.measures = np.concatenate([self.measures, row[None]])

    def latest_validation(self) -> tuple[float, float]:
        """This epoch's validation gain and fraction of the limit, mean over seeds; NaN where none was due."""
        means = self.measures[-1].mean(0)
        return float(means[MEASURES.index("gain")]), float(means[MEASURES.index("fraction_of_limit")])

    def metric_rows(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """Rows of metrics.csv from epoch `first` + 1 on."""
        for index in range(first, len(self.measures)):
            for place, seed in enumerate(self.seeds):
                values = dict(zip(MEASURES, self.measures[index, place].tolist(), strict=True))
                whole = {name: int(values.pop(name)) for name in ("decisions", "updates")}
                kept = {name: None if np.isnan(value) else value for name, value in values.items()}
                yield {"epoch": index + 1, "seed": seed, **kept, **whole}

    # --- what a checkpoint holds ----------------------------------------------------------------------------

    def tensors(self) -> dict[str, Tensor]:
        """Networks, optimiser, buffer, environment, kept policies and metrics.

        Random numbers need none: every draw is named by its seed and a counter.
        """
        learner = self.learner
        held = {"online": learner.online.flat, "target": learner.target.flat, "played": learner.played.flat}
        held |= {"best": self.best, "best_gain": torch.as_tensor(self.best_gain)}
        held |= {"best_epoch": torch.as_tensor(self.best_epoch), "measures": torch.as_tensor(self.measures)}
        for name, value in learner.optimiser.state[learner.online.flat].items():
            held[f"optimiser.{name}"] = value
        for name, value in learner.buffer[:].items():
            held[f"buffer.{name}"] = value
        held |= {f"env.{name}": value for name, value in self.env.state_dict_of_env().items()}
        return {name: value.clone() for name, value in held.items()}

    def record(self) -> dict[str, int]:
        """The counters."""
        learner = self.learner
        return {
            "epoch": self.epoch,
            "decisions": self.decisions,
            "updates": learner.updates,
            "learning_rounds": learner.rounds,
            "collecting_rounds": self.explorer.rounds,
            "cursor": learner.buffer.writer.state_dict()["_cursor"],
        }

    def _template(self) -> dict[str, Tensor]:
        """Tensors as a checkpoint of this run holds them, with one row of the buffer and one epoch of
        metrics.
        """
        seeds, flat = len(self.seeds), self.learner.online.flat
        explorer = self._make_explorer(self.env.world, compile=False)
        explorer.env.restart()
        rows = explorer.collect(self.learner.online, 1.0, 1)[:1]
        held = {"online": flat, "target": flat, "played": flat, "best": flat}
        held |= {"optimiser.step": torch.zeros(()), "optimiser.exp_avg": flat, "optimiser.exp_avg_sq": flat}
        held |= {"best_gain": torch.as_tensor(self.best_gain), "best_epoch": torch.as_tensor(self.best_epoch)}
        held["measures"] = torch.zeros(1, seeds, len(MEASURES), dtype=torch.float64)
        held |= {f"buffer.{name}": value for name, value in rows.items()}
        return held | {f"env.{name}": value for name, value in explorer.env.state_dict_of_env().items()}

    def largest_checkpoint(self) -> int:
        """Bytes that the tensor file of a checkpoint can have at most."""
        learning, size = self.settings.learning, 2**20  # the header
        for name, value in self._template().items():
            rows = learning.buffer_size if name.startswith("buffer.") else 1
            size += value.nbytes * (learning.epochs if name == "measures" else rows)
        return size

    def _check_held(self, tensors: dict[str, Tensor], record: dict[str, int]) -> None:
        """Raises CheckpointError unless these are the tensors and counters of such a run."""
        learning, template = self.settings.learning, self._template()
        counters = self.record()
        for name in counters:
            if type(record.get(name)) is not int or record[name] < 0:
                raise CheckpointError(f"checkpoint's {name} must be a whole number, got {record.get(name)!r}")
        if tensors.keys() != template.keys():
            other = ", ".join(sorted(tensors.keys() ^ template.keys()))
            raise CheckpointError(f"checkpoint must hold what this run needs, but differs in {other}")
        rows = len(tensors["buffer.action"]) if tensors["buffer.action"].ndim else 0
        for name, expected in template.items():
            value, shape = tensors[name], tuple(expected.shape)
            if name == "measures":
                shape = (record["epoch"], *shape[1:])
            elif name.startswith("buffer."):
                shape = (rows, *shape[1:])
            if value.dtype != expected.dtype or tuple(value.shape) != shape:
                raise CheckpointError(
                    f"checkpoint's {name} must be {expected.dtype} {shape}, "
                    f"got {value.dtype} {tuple(value.shape)}"
                )
        action = tensors["buffer.action"]
        if (
            not 0 < rows <= learning.buffer_size
            or action.min() < 0
            or action.max() >= self.env.world.n_actions
        ):
            raise CheckpointError(
                f"checkpoint's buffer must hold 1 to {learning.buffer_size} rows of known actions"
            )
        if record["epoch"] > learning.epochs or record["cursor"] > learning.buffer_size:
            raise CheckpointError(
                f"checkpoint's epoch must be at most {learning.epochs}, got {record['epoch']}"
            )

    def restore(self, tensors: dict[str, Tensor], record: dict[str, int]) -> None:
        """Go on from what `tensors` and `record` gave; raises CheckpointError where they are not of such a
        run.
        """
        self._check_held(tensors, record)
        learner = self.learner
        held = {name: value.to(learner.device) for name, value in tensors.items()}
        for network, name in (
            (learner.online, "online"),
            (learner.target, "target"),
            (learner.played, "played"),
        ):
            network.flat.copy_(held[name])
        self.best = held["best"]
        self.best_gain, self.best_epoch = tensors["best_gain"].numpy(), tensors["best_epoch"].numpy()
        self.measures = tensors["measures"].numpy()
        state = {name: held[f"optimiser.{name}"] for name in ("step", "exp_avg", "exp_avg_sq")}
        learner.optimiser.state[learner.online.flat] = state
        stored = {
            name.removeprefix("buffer."): value for name, value in held.items() if name.startswith("buffer.")
        }
        learner.refill(stored, record["cursor"])
        self.env.load_state_dict_of_env(
            {name.removeprefix("env."): value for name, value in tensors.items() if name.startswith("env.")}
        )
        self.epoch, self.decisions = record["epoch"], record["decisions"]
        learner.updates, learner.rounds = record["updates"], record["learning_rounds"]
        self.explorer.rounds = record["collecting_rounds"]

    # --- what comes out -------------------------------------------------------------------------------------

    def policy_card(self, place: int) -> dict[str, Any]:
        """What a policy file says of itself: no times, no paths."""
        limits = self.validation.limits
        gain = float(self.best_gain[place])
        world = self.env.world
        settings = dataclasses.asdict(self.settings)
        return {
            "experiment": self.settings.experiment,
            "recipe": self.settings.recipe,
            "seed": self.seeds[place],
            "epoch": int(self.best_epoch[place]),
            "n_records": world.n_records,
            "features": world.features,
            "n_actions": world.n_actions,
            "settings": {name: settings[name] for name in ("world", "learning", "validation", "evaluation")},
            "validation": {
                "gain": gain,
                "fraction_of_limit": None if limits is None else gain / float(limits[place]),
            },
            "versions": provenance.versions(),
            "commit": provenance.commit(),
        }

    def save_policies(self, run: RunFolder) -> None:
        """The kept policy of every seed, and the best of them by validation as the run's own."""
        network = self.learner.played.copy()
        network.flat.copy_(self.best)
        for place, seed in enumerate(self.seeds):
            policy = network.exported(place, self.policy_card(place))
            if len(self.seeds) > 1:
                run.seed_folder(seed).mkdir(exist_ok=True)
                save_policy(policy, run.seed_folder(seed) / runs.POLICY)
            if place == int(np.argmax(self.best_gain)):
                save_policy(policy, run.policy)


def train(
    training: Training, run: RunFolder, *, report: Callable[[Training, float], None] | None = None
) -> None:
    """Train to the end in a run's folder, going on from its newest checkpoint.

    `report` is called after each epoch. Raises Interrupted after Ctrl-C or SIGTERM, when the epoch is
    finished and saved; TrainingError for numbers that are not finite; CheckpointError for checkpoints that
    cannot be used; RunError where another process trains the run.
    """
    settings = training.settings
    with run.locked(), torch.inference_mode():
        _go_on(training, run)
        with _logging(settings, run) as log, _interruptible() as asked_to_stop:
            while training.epoch < settings.learning.epochs:
                seconds = _epoch(training, run, log)
                last = training.epoch == settings.learning.epochs
                stopping = asked_to_stop() and not last
                if last or stopping or training.epoch % settings.checkpoint_every == 0:
                    _save(training, run)
                if report is not None:
                    report(training, seconds)
                if stopping:
                    raise Interrupted(
                        f"stopped after epoch {training.epoch}; to go on: swarm train resume={run.path}"
                    )
        training.save_policies(run)


def _go_on(training: Training, run: RunFolder) -> None:
    """Put a fresh training, and the run's tables, where the newest valid checkpoint left them, if there is
    one.
    """
    folder, settings = run.path / runs.CHECKPOINTS, training.settings
    run.tidy()
    checkpoints.tidy(folder)
    at_most = training.largest_checkpoint() if folder.is_dir() else 0
    found = checkpoints.read_newest(folder, dataclasses.asdict(settings), at_most=at_most)
    if found is not None:
        tensors, record, complaints = found
        try:
            training.restore(tensors, record)
        except CheckpointError as error:
            raise CheckpointError(f"{folder}: {error}") from None
        for complaint in complaints:
            print(f"{complaint}; going on from epoch {training.epoch}", file=sys.stderr)
    run.rewrite(runs.METRICS, METRIC_COLUMNS, list(training.metric_rows()))
    timings = [row for row in run.rows(runs.TIMINGS) if int(row["epoch"]) <= training.epoch]
    run.rewrite(runs.TIMINGS, runs.TIMING_COLUMNS, timings)


def _epoch(training: Training, run: RunFolder, log: Log) -> float:
    """One epoch and its rows in the tables; returns the seconds it took."""
    started, decisions, updates = time.perf_counter(), training.decisions, training.learner.updates
    training.run_epoch()
    seconds = time.perf_counter() - started
    rows = list(training.metric_rows(training.epoch - 1))
    run.append(runs.METRICS, METRIC_COLUMNS, rows)
    timing = {
        "epoch": training.epoch,
        "seconds": seconds,
        "decisions_per_second": (training.decisions - decisions) / seconds,
        "updates_per_second": (training.learner.updates - updates) / seconds,
    }
    run.append(runs.TIMINGS, runs.TIMING_COLUMNS, [timing])
    log(rows, timing)
    return seconds


def _save(training: Training, run: RunFolder) -> None:
    checkpoints.write(
        run.path / runs.CHECKPOINTS,
        training.epoch,
        training.tensors(),
        training.record(),
        dataclasses.asdict(training.settings),
    )


def draw(training: Training, run: RunFolder) -> None:
    """The training figure: validation gain against epoch, with the limit and greedy (paper: evolution of the
    gain).
    """
    from swarm import figures

    gain = training.measures[:, :, MEASURES.index("gain")]
    validated = np.flatnonzero(~np.isnan(gain[:, 0]))
    limits = training.validation.limits
    curve = figures.Curve(
        epoch=validated + 1,
        gain=gain[validated].T,
        greedy=float(training.validation.greedy.mean()),
        limit=None if limits is None else float(limits.mean()),
    )
    figure = figures.training({training.settings.experiment: curve})
    figures.save(figure, run.path / runs.FIGURE)


@contextmanager
def _interruptible() -> Iterator[Callable[[], bool]]:
    """Within, the first Ctrl-C or SIGTERM only asks to stop after the epoch; the second one stops at once."""
    asked: list[int] = []

    def ask(number: int, frame: Any) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(number)

    previous = {}
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            previous[number] = signal.signal(number, ask)
    except ValueError:  # not in the main thread, where signals do not come
        pass
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextmanager
def _logging(settings: Settings, run: RunFolder) -> Iterator[Log]:
    """Writes each epoch's rows to TensorBoard and Weights & Biases, where these are wanted."""
    loggers: list[Any] = []
    if settings.tensorboard:
        from torchrl.record.loggers.tensorboard import TensorboardLogger

        loggers.append(TensorboardLogger(exp_name="tensorboard", log_dir=str(run.path)))
    if settings.wandb:
        from torchrl.record.loggers.wandb import WandbLogger

        loggers.append(WandbLogger(exp_name=run.path.name, log_dir=str(run.path)))

    def log(rows: list[dict[str, Any]], timing: dict[str, Any]) -> None:
        for logger in loggers:
            for row in rows:
                suffix = "" if len(rows) == 1 else f"/seed_{row['seed']}"
                for name in MEASURES:
                    if row[name] is not None:
                        logger.log_scalar(name + suffix, float(row[name]), step=row["epoch"])
            for name in runs.TIMING_COLUMNS[1:]:
                logger.log_scalar(f"time/{name}", timing[name], step=timing["epoch"])

    try:
        yield log
    finally:
        if settings.tensorboard:
            loggers[0].experiment.close()
