"""Registries: classes by the names that users choose them by, from here or from a user's own package."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

from swarm._support.checks import check_name

Kind = TypeVar("Kind", bound=type)

TYPE = "type"  # the key of a description under which the name stands


class Registry(Mapping[str, type]):
    """Classes of one thing by name: a field, a flow, a sensor, a reward.

    A class registers itself where it is defined, or stands in the entry points of an installed package, which
    is imported when its name is first asked for. Its parameters are those of its constructor, and attributes
    of the same names hold them; where they do not, `parameters()` returns them by name.
    """

    def __init__(self, thing: str, group: str) -> None:
        self.thing = thing  # what errors call it
        self.group = group  # of entry points
        self._kinds: dict[str, type] = {}
        self._renamed: dict[str, dict[str, str]] = {}  # by name: what descriptions call a parameter

    def register(self, name: str, **renamed: str) -> Callable[[Kind], Kind]:
        """Decorator of a class that makes it known by `name`; a definition that is run again replaces itself.

        `renamed` says what descriptions call a parameter of the constructor. Raises ValueError where another
        class has the name.
        """

        def keep(kind: Kind) -> Kind:
            known = self._kinds.get(name, kind)
            if (known.__module__, known.__qualname__) != (kind.__module__, kind.__qualname__):
                raise ValueError(f"{self.thing} {name!r} must be one class, got {known!r} and {kind!r}")
            self._kinds[name], self._renamed[name] = kind, renamed
            return kind

        return keep

    def __getitem__(self, name: str) -> type:
        if name not in self._kinds:
            found = list(entry_points(group=self.group, name=name))
            if not found:
                raise KeyError(name)
            self._load(found)
        return self._kinds[name]

    def __iter__(self) -> Iterator[str]:
        return iter(sorted({*self._kinds, *entry_points(group=self.group).names}))

    def __len__(self) -> int:
        return len(list(iter(self)))

    @property
    def registered(self) -> dict[str, type]:
        """The classes that are known without importing anything."""
        return dict(self._kinds)

    def _load(self, found: list[EntryPoint]) -> None:
        name = found[0].name
        if len({point.value for point in found}) > 1:
            places = ", ".join(point.value for point in found)
            raise ValueError(f"{self.thing} {name!r} must come from one package, got {places}")
        try:
            kind = found[0].load()
        except Exception as error:  # a stranger's module may fail in any way
            raise ValueError(
                f"{self.thing} {name!r} must be importable from {found[0].value}, "
                f"got {type(error).__name__}: {error}"
            ) from None
        if not isinstance(kind, type):
            raise ValueError(f"{self.thing} {name!r} must be a class, got {kind!r} from {found[0].value}")
        if self._kinds.get(name) is not kind:  # which importing it may have registered
            self.register(name)(kind)

    def make(self, value: Any) -> Any:
        """The object that `value` describes: a name, or a mapping `{"type": name, parameter: number, …}`.

        Anything else is returned as it is, an object already. Raises TypeError, ValueError or OSError that
        names what is wrong, the rule, the value and the nearest name.
        """
        if isinstance(value, str):
            value = {TYPE: value}
        if not isinstance(value, Mapping):
            return value
        given = dict(value)
        if TYPE not in given:
            raise ValueError(f"{self.thing} must state its type, one of {', '.join(self)}, got {given}")
        name = given.pop(TYPE)
        if not isinstance(name, str) or name not in self:
            check_name(self.thing, name, self)
        known = self.parameters_of(name)
        for key in given:
            check_name(f"parameter of {self.thing} {name!r}", key, known)
        missing = [key for key, each in known.items() if each.default is each.empty and key not in given]
        if missing:
            raise TypeError(f"{self.thing} {name!r} must have {', '.join(missing)}, got {given}")
        try:
            return self[name](**{known[key].name: number for key, number in given.items()})
        except (TypeError, ValueError, OSError) as error:
            kind = next(each for each in (TypeError, ValueError, OSError) if isinstance(error, each))
            raise kind(f"{self.thing} {name!r}: {error}") from None

    def describe(self, part: Any) -> dict[str, Any] | None:
        """What `make` makes `part` of again, as plain data: its name and every parameter.

        None for an object whose class has no name here, or whose parameters are more than plain data.
        """
        name = next((name for name, kind in self._kinds.items() if type(part) is kind), None)
        if name is None:
            return None
        told = getattr(part, "parameters", None)
        known = self.parameters_of(name)
        values = told() if callable(told) else {key: getattr(part, key, ...) for key in known}
        try:  # pairs become lists
            return {TYPE: name, **json.loads(json.dumps(values, allow_nan=False))}
        except (TypeError, ValueError):
            return None

    def parameters_of(self, name: str) -> dict[str, inspect.Parameter]:
        """The constructor's parameters by what descriptions call them."""
        renamed, given = self._renamed[name], inspect.signature(self[name]).parameters.values()
        named = [each for each in given if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)]
        return {renamed.get(each.name, each.name): each for each in named}
