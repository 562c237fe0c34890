"""The command `swarm`: every command and its options, and the one place where an error becomes a line.

Heavy imports wait until they are needed.
"""

from __future__ import annotations

import errno
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

if TYPE_CHECKING:
    from swarm.population.evaluation import Evaluation
    from trainers.settings.schema import Settings
    from trainers.training.loop import Training
    from trainers.training.run_folder import RunFolder

SEVERAL, SHOW, RESUME, FOLDER = ("-m", "--multirun"), "--show", "resume=", "hydra.run.dir="


@contextmanager
def errors_as_lines() -> Iterator[None]:
    """Within, what a user can do something about ends the command with a line and exit code 2."""
    try:
        yield
    except (Exception, KeyboardInterrupt) as error:
        if (line := line_of(error)) is None:
            raise
        from swarm._support.terminal import tell

        tell(" ".join(["swarm:", *"; ".join([line, *getattr(error, "__notes__", ())]).splitlines()]))
        raise typer.Exit(2) from None


def line_of(error: BaseException) -> str | None:
    """What is said of an error; None where the user can do nothing about it."""
    from trainers.training.run_folder import RunError

    match error:
        case BrokenPipeError():  # nobody reads on
            return None
        case OSError() if error.strerror and (error.filename or error.errno == errno.ENOSPC):
            return f"{error.strerror}: {error.filename or 'standard output'}"  # files are named
        case MemoryError():
            return "there was not enough memory"
        case KeyboardInterrupt():
            return str(error) or "stopped"
        case ImportError() | OSError() | ValueError() | TypeError() | RunError():
            return str(error)
    return None


class Commands(TyperGroup):
    """All commands, whose errors become lines."""

    def invoke(self, ctx: Any) -> Any:
        """As a group does."""
        with errors_as_lines():
            result = super().invoke(ctx)
            sys.stdout.flush()
            return result


app = typer.Typer(
    name="swarm",
    cls=Commands,
    help="Learning to steer chemotactic microswimmers in crowds.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    help="""Train a policy: `swarm train experiment=linear_n4 recipe=swarm seed=0 key=value …`

    `algorithm=ppo` learns by PPO instead of DQN, `hydra.run.dir=DIR` chooses the folder, `resume=DIR` goes on
    with a run, `-m` sweeps over values with commas (`seed=0,1,2`), `--show` prints the settings and ends.""",
)
def train(context: typer.Context) -> None:
    """Train a policy."""
    from swarm._support.terminal import Told
    from trainers.settings.composition import settings_from

    words, others = context.args, (*SEVERAL, RESUME)
    if SHOW in words and not any(word.startswith(others) for word in words):
        shown = settings_from([word for word in words if word != SHOW and not word.startswith(FOLDER)])
        print(shown.as_yaml().rstrip())
    else:
        with redirect_stdout(Told(sys.stdout)):
            _train(words)


def _train(given: Sequence[str]) -> None:
    from trainers.jobs.sweep import sweep
    from trainers.settings.composition import settings_from

    words = [word for word in given if word not in SEVERAL]
    if len(words) < len(given):
        return sweep(words)
    resumed = [word.removeprefix(RESUME) for word in words if word.startswith(RESUME)]
    folders = [word.removeprefix(FOLDER) for word in words if word.startswith(FOLDER)]
    plain = [word for word in words if not word.startswith((RESUME, FOLDER))]
    if resumed:
        if plain or folders or len(resumed) > 1:
            rule = "resume goes on with the settings stored in the run, nothing else may be given, got"
            raise ValueError(f"{rule} {' '.join(words)}")
        return resume(Path(resumed[0]))
    return begin(settings_from(plain), Path(folders[-1]) if folders else None)


def begin(settings: Settings, folder: Path | None = None) -> None:
    """Train in a new folder."""
    from trainers.training import run as running

    training, run = running.begin(folder, settings)
    print(settings.as_yaml().rstrip(), flush=True)
    _complete(training, run)


def resume(folder: Path) -> None:
    """Go on with a run."""
    from trainers.settings.composition import settings_from_stored
    from trainers.training import run as running
    from trainers.training.run_folder import RunFolder

    run, stored = RunFolder.open(folder)
    settings = settings_from_stored(stored, run.path)
    if run.finished:
        print(f"{folder} is finished after {settings.learning.epochs} epochs; nothing is left to learn")
        _print_test(running.test(settings, run))
    else:
        _complete(*running.resume(folder))


def _complete(training: Training, run: RunFolder) -> None:
    """Train to the end, and test the kept policy where that is wanted."""
    from swarm._support.terminal import Progress
    from trainers.training import run as running

    epochs, started = training.settings.learning.epochs, time.perf_counter()
    with Progress("training", epochs) as bar:

        def report(training: Training, seconds: float) -> None:
            text = f"epoch {training.epoch}/{epochs}  {running.standing(training)}{seconds:.2f} s/epoch"
            bar.show(training.epoch, text=text)
            if training.epoch == epochs:
                bar.say(text)

        tested = running.complete(training, run, report=report)
    print(f"trained in {time.perf_counter() - started:.1f} s; policy, metrics and figure are in {run.path}")
    _print_test(tested)


def _print_test(tested: Evaluation | None) -> None:
    from swarm._support.terminal import print_table

    if tested is None:
        return
    limit = tested.summary["limit"]
    print_table(tested.table.headings, tested.table.texts)
    print("limit:", "none is known" if limit is None else f"{limit:.2f}, which no policy can exceed")


POLICY = "A run folder, a policy file, zoo:NAME, greedy, swinging, random or optimal"
Experiment = Annotated[str | None, typer.Option(help="Whose world; default: the policy's own.")]
Cells = Annotated[int | None, typer.Option(help="How many cells; default: as the policy's own, or 40.")]
Life = Annotated[float | None, typer.Option(help="Length of a life, t_life; default: alike, or 80.")]
Seed = Annotated[int, typer.Option(help="Seed of the starts.")]
NewFolder = Annotated[Path | None, typer.Option(help="New folder for tables, results and figures.")]
Worlds = typer.Option(help="How many worlds of so many cells; default: as its own, or 1; a contest 40.")
Against = typer.Option(help="A policy to race against in the same worlds.", metavar="POLICY")
Share = typer.Option(help="Of the cells, which the first policy steers against the other; default: 0.5.")
Noise = typer.Option(help="Strength of a perturbation; several draw gain against noise.", metavar="LEVEL,...")
NoiseKind = typer.Option(help="What --noise perturbs: concentration (default), curvature or rotation.")
Picture = typer.Option(help="A film (.mp4, .gif) or a page (.html); without: a window.")
Size = typer.Option(help="Height of a film in pixels; default: 720, of a .gif 360.")


@app.command()
def evaluate(
    policy: Annotated[str, typer.Argument(help=f"{POLICY}.")],
    experiment: Experiment = None,
    cells: Cells = None,
    life: Life = None,
    seed: Seed = 0,
    noise: Annotated[list[str] | None, Noise] = None,
    noise_kind: Annotated[str | None, NoiseKind] = None,
    worlds: Annotated[int | None, Worlds] = None,
    against: Annotated[str | None, Against] = None,
    share: Annotated[float | None, Share] = None,
    out: NewFolder = None,
) -> None:
    """Test a policy on fresh cells, next to greedy, swinging and the physical limit."""
    from swarm._support import files
    from swarm._support.terminal import print_table
    from trainers.jobs.trial import trial

    if out is not None:
        files.check_new_folder(out)
    sizes: dict[str, Any] = {"cells": cells, "worlds": worlds, "life": life, "seed": seed}
    perturbed: dict[str, Any] = {"levels": noise or (), "kind": noise_kind}
    found = trial(policy, experiment, **sizes, **perturbed, against=against, share=share)
    if out is not None:
        found.save(out)
    if found.tested is not None:
        _print_test(found.tested)
    else:
        print_table(found.table.headings, found.table.texts)
    if out is not None:
        print(f"results and figures are in {out}")


@app.command()
def compare(
    folders: Annotated[list[Path], typer.Argument(help="Folders of finished runs.", metavar="RUN RUN ...")],
    cells: Cells = None,
    worlds: Annotated[int | None, Worlds] = None,
    seed: Seed = 0,
    out: NewFolder = None,
) -> None:
    """Put runs side by side, with intervals over seeds."""
    from swarm._support.terminal import print_table
    from trainers.jobs import comparison

    groups = comparison.compare(folders, cells=cells, worlds=worlds, seed=seed, out=out)
    table = comparison.table(groups)
    print_table(table.headings, table.texts)
    if out is not None:
        print(f"table and figure are in {out}")


@app.command()
def watch(
    policy: Annotated[str, typer.Argument(help=f"{POLICY}; or a population.nc, for a page.")],
    experiment: Experiment = None,
    cells: Cells = None,
    life: Life = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the starts; default: 0.")] = None,
    against: Annotated[str | None, Against] = None,
    share: Annotated[float | None, Share] = None,
    out: Annotated[Path | None, Picture] = None,
    size: Annotated[int | None, Size] = None,
) -> None:
    """Watch a policy steer a swarm."""
    from swarm._support.checks import check_count
    from swarm._support.terminal import Progress
    from swarm.figures import watch as watching
    from trainers.settings.composition import settings_of

    if Path(policy).suffix.lower() == watching.POPULATION:
        given = {"--experiment": experiment, "--life": life, "--seed": seed, "--size": size}
        given |= {"--against": against, "--share": share}
        for option, value in given.items():
            if value is not None:
                raise ValueError(f"{option} must be left out, {policy} holds lives as they were: got {value}")
        chosen = None if cells is None else check_count("cells", cells)
        watching.save_page_of(Path(policy), out, cells=chosen)
    else:
        watching.check_target(out, size)
        world = settings_of(policy, experiment).test_world().replace(life=80.0 if life is None else life)
        shown: dict[str, Any] = {"cells": 40 if cells is None else cells, "seed": seed or 0}
        shown |= {"against": against, "share": share}
        with Progress("drawing") as bar:
            watching.watch(policy, world, out=out, size=size, progress=bar.show, **shown)
    if out is not None:
        print(f"written to {out}")


@app.command()
def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the report; what is finished there is not redone.")],
    quick: Annotated[bool, typer.Option(help="Test the shipped policies instead of training.")] = False,
    crowd: Annotated[bool, typer.Option("--crowd", help="The experiments on crowds instead.")] = False,
    seeds: Annotated[int | None, typer.Option(help="Training seeds; default: 20, of crowds 5.")] = None,
    jobs: Annotated[int | None, typer.Option(help="Processes at once; default: 2, or 1 on one core.")] = None,
    publish: Annotated[Path | None, typer.Option(help="Folder for a copy without the runs.")] = None,
    ship: Annotated[bool, typer.Option("--ship", help="Replace the shipped policies by the best.")] = False,
) -> None:
    """Reproduce every figure and table of the paper, with a verdict on each of its claims."""
    from swarm._support import files
    from swarm._support.checks import check_count
    from trainers.crowd import reproduction as crowds
    from trainers.crowd.plan import CrowdPlan
    from trainers.paper import reproduction as paper
    from trainers.paper.plan import Plan

    changes: dict[str, Any] = {"quick": quick}
    changes |= {} if seeds is None else {"n_seeds": check_count("--seeds", seeds)}
    changes |= {} if jobs is None else {"workers": check_count("--jobs", jobs)}
    places = files.expanded(out), publish and files.expanded(publish)
    if crowd:
        judged = crowds.reproduce(CrowdPlan(**changes), *places, ship=ship)
    else:
        judged = paper.reproduce(Plan(**changes), *places, ship=ship)
    verdicts = Counter(claim.verdict for claim in judged)
    print(f"{len(judged)} claims: " + ", ".join(f"{count} {name}" for name, count in verdicts.most_common()))
    print(f"the report is {out / 'report.md'}")


@app.command()
def check() -> None:
    """Run every check of the environments' interfaces there is, warnings as errors."""
    from swarm._support.terminal import print_table
    from swarm.envs.conformance import run_checks

    found = run_checks()
    results = {True: "passed", False: "FAILED", None: "skipped"}
    rows = [[each.name, results[each.passed], each.detail] for each in found]
    print_table(["check", "result", "detail"], rows)
    if any(each.passed is False for each in found):
        raise typer.Exit(1)
