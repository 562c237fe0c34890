"""`swarm list`, and the lists in `--help`: what can be chosen by name."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from trainers.cli.app import app

if TYPE_CHECKING:
    from swarm._support.registry import Registry
    from swarm._support.tables import Table

SECTIONS = (
    *("experiments", "recipes", "algorithms", "zoo"),
    *("fields", "flows", "sensors", "rewards", "interactions"),
)


@app.command("list")
def show(
    section: Annotated[
        str | None, typer.Argument(help=f"One of {', '.join(SECTIONS)}; default: all.", metavar="SECTION")
    ] = None,
) -> None:
    """List what can be chosen by name: experiments, recipes, algorithms, policies, parts of a world."""
    from swarm._support.checks import check_name
    from swarm._support.terminal import print_table

    chosen = SECTIONS if section is None else (check_name("section", section, SECTIONS),)
    for place, each in enumerate(chosen):
        if len(chosen) > 1:
            print(*([""] if place else []), each.upper(), sep="\n")
        found = tables()[each]()
        print_table(found.headings, found.texts)


def tables() -> dict[str, Callable[[], Table]]:
    """What makes the table of each section."""
    import functools

    from swarm.physics.crowd.interactions import INTERACTIONS
    from swarm.physics.world.rules import PARTS
    from trainers.settings.learning import ALGORITHMS

    registries = {f"{name}s": known for name, known in PARTS.items()} | {"interactions": INTERACTIONS}
    return {
        "experiments": functools.partial(_files, "experiment"),
        "recipes": functools.partial(_files, "recipe"),
        "algorithms": functools.partial(_classes, ALGORITHMS),
        "zoo": _zoo,
        **{name: functools.partial(_classes, known) for name, known in registries.items()},
    }


def _files(group: str) -> Table:
    """Files of settings: what they say of themselves, and set."""
    import yaml

    from swarm._support.tables import Table
    from trainers.settings.composition import config_folder, names_of, written
    from trainers.settings.schema import dotted

    rows = []
    for name in names_of(group):
        text = (config_folder() / group / f"{name}.yaml").read_text(encoding="utf-8")
        comments = [
            line[2:] for line in text.splitlines() if line.startswith("# ") and "@package" not in line
        ]
        values = yaml.safe_load(text)
        values.pop(group)
        words = [f"{key}={written(value)}" for key, value in dotted(values).items()]
        rows.append([name, " ".join(comments), ", ".join(words)])
    return Table([group, "what it is", "what it sets"], rows)


def _classes(known: Registry) -> Table:
    """Classes by name: what they are, and their parameters with the defaults."""
    from swarm._support.tables import Table

    rows = []
    for name in known:
        try:
            about, parameters = inspect.getdoc(known[name]) or "", known.parameters_of(name)
        except ValueError as error:  # of somebody's package
            rows.append([name, str(error), ""])
            continue
        words = [f"{key}={_default(known[name], each)}" for key, each in parameters.items()]
        rows.append([name, " ".join(about.split("\n\n")[0].split()), ", ".join(words)])
    return Table([known.thing, "what it is", "parameters and defaults"], rows)


def _default(kind: type, parameter: inspect.Parameter) -> str:
    from trainers.settings.composition import written

    if parameter.default is parameter.empty:
        return "…"  # must be given
    field = getattr(kind, "__dataclass_fields__", {}).get(parameter.name)
    factory = getattr(field, "default_factory", None)
    return written(factory() if callable(factory) else parameter.default)


def _zoo() -> Table:
    """Shipped policies, with what their cards say of the test that the reproduction made."""
    from swarm._support.tables import Table, percent
    from swarm.policies.network import ZOO, load_policy, zoo_names

    rows = []
    for name in zoo_names():
        test = load_policy(ZOO + name).card.get("test", {})
        gain, life = test.get("gain"), test.get("life")
        mean = gain["mean"] if isinstance(gain, Mapping) else gain
        gains = [None if each is None else f"{each:.2f}" for each in (mean, test.get("greedy"))]
        parts = [percent(test.get(each)) for each in ("fraction_of_limit", "arrived", "won")]
        rows.append([ZOO + name, None if life is None else f"{life:g}", *gains, *parts])
    return Table(["policy", "life", "gain", "greedy", "of the limit", "arrived", "won"], rows)


class Listing(TyperCommand):
    """A command in whose help {experiments}, {recipes} and so on stand for their names; they are looked up
    when the help is read.
    """

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """As a command does."""
        names = _names()
        self.help = _filled(self.help, names)
        for each in self.params:
            each.help = _filled(getattr(each, "help", None), names)  # type: ignore[attr-defined]
        super().format_help(ctx, formatter)


def _names() -> dict[str, Sequence[str]]:
    from swarm.policies.network import ZOO, zoo_names
    from swarm.population.noise import KINDS
    from trainers.settings.composition import names_of
    from trainers.settings.learning import ALGORITHMS

    return {
        "experiments": names_of("experiment"),
        "recipes": names_of("recipe"),
        "algorithms": list(ALGORITHMS),
        "zoo": [ZOO + name for name in zoo_names()],
        "noises": list(KINDS),
    }


def _filled(text: str | None, names: Mapping[str, Sequence[str]]) -> str | None:
    for key, each in names.items():
        text = text and text.replace(f"{{{key}}}", ", ".join(each))
    return text
