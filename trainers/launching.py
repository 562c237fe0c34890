"""What the commands do: check everything, then run; bad input ends in one line, not in a traceback."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swarm.checks import check_count
from trainers.cli import fail
from trainers.composing import SettingsError, settings_from, settings_from_stored
from trainers.machine import prepare
from trainers.settings import Settings

RUN_FOLDER = "hydra.run.dir="


def train_from(words: Sequence[str]) -> None:
    """`swarm train`."""
    words = list(words)
    if "-m" in words or "--multirun" in words:
        from trainers.sweeping import sweep

        return sweep([word for word in words if word not in ("-m", "--multirun")])
    show = "--show" in words
    words = [word for word in words if word != "--show"]
    resumed = [word.removeprefix("resume=") for word in words if word.startswith("resume=")]
    folders = [word.removeprefix(RUN_FOLDER) for word in words if word.startswith(RUN_FOLDER)]
    plain = [word for word in words if not word.startswith(("resume=", RUN_FOLDER))]
    if resumed:
        if plain or folders or len(resumed) > 1:
            fail(
                "resume goes on with the settings stored in the run, nothing else may be given, got "
                + " ".join(words)
            )
        return resume(Path(resumed[0]))
    try:
        settings = settings_from(plain)
    except SettingsError as error:
        fail(error)
    if show:
        print(described(settings))
        return None
    return begin(settings, Path(folders[-1]) if folders else None)


def begin(settings: Settings, folder: Path | None) -> None:
    """Train in a new folder."""
    from swarm import files
    from trainers import runs

    folder = folder or runs.default_folder(settings)
    try:
        files.check_new_folder(folder)
        print(described(settings))
        prepared = prepare(settings)
        run = runs.RunFolder.create(folder, settings)
    except SettingsError as error:
        fail(error)
    except OSError as error:
        fail(file_trouble(error))
    carry_on(prepared, run)


def resume(path: Path) -> None:
    """Go on with a run."""
    from swarm import provenance
    from trainers import runs

    try:
        run, stored = runs.RunFolder.open(path)
        settings = settings_from_stored(stored)
        if run.finished:
            print(f"{path} is finished after {settings.learning.epochs} epochs; nothing is left to learn")
            return test_after(settings, run)
        prepared = prepare(settings)
    except (runs.RunError, SettingsError) as error:
        fail(error)
    except OSError as error:
        fail(file_trouble(error))
    then, now = run.record.get("versions"), provenance.versions()
    if isinstance(then, dict) and (changed := [name for name in now if then.get(name) != now[name]]):
        print(
            f"{', '.join(changed)} changed since the run began: it goes on, but not bit for bit",
            file=sys.stderr,
        )
    carry_on(prepared, run)


def carry_on(prepared: Any, run: Any) -> None:
    """Train to the end, draw the training figure, and test the kept policy where that is wanted."""
    from trainers import running, runs

    settings = prepared.settings
    how = f"to go on: swarm train resume={run.path}"
    started = time.perf_counter()
    try:
        running.complete(prepared, run, report=progress_line(settings))
    except runs.RunError as error:
        fail(error)
    except OSError as error:
        fail(f"{file_trouble(error)}; what was saved before is kept; {how}")
    except MemoryError:
        fail(f"there was not enough memory; what was saved before is kept; {how}")
    except KeyboardInterrupt:
        fail(f"stopped at once; what was saved before is kept; {how}")
    print(f"trained in {time.perf_counter() - started:.1f} s; policy, metrics and figure are in {run.path}")
    test_after(settings, run)


def test_after(settings: Settings, run: Any) -> None:
    """Test the kept policy where that is wanted and was not done."""
    folder, test = run.path / "evaluation", settings.evaluation
    if settings.evaluate and not folder.exists():
        evaluate_from(str(run.path), None, test.cells, test.life, test.seed, 0.0, folder)


def file_trouble(error: OSError) -> str:
    """What went wrong with which file."""
    return f"{error.strerror}: {error.filename}" if error.strerror and error.filename else str(error)


def evaluate_from(
    policy: str,
    experiment: str | None,
    cells: int | None,
    life: float | None,
    seed: int,
    noise: float,
    out: Path | None,
) -> None:
    """`swarm evaluate`; without an experiment, the world of the test is the policy's own."""
    from swarm import evaluation
    from swarm.policy_files import PolicyError

    try:
        settings = test_settings(policy, experiment)
        test = settings.evaluation
        done = evaluation.evaluate(
            policy,
            settings.test_world().replace(concentration_noise=noise),
            experiment=settings.experiment,
            cells=test.cells if cells is None else cells,
            life=test.life if life is None else life,
            seed=seed,
            out=out,
        )
    except OSError as error:
        fail(file_trouble(error))
    except (SettingsError, PolicyError, ValueError, TypeError, MemoryError) as error:
        fail(error)
    show_table(done.table)
    limit = done.summary["limit"]
    print(
        "limit: none is known for this world"
        if limit is None
        else f"limit: {limit:.2f}, which no policy can exceed"
    )
    if out is not None:
        print(f"results and figures are in {out}")


def watch_from(
    policy: str, experiment: str | None, cells: int, life: float, seed: int, out: Path | None
) -> None:
    """`swarm watch`."""
    from rich.progress import Progress

    from swarm.policy_files import PolicyError
    from trainers import watching

    try:
        watching.check_target(out)
        world = test_settings(policy, experiment).test_world().replace(life=life)
        with Progress(transient=True, disable=out is None or not sys.stderr.isatty()) as bar:
            task = bar.add_task("drawing", total=None)
            watching.watch(
                policy,
                world,
                cells=cells,
                seed=seed,
                out=out,
                progress=lambda done, most: bar.update(task, completed=done, total=most),
            )
    except ImportError as error:
        fail(f"this needs a further package: {error}")
    except (SettingsError, PolicyError, OSError, ValueError, TypeError) as error:
        fail(error)
    if out is not None:
        print(f"written to {out}")


def compare_from(folders: Sequence[Path], cells: int, seed: int, out: Path | None) -> None:
    """`swarm compare`."""
    from swarm.policy_files import PolicyError
    from trainers import comparing, runs

    try:
        groups = comparing.compare(folders, cells=cells, seed=seed, out=out)
    except OSError as error:
        fail(file_trouble(error))
    except (runs.RunError, SettingsError, PolicyError, ValueError, TypeError, MemoryError) as error:
        fail(error)
    show_table(comparing.table(groups))
    if out is not None:
        print(f"table and figure are in {out}")


def reproduce_from(out: Path, quick: bool, seeds: int, jobs: int | None, publish: Path | None) -> None:
    """`swarm reproduce`."""
    try:
        from trainers import reproducing
        from trainers.dispatching import Stopped
        from trainers.planning import Plan
    except ImportError as error:
        fail(f"this needs the extra packages of chemoswarm[train]: {error}")
    try:
        plan = Plan(quick=quick, n_seeds=check_count("--seeds", seeds))
        if jobs is not None:
            plan = dataclasses.replace(plan, workers=check_count("--jobs", jobs))
        claims = reproducing.reproduce(plan, out, publish)
    except (reproducing.ReproductionError, SettingsError, Stopped, ValueError) as error:
        fail(error)
    except OSError as error:
        fail(file_trouble(error))
    verdicts = Counter(claim.verdict for claim in claims)
    print(f"{len(claims)} claims: " + ", ".join(f"{count} {name}" for name, count in verdicts.most_common()))
    print(f"the report is {out / 'report.md'}")


def check_from() -> None:
    """`swarm check`; ends with exit code 1 where a check fails."""
    from swarm.conformance import run_checks

    checks = run_checks()
    rows = [["check", "result", "detail"]]
    rows += [
        [each.name, {True: "passed", False: "FAILED", None: "skipped"}[each.passed], each.detail]
        for each in checks
    ]
    show_table(rows)
    if any(each.passed is False for each in checks):
        raise SystemExit(1)


def test_settings(policy: str, experiment: str | None) -> Settings:
    """Settings of an experiment, or those a trained policy's card tells of, else of linear_n4."""
    from swarm.evaluation import STRATEGIES, named_policy
    from swarm.network import ZOO, load_policy
    from swarm.world import World

    if experiment is not None:
        return settings_from([f"experiment={experiment}"])
    if policy in STRATEGIES:
        return settings_from([])
    if not policy.startswith(ZOO) and not Path(policy).exists():
        named_policy(policy, World())  # raises, and suggests what may be meant
    card = load_policy(policy).card
    known = card.get("settings")
    known = known if isinstance(known, dict) else {}
    stored = {name: known[name] for name in ("world", "evaluation") if name in known}
    return settings_from_stored({"experiment": str(card.get("experiment", "own")), **stored})


def show_table(rows: list[list[str]]) -> None:
    """Print rows under the headings in the first of them."""
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for index, heading in enumerate(rows[0]):
        table.add_column(heading, justify="right" if index else "left", no_wrap=True)
    for row in rows[1:]:
        table.add_row(*row)
    console = Console()
    Console(width=max(console.width, 100)).print(table)


def described(settings: Settings) -> str:
    """The resolved settings as YAML."""
    import yaml

    return yaml.safe_dump(dataclasses.asdict(settings), sort_keys=False).rstrip()


def progress_line(settings: Settings) -> Any:
    """A reporter of each epoch: one line that is overwritten on a terminal, else a line per validation."""
    live = sys.stderr.isatty()

    def report(training: Any, seconds: float) -> None:
        import numpy as np

        gain, fraction = training.latest_validation()
        text = f"epoch {training.epoch}/{settings.learning.epochs}"
        if not np.isnan(gain):
            text += f"  gain {gain:.2f}"
            if not np.isnan(fraction):
                text += f" = {100 * fraction:.1f}% of the limit"
        text += f"  best {training.best_gain.mean():.2f}  {seconds:.2f} s/epoch"
        last = training.epoch == settings.learning.epochs
        if live:
            print(f"\r\033[K{text}", end="\n" if last else "", file=sys.stderr, flush=True)
        elif last or training.epoch % (10 * settings.validation.every) == 0:
            print(text, file=sys.stderr, flush=True)

    return report
