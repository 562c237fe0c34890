"""How Matplotlib is loaded, whatever the settings that a user has for it."""

from __future__ import annotations

import os
import sys
from contextlib import chdir
from importlib.util import find_spec
from unittest import mock

from swarm._support.checks import check_installed


def load_matplotlib() -> None:
    """Load Matplotlib; with settings of the user's that it refuses to be loaded with, without them."""
    try:
        import matplotlib.style
    except (ValueError, KeyError):
        for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
            del sys.modules[name]
        (installed,) = find_spec("matplotlib").submodule_search_locations  # type: ignore[union-attr, misc]
        data = os.path.join(installed, "mpl-data")
        with chdir(data), mock.patch.dict(os.environ, MATPLOTLIBRC=data):  # which holds Matplotlib's defaults
            os.environ.pop("MPLBACKEND", None)
            import matplotlib.style  # noqa: F401


check_installed("figures need", "matplotlib", "contourpy", "PIL", "imageio", extra="results")
load_matplotlib()
