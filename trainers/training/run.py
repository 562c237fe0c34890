"""Runs: a training in its folder. A run that is stopped anywhere goes on as if it had never been."""

import importlib.util
import re
import shlex
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import trainers.algorithms  # noqa: F401, first of all that training needs
from swarm._support import files, provenance
from swarm._support.checks import check_memory
from swarm._support.terminal import dispensable, tell
from swarm.policies.network import save_policy
from swarm.population.blocks import block as blocks
from swarm.population.evaluation import Evaluation, evaluate
from trainers.algorithms.base import learner_of
from trainers.algorithms.spread import Submit
from trainers.settings.composition import SettingsError, settings_from_stored
from trainers.settings.schema import Settings
from trainers.training import checkpoint as checkpoints
from trainers.training import run_folder as runs
from trainers.training.checkpoint import CheckpointError
from trainers.training.loop import Training
from trainers.training.run_folder import RunError, RunFolder

SIGNALS = (signal.SIGINT, signal.SIGTERM)
Log = Callable[[list[dict[str, Any]], dict[str, Any]], None]
Report = Callable[[Training, float], None]  # called after each epoch with the seconds it took


class Interrupted(KeyboardInterrupt):
    """The user stopped the run; everything is saved."""


def check_machine(settings: Settings) -> None:
    """Raises SettingsError that names what is missing and the setting that asks for it."""
    for name in ("tensorboard", "wandb"):
        if getattr(settings, name) and importlib.util.find_spec(name) is None:
            raise SettingsError(f"{name}=true needs {name}, which is not installed: pip install {name}")
    if settings.device != "cpu":
        return _check_device(settings.device)
    try:
        held = "buffer_size, n_swimmers, n_worlds, batch_size"
        rule = f"n_seeds, world.n_records, or what learning holds ({held}) must be smaller"
        check_memory(memory_needed(settings), rule)
        if settings.evaluate:
            test = settings.evaluation
            rule = "evaluation.cells must be fewer, or evaluation.life shorter, got"
            cells = test.cells * test.worlds
            needed = blocks.memory_needed(settings.test_world(), cells)
            check_memory(needed, f"{rule} {cells} and {test.life:g}")
    except ValueError as error:
        raise SettingsError(str(error)) from None


def memory_needed(settings: Settings) -> int:
    """Bytes a run works with, roughly, and rather too few than too many."""
    learning, world = settings.learning, settings.training_world()
    decisions = min(learning.collect or world.max_decisions, world.max_decisions)
    validated = settings.validation.cells * settings.validation.worlds
    cells = 2 * decisions * learning.n_worlds * learning.n_swimmers + validated
    own = learner_of(settings).memory_needed(settings)
    return settings.n_seeds * (8 * world.observation_size * cells + own)


def _check_device(device: str) -> None:
    import torch  # after what says that it is missing

    kind, number = re.fullmatch(r"(\w+?)(?::(\d+))?", device).groups()  # type: ignore[union-attr]
    backend = torch.backends.mps if kind == "mps" else getattr(torch, kind)
    count = 1 if kind == "mps" else backend.device_count()
    if not backend.is_available() or int(number or 0) >= count:
        raise SettingsError(f"device must be one that torch finds here, got {device!r}; cpu is always there")


def prepare(settings: Settings, submit: Submit | None = None) -> Training:
    """A training that is ready to begin; raises SettingsError where settings or machine do not do."""
    check_machine(settings)
    try:
        return Training(settings, submit)
    except (TypeError, ValueError, MemoryError) as error:
        raise SettingsError(str(error) or "there is not enough memory for these settings") from None


def begin(
    folder: Path | None, settings: Settings, submit: Submit | None = None
) -> tuple[Training, RunFolder]:
    """A new run, whose folder, by default one named by the settings, is made when all else is ready.

    Raises SettingsError or OSError.
    """
    if folder is not None:
        files.check_new_folder(folder)
    training = prepare(settings, submit)
    return training, RunFolder.create(folder or runs.default_folder(settings), settings)


def resume(folder: Path, submit: Submit | None = None) -> tuple[Training, RunFolder]:
    """A run that was begun, as its settings say; raises SettingsError or RunError."""
    run, stored = RunFolder.open(folder)
    if "algorithm" not in stored:
        raise RunError(f"{folder} was begun by version 0.1: go on with that version, or train anew")
    training = prepare(settings_from_stored(stored, run.path), submit)
    then, now = run.record.get("versions"), provenance.versions()
    if isinstance(then, dict) and (changed := [name for name in now if then.get(name) != now[name]]):
        tell(f"{', '.join(changed)} changed since the run began: it goes on, but not bit for bit")
    return training, run


def train_in(folder: Path, settings: Settings) -> None:
    """One whole run in a folder. One that was begun there goes on, with its own settings, from its newest
    checkpoint; one that is finished is tested where that was not done, and else stays as it is.

    Raises what `begin`, `resume` and `complete` do.
    """
    if not runs.is_run_folder(folder):
        complete(*begin(folder, settings))
    elif not RunFolder(folder).finished:
        complete(*resume(folder))
    else:
        run, stored = RunFolder.open(folder)
        test(settings_from_stored(stored, folder), run)


def complete(training: Training, run: RunFolder, *, report: Report | None = None) -> Evaluation | None:
    """Train to the end, draw the training figure, mark the run as finished, and test its policy where that is
    wanted; all the while no other process works on the run. Returns the test. Raises what `train` and `test`
    do.

    An error that a user may undo notes what is left of the run.
    """
    try:
        with run.owned():
            train(training, run, report=report)
            with dispensable(run.path / runs.FIGURE):
                draw(training, run)
            run.mark_finished()
            wanted = training.settings.evaluate and not (run.path / runs.TEST).exists()
            return _test(training.settings, run) if wanted else None
    except (OSError, MemoryError, KeyboardInterrupt) as error:
        if not isinstance(error, Interrupted):
            error.add_note("what was saved before is kept")
        error.add_note(f"to go on: swarm train resume={shlex.quote(str(run.path))}")
        raise


def test(settings: Settings, run: RunFolder) -> Evaluation | None:
    """Test the policy of a finished run where that is wanted and was not done; raises RunError where another
    process works on the run.
    """
    if not settings.evaluate or (run.path / runs.TEST).exists():
        return None
    with run.owned():
        return _test(settings, run)


def _test(settings: Settings, run: RunFolder) -> Evaluation:
    from swarm.figures.evaluation import save_evaluation

    folder, wanted = run.path / runs.TEST, settings.evaluation
    options = {name: getattr(wanted, name) for name in ("cells", "worlds", "life", "seed")}
    tested = evaluate(run.path, settings.test_world(), experiment=settings.experiment, **options)
    save_evaluation(tested, folder)
    return tested


def train(training: Training, run: RunFolder, *, report: Report | None = None) -> None:
    """Train to the end in a run's folder, going on from its newest checkpoint.

    `report` is called after each epoch. Raises Interrupted after Ctrl-C or SIGTERM, when the epoch is
    finished and saved; TrainingError for numbers that are not finite; CheckpointError for checkpoints that
    cannot be used.
    """
    settings, folder = training.settings, run.path / runs.CHECKPOINTS
    training.untrained = training.validation.gains(training.algorithm.policy)
    _go_on(training, run)
    with _logging(training, run) as log, _interruptible() as asked_to_stop:
        while training.epoch < settings.learning.epochs:
            seconds = _epoch(training, run, log)
            last = training.epoch == settings.learning.epochs
            stopping = asked_to_stop() and not last
            if last or stopping or training.epoch % settings.checkpoint_every == 0:
                state = checkpoints.tensors_of(training), checkpoints.record_of(training)
                checkpoints.write(folder, training.epoch, *state, settings.identity())
            if report is not None:
                report(training, seconds)
            if stopping:
                raise Interrupted(f"stopped after epoch {training.epoch}")
    save_policies(training, run)


def _go_on(training: Training, run: RunFolder) -> None:
    """Put a fresh training, and the run's tables, where the newest valid checkpoint left them, if there is
    one.
    """
    folder, settings = run.path / runs.CHECKPOINTS, training.settings
    at_most = checkpoints.largest(training) if folder.is_dir() else 0
    found = checkpoints.read_newest(folder, settings.identity(), at_most=at_most)
    if found is not None:
        tensors, record, complaints = found
        try:
            checkpoints.restore(training, tensors, record)
        except CheckpointError as error:
            raise CheckpointError(f"{folder}: {error}") from None
        for complaint in complaints:
            tell(f"{complaint}; going on from epoch {training.epoch}")
    run.rewrite(runs.METRICS, training.columns, list(training.metric_rows()))
    timings = [row for row in run.rows(runs.TIMINGS) if int(row["epoch"]) <= training.epoch]
    run.rewrite(runs.TIMINGS, runs.TIMING_COLUMNS, timings)


def _epoch(training: Training, run: RunFolder, log: Log) -> float:
    """One epoch and its rows in the tables; returns the seconds it took."""
    started, decisions, updates = time.perf_counter(), training.decisions, training.algorithm.updates
    training.run_epoch()
    seconds = time.perf_counter() - started
    rows = list(training.metric_rows(training.epoch - 1))
    run.append(runs.METRICS, training.columns, rows)
    timing = timing_of(training, decisions, updates, seconds)
    run.append(runs.TIMINGS, runs.TIMING_COLUMNS, [timing])
    log(rows, timing)
    return seconds


def timing_of(training: Training, decisions: int, updates: int, seconds: float) -> dict[str, Any]:
    """The row of timings of the epoch that was begun after so many decisions and updates."""
    done = training.decisions - decisions, training.algorithm.updates - updates
    rates = [number / seconds if seconds > 0 else None for number in done]  # of a clock that stands
    return dict(zip(runs.TIMING_COLUMNS, (training.epoch, seconds, *rates), strict=True))


def save_policies(training: Training, run: RunFolder) -> None:
    """The kept policy of every seed, and the best of them by validation as the run's own."""
    kept = training.policies()
    for (_, path), policy in zip(run.policies(training.settings), kept, strict=True):
        path.parent.mkdir(exist_ok=True)
        save_policy(policy, path)
    save_policy(kept[int(np.argmax(training.best_gain))], run.policy)


def draw(training: Training, run: RunFolder) -> None:
    """The training figure: validation gain against the decisions of a cell, from the untrained policy on,
    with greedy and the limit (paper: evolution of the gain).
    """
    from swarm import figures

    gain = np.vstack([training.untrained, training.measure("gain")])
    validated = ~np.isnan(gain[:, 0])
    decisions = np.append(0, training.measure("decisions")[:, 0])
    limits = training.validation.limits
    curve = figures.Curve(
        moment=decisions[validated],
        gain=gain[validated].T,
        greedy=float(training.validation.greedy.mean()),
        limit=None if limits is None else float(limits.mean()),
    )
    titled = {figures.plain(training.settings.experiment): curve}
    figure = figures.training(titled, policy=training.settings.algorithm, label="decisions of each cell")
    figures.save(figure, run.path / runs.FIGURE)


def standing(training: Training) -> str:
    """The gain in validation, now and at best."""
    gain, fraction = (training.measure(name)[-1].mean() for name in ("gain", "fraction_of_limit"))
    text = f"gain {gain:.2f}" if gain == gain else ""  # NaN where none was due
    text += f" = {100 * fraction:.1f}% of the limit" if fraction == fraction else ""
    best = training.best_gain.mean()
    return f"{text}  best {best:.2f}  ".lstrip() if best > -float("inf") else text


@contextmanager
def _interruptible() -> Iterator[Callable[[], bool]]:
    """Within, the first Ctrl-C or SIGTERM only asks to stop after the epoch; the second one stops at once."""
    asked: list[int] = []

    def ask(number: int, frame: Any) -> None:
        if asked:
            raise KeyboardInterrupt("stopped at once")
        asked.append(number)

    heard = threading.current_thread() is threading.main_thread()  # signals come nowhere else
    previous = {number: signal.signal(number, ask) for number in SIGNALS if heard}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextmanager
def _logging(training: Training, run: RunFolder) -> Iterator[Log]:
    """Writes each epoch's rows to TensorBoard and Weights & Biases, where these are wanted."""
    settings, loggers = training.settings, list[Any]()
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
                for name in training.measured:
                    if row[name] is not None:
                        logger.log_scalar(name + suffix, float(row[name]), step=row["epoch"])
            for name in runs.TIMING_COLUMNS[1:]:
                if timing[name] is not None:
                    logger.log_scalar(f"time/{name}", timing[name], step=timing["epoch"])

    try:
        yield log
    finally:
        if settings.tensorboard:
            loggers[0].experiment.close()
