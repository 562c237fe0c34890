"""Files written whole or not at all: a temporary sibling, flushed to the disk, then renamed."""

from __future__ import annotations

import errno
import itertools
import os
import shutil
import stat
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LOCK = ".lock"


def expanded(path: str | os.PathLike) -> Path:
    """The path, whose first part may be `~`, the user's home, as it is in a shell.

    Raises ValueError for a name that is no text, as with Latin-1's bytes, or any ü where the locale has none.
    """
    try:
        os.fspath(path).encode()
    except UnicodeEncodeError:
        rule = "must be a path in UTF-8, in a locale that knows it (LC_ALL=C.UTF-8)"
        raise ValueError(f"{os.fspath(path)!a} {rule}") from None
    try:
        return Path(path).expanduser()
    except RuntimeError:
        raise ValueError(f"the home folder of {path} must be known, but is not") from None


def check_ordinary(path: str | os.PathLike, *, at_most: int) -> int:
    """The bytes of a file; raises ValueError unless it is an ordinary one that has at most so many."""
    about = os.stat(expanded(path))
    if not stat.S_ISREG(about.st_mode):
        raise ValueError(f"{path} must be an ordinary file")
    if about.st_size > at_most:
        raise ValueError(f"{path} must have at most {at_most} bytes, got {about.st_size}")
    return about.st_size


def read_bytes(path: str | os.PathLike, *, at_most: int) -> bytes:
    """The content of an ordinary file; raises ValueError for anything else and for more bytes than that."""
    size = check_ordinary(path, at_most=at_most)
    with open(expanded(path), "rb") as file:
        data = file.read(size + 1)  # not more: so much is set aside at once
    if len(data) > size:
        raise ValueError(f"{path} must have at most {at_most} bytes, got {len(data)} or more")
    return data


@contextmanager
def naming(path: str | os.PathLike, temporary: Path | None = None) -> Iterator[None]:
    """Within, an OSError names this path where it names none, as a full disk's does, or the temporary one."""
    try:
        yield
    except OSError as error:
        target, hidden = Path(path), "\0" if temporary is None else temporary.name
        if error.strerror:
            error.filename = str(error.filename or target).replace(hidden, target.name)
            if error.filename2 is not None:
                del error.filename2
        else:  # of libraries that put all they say into one text
            error.args = tuple(str(each).replace(hidden, target.name) for each in error.args)
        raise


@contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary path to write to; at the end it takes the place of `path`, after an error it is removed."""
    target = expanded(path)
    temporary = _sibling(target)
    try:
        with naming(target, temporary):
            yield temporary
            _flush(temporary)
            os.replace(temporary, target)
            _flush(target.parent)
    finally:
        temporary.unlink(missing_ok=True)


def write_bytes(path: str | os.PathLike, data: bytes) -> None:
    """Writes `data` to `path`; whoever reads it sees the old file or the new one."""
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: str | os.PathLike, text: str) -> None:
    """Writes `text` to `path` in UTF-8; whoever reads it sees the old file or the new one."""
    write_bytes(path, text.encode())


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Within, no other process has this folder; raises FileExistsError where another does.

    The operating system lets go of the lock when the process ends, however it ends.
    """
    import fcntl

    with (folder / LOCK).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            rule = "is being worked on by another process: wait for it or stop it"
            raise FileExistsError(f"{folder} {rule}") from None
        except OSError:  # a file system without locks
            pass
        yield


def check_new_folder(path: str | os.PathLike) -> Path:
    """Return `path`; raises FileExistsError unless there is nothing yet, or an empty folder."""
    folder = expanded(path)
    if folder.is_dir() and not any(folder.iterdir()):
        return folder
    if folder.exists() or folder.is_symlink():
        raise FileExistsError(
            f"{folder} must be a new or an empty folder: what is there is never overwritten"
        )
    return folder


def check_room(path: str | os.PathLike, needed: float) -> None:
    """Raises OSError unless the disk of a path, which need not be there yet, has so many bytes left."""
    folder = expanded(path).absolute()
    free = shutil.disk_usage(next(each for each in (folder, *folder.parents) if each.exists())).free
    if needed > free:
        rule = f"must have room for {needed / 2**20:,.0f} MiB"
        raise OSError(f"the disk of {path} {rule}, got {free / 2**20:,.0f} MiB")


def reserved(path: str | os.PathLike) -> Path:
    """A new empty folder: `path`, or where that is taken the first of `path`-2, `path`-3, …

    However many processes ask for it at once, each gets one of its own. Parents are made.
    """
    wanted = expanded(path)
    wanted.parent.mkdir(parents=True, exist_ok=True)
    for name in itertools.chain([wanted.name], (f"{wanted.name}-{count}" for count in itertools.count(2))):
        with suppress(FileExistsError):
            wanted.with_name(name).mkdir()
            return wanted.with_name(name)
    raise AssertionError


@contextmanager
def new_folder(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary folder to fill; at the end it becomes the folder `path`, after an error it is removed.

    Raises FileExistsError unless `path` is new or an empty folder. Parents are made.
    """
    target = check_new_folder(path)
    if target.exists() and target.samefile(Path.cwd()):  # it would be swapped under the caller's feet
        raise FileExistsError(f"{target} must be a new folder, not the current one")
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = _sibling(target)
    try:
        with naming(target, temporary):
            temporary.mkdir()
            yield temporary
            for file in temporary.rglob("*"):
                _flush(file)
            _flush(temporary)
            os.replace(temporary, target)
            _flush(target.parent)
    except OSError as error:
        if error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):  # another process was faster
            check_new_folder(target)
        raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _sibling(path: Path) -> Path:
    """A path beside `path`, so that the rename stays within one file system, that no other process takes."""
    return path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}")


def _flush(path: Path) -> None:
    """Waits until the file's or folder's content is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
