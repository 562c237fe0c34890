"""Where a result comes from: the versions and the commit of the software that made it."""

from __future__ import annotations

import functools
import platform
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

_PACKAGES = ("numpy", "scipy", "torch", "torchrl", "tensordict")


def versions(*packages: str) -> dict[str, str]:
    """Versions of Python, of this software and of the `packages` (default: those that numbers depend on)."""
    found = {name: _version(name) for name in packages or _PACKAGES}
    own = {"python": platform.python_version(), "chemoswarm": __version__}
    return own | {name: version for name, version in found.items() if version is not None}


@functools.cache  # the code that runs stays what it was when it was loaded
def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


@functools.cache
def commit() -> str | None:
    """The commit of this source tree, followed by "-dirty" where files differ; None for an installed copy."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None


def origin() -> dict[str, Any]:
    """What a record says of where it comes from."""
    return {"versions": versions(), "commit": commit()}


def line() -> str:
    """What a report says of where it comes from."""
    told = ", ".join(f"{name} {version}" for name, version in versions().items())
    return f"{told}; commit {commit() or 'unknown'}"
