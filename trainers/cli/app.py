"""The command itself, and the one place where an error becomes a line."""

from __future__ import annotations

import errno
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

ORDER = (
    *("train", "evaluate", "compare", "study", "watch", "list"),
    *("reproduce", "minimal", "strategies", "check", "export"),
)


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

    def list_commands(self, ctx: Any) -> list[str]:
        """In the order in which they are used."""
        return sorted(super().list_commands(ctx), key=[*ORDER, *super().list_commands(ctx)].index)

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


def _print_version(asked: bool) -> None:
    if asked:
        from swarm import __version__

        print(f"chemoswarm {__version__}")
        raise typer.Exit


@app.callback()
def _always(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """What every command takes."""
