"""Where the command `swarm` begins: what must hold before anything else is loaded."""

from __future__ import annotations

import io
import os
import signal
import sys
from types import FrameType

LEARN = ("train", "study", "minimal", "reproduce")  # commands whose extra brings all that others need, too


def main() -> None:
    """Run the command line; Ctrl-C and SIGTERM end it with a line, whenever they come."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    if sys.platform == "win32":
        _end("the command runs on Linux and macOS, and on Windows within WSL")
    if sys.argv[1:] == ["--version"]:
        from swarm import __version__

        return print(f"chemoswarm {__version__}")
    try:
        os.getcwd()
    except FileNotFoundError:
        _end("the current folder must be there, but was removed: change to another")
    try:
        _open_streams()
        _run()
    except KeyboardInterrupt:
        _end("stopped")


def _open_streams() -> None:
    """Files must not take the numbers of streams that are closed."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = sys.stdout or os.fdopen(1, "w")
    sys.stderr = sys.stderr or os.fdopen(2, "w")
    if isinstance(sys.stdout, io.TextIOWrapper):  # a name that the terminal's encoding lacks is no bug
        sys.stdout.reconfigure(errors="backslashreplace")


def _run() -> None:
    try:
        from trainers.cli import app
    except ModuleNotFoundError:
        _end(_missing())

    try:
        app()
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # nobody reads on: to end as other commands then do
            signal.signal(signal.SIGPIPE, signal.SIG_DFL)
            os.kill(os.getpid(), signal.SIGPIPE)
        raise
    finally:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (OSError, ValueError):  # of which has been told
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _missing() -> str:
    """What this command lacks."""
    try:
        import trainers.settings  # noqa: F401
    except ModuleNotFoundError as error:
        line, word = str(error), sys.argv[1] if sys.argv[1:] else ""
        return line.replace("[results]", "[train]") if word in LEARN else line
    raise


def _stop(number: int, frame: FrameType | None) -> None:
    """While modules are loaded the process ends at once, for what is loaded by halves can say nothing."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            _end("stopped")
        frame = frame.f_back
    raise KeyboardInterrupt


def _end(line: str) -> None:
    """End the process as it is, with a line."""
    try:
        os.write(2, f"swarm: {line}\n".encode())
    finally:
        os._exit(2)


if __name__ == "__main__":
    main()
