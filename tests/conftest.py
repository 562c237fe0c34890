"""What every test shares: array libraries, registries that forget, and Hypothesis without a clock."""

import importlib
import importlib.util
import os

import hypothesis
import pytest

import swarm
from trainers.settings.learning import ALGORITHMS

hypothesis.settings.register_profile("default", deadline=None, derandomize=True)
hypothesis.settings.register_profile("explore", deadline=None, max_examples=1000)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

LIBRARIES = {
    "numpy": "numpy",
    "torch": "array_api_compat.torch",
    "array_api_strict": "array_api_strict",
    "jax": "jax.numpy",  # tested where it is installed; slow, because it compiles every shape
}


@pytest.fixture(
    params=[
        pytest.param(name, marks=[pytest.mark.slow] if name == "jax" else [])
        for name in LIBRARIES
        if importlib.util.find_spec(name)
    ]
)
def xp(request):
    """The functions of an array library; physics must not depend on which."""
    if request.param == "jax":
        importlib.import_module("jax").config.update("jax_enable_x64", True)
    return importlib.import_module(LIBRARIES[request.param])


@pytest.fixture(autouse=True)
def forgetful(monkeypatch):
    """What one test registers is unknown to the next."""
    for registry in (swarm.fields, swarm.flows, swarm.sensors, swarm.rewards, ALGORITHMS):
        for kept in ("_kinds", "_renamed"):
            monkeypatch.setattr(registry, kept, dict(getattr(registry, kept)))
