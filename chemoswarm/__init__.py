"""`swarm` under the name by which it is installed: `chemoswarm.World` is `swarm.World`, and so on inwards."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any

import swarm

if TYPE_CHECKING:
    from swarm import *  # noqa: F403

__all__ = swarm.__all__


class _Inwards(MetaPathFinder, Loader):
    """Finds `chemoswarm.envs` in `swarm.envs`: the same module, not a second one."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        inwards = name.startswith(f"{__name__}.") and name != f"{__name__}.__main__"
        return ModuleSpec(name, self) if inwards else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(f"swarm{spec.name.removeprefix(__name__)}")
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state  # its own, which loading it by this name replaced


sys.meta_path.insert(0, _Inwards())  # before the finder of files, which would load a second copy


def __getattr__(name: str) -> Any:
    return getattr(swarm, name)


def __dir__() -> list[str]:
    return dir(swarm)
