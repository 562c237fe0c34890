"""Evaluation: one policy beside greedy and swinging on a population: results, summary and table."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from swarm._support import files, provenance
from swarm._support.checks import check_number
from swarm._support.tables import Table, percent, span
from swarm.optimal.physical_limit import Optimal
from swarm.optimal.problem import Progress
from swarm.physics.world import World
from swarm.policies.adaptive import AdaptiveSteering
from swarm.policies.network import ZOO, Network, load_policy
from swarm.policies.policy import AnyPolicy
from swarm.policies.policy_file import POLICY_FILE, PolicyError
from swarm.policies.strategies import Greedy, Random, Swinging
from swarm.population.contest import population_test
from swarm.population.contests import contest, race_in
from swarm.population.results import RIVAL, data_of
from swarm.population.statistics import arrivals, statistics

if TYPE_CHECKING:
    import xarray as xr

STRATEGIES: dict[Any, Callable[[World], AnyPolicy]] = {
    "adaptive": lambda world: AdaptiveSteering(),
    "adaptive_on_off": lambda world: AdaptiveSteering(mode="on_off"),
    "greedy": lambda world: Greedy(),
    "optimal": Optimal,
    "random": lambda world: Random(),
    "swinging": lambda world: Swinging(),
}
TO_THE_EGG = ("arrived", "time to egg", "median")  # headings; times are those of who arrived
NUMBERS = ("mean", "std", "min", "max", "ci95", "fraction_of_limit")


class Evaluation(NamedTuple):
    """What `evaluate` found."""

    summary: dict[str, Any]  # what summary.json holds
    results: xr.Dataset  # what population.nc holds
    table: Table  # a row per policy, in the order of their mean gains
    world: World
    label: str  # of the policy in results


def named_policy(name: str | os.PathLike, world: World) -> AnyPolicy:
    """A strategy by its name, or a trained policy: a run folder, a file, "zoo:NAME".

    Raises PolicyError where there is no such policy, suggesting the nearest name, or where it does not fit
    the world.
    """
    found = _found_policy(name, world)
    if isinstance(found, Network):
        found.check_fits(world)
    return found


def _found_policy(name: str | os.PathLike, world: World) -> AnyPolicy:
    if name in STRATEGIES:
        return STRATEGIES[name](world)
    if isinstance(name, str) and not name.startswith(ZOO) and not files.expanded(name).exists():
        near = difflib.get_close_matches(name, STRATEGIES, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise PolicyError(
            f"policy must be one of {', '.join(STRATEGIES)}, {ZOO}NAME, a policy file or a folder with a "
            f"{POLICY_FILE}, got {name!r}{hint}"
        )
    return load_policy(name)


def contender(
    policy: str | os.PathLike | AnyPolicy, world: World, name: str | None = None
) -> tuple[str, str, AnyPolicy]:
    """What a policy is called in summaries (`name`, else as it was named, or its type), its label in results
    (a network's algorithm, adaptive or adaptive_on_off, else its type), and the policy.
    """
    if isinstance(policy, str | os.PathLike):
        player, known = named_policy(policy, world), os.fspath(policy)
    else:
        player, known = policy, type(policy).__name__.lower()
    label = player.algorithm if isinstance(player, Network) else type(player).__name__.lower()
    if isinstance(player, AdaptiveSteering):
        label = "adaptive" if player.mode == "linear" else "adaptive_on_off"
    elif label in STRATEGIES and not isinstance(player, (Greedy, Optimal, Random, Swinging)):
        raise PolicyError(f"policy, or its algorithm, must not be called as a strategy, got {label!r}")
    return name or known, label, player


def evaluate(
    policy: str | os.PathLike | AnyPolicy,
    world: World,
    *,
    experiment: str,
    cells: int = 40,
    worlds: int = 1,
    life: float = 200.0,
    seed: int = 0,
    name: str | None = None,
    **recorded: Any,
) -> Evaluation:
    """Tests a policy, greedy and swinging on the same starts, `cells` of them in each of `worlds` worlds.

    `policy` is a name, a path or a policy itself; `name` is what the summary calls it. What is recorded
    (`record`), where (`out`), who computes it and `progress` are options of `population_test`. Raises
    PolicyError for a policy that cannot be had.
    """
    world = world.replace(life=life)
    known, label, player = contender(policy, world, name)
    policies = {label: player, RIVAL: Greedy(), "swinging": Swinging()}
    sizes: dict[str, Any] = {"cells": cells, "worlds": worlds}
    results = population_test(world, policies, life=life, seed=seed, **sizes, **recorded)
    numbers = statistics(results)
    if worlds == 1:
        del sizes["worlds"]
    about = {"policy": known, "experiment": experiment, **sizes}
    summary = about | _summary(results, numbers, label)
    told = table(results, numbers, cells=cells * worlds, egg=world.egg is not None)
    return Evaluation(summary, results, told, world, label)


def compete(
    policy: str,
    rival: str,
    world: World,
    *,
    share: float = 0.5,
    cells: int = 40,
    worlds: int = 40,
    life: float = 200.0,
    seed: int = 0,
    progress: Progress | None = None,
) -> xr.Dataset:
    """A [`contest`][swarm.population.contests.contest] of two policies by their names or paths, of which the
    first steers a `share` of the cells; where nobody races in the world, to the first arrival.

    Raises PolicyError for a policy that cannot be had, and as `contest` does.
    """
    world, players, shares = rivals(policy, rival, world.replace(life=life), share)
    return contest(world, players, shares, cells=cells, worlds=worlds, seed=seed, progress=progress)


def rivals(
    policy: str, rival: str, world: World, share: float
) -> tuple[World, dict[str, AnyPolicy], dict[str, float]]:
    """The world in which two policies race, the policies and their shares of the cells, as in `compete`."""
    if not 0 < check_number("share", share) < 1:
        raise ValueError(f"share must lie between 0 and 1, got {share:g}")
    if policy == rival:
        raise ValueError(f"a policy must compete against another, got {policy!r} twice")
    world = race_in(world)
    players = {name: _found_policy(name, world) for name in (policy, rival)}
    return world, players, {policy: share, rival: 1 - share}


def _summary(results: xr.Dataset, numbers: dict[str, dict[str, Any]], label: str) -> dict[str, Any]:
    """What summary.json holds of the policy called `label` in the results; None where there is no number."""
    summary = {
        "life": results.attrs["life"],
        "seed": int(results.attrs["seed"]),
        "limit": results.attrs.get("limit"),
        "gain": {key: numbers[label][key] for key in NUMBERS},
        "greedy": {key: numbers[RIVAL][key] for key in NUMBERS},
        "difference_to_greedy": numbers[label]["difference_to_greedy"],
        "wins": numbers[label]["wins"],
        **provenance.origin(),
    }
    if data := data_of(results):
        summary["data"] = data
    if any(row["arrived"] for row in numbers.values()):
        came = arrivals(results)
        for of_policy, name in ((summary, label), (summary["greedy"], RIVAL)):
            times = {key: came[name][key] for key in ("mean", "median") if came[name][key] == came[name][key]}
            of_policy |= {"arrived": came[name]["arrived"], "time_to_egg": times or None}
    if "block" in results.attrs:
        summary |= {name: int(results.attrs[name]) for name in ("block", "blocks")}
        summary["quantiles"] = numbers[label]["quantiles"]
    return summary


def table(results: xr.Dataset, numbers: dict[str, dict[str, Any]], *, cells: int, egg: bool = False) -> Table:
    """A row per policy, in the order of their mean gains: gain ± standard deviation of the cells of all
    worlds, interval of the mean; where there is an `egg`, how many cells arrived, and the mean and median
    time they took.
    """
    bounded = any(row["fraction_of_limit"] is not None for row in numbers.values())
    headings = ["policy", "gain", "95% interval", "min", "max", "over greedy", "wins"]
    headings += [*(("of the limit",) if bounded else ()), *(TO_THE_EGG if egg else ())]
    came = arrivals(results) if egg else {}
    rows: list[list[str | None]] = []
    for name in sorted(numbers, key=lambda each: -numbers[each]["mean"]):
        row, rival = numbers[name], name == RIVAL
        rows.append(
            [
                name,
                f"{row['mean']:.2f} ± {row['std']:.2f}",
                span(row["ci95"]),
                f"{row['min']:.2f}",
                f"{row['max']:.2f}",
                None if rival else f"{row['difference_to_greedy']['mean']:+.2f}",
                None if rival else f"{row['wins']}/{cells}",
                *((percent(row["fraction_of_limit"]),) if bounded else ()),
                *(to_the_egg(list(came[name].values()), cells) if egg else ()),
            ]
        )
    return Table(headings, rows)


def to_the_egg(came: Sequence[float], cells: int) -> list[str | None]:
    """The cells of `TO_THE_EGG`: how many of so many arrived, mean and median time; NaN where none did."""
    arrived, *times = came
    return [f"{arrived:.0f}/{cells}", *(None if time != time else f"{time:.1f}" for time in times)]
