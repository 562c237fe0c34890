"""Watching a policy: a window, a film, or a page to play with."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm._support import files
from swarm.figures.film import FORMS, check_film, write_film
from swarm.figures.page import save_page
from swarm.figures.scene import Teams
from swarm.figures.viewer import Viewer
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.policy import AnyPolicy
from swarm.population.blocks.block import lives
from swarm.population.contest import population_test
from swarm.population.contests import crowd_of
from swarm.population.evaluation import contender, rivals
from swarm.population.results import as_dataset, load_population, origin
from swarm.population.rollout import Moment, rollout

if TYPE_CHECKING:
    import xarray as xr

PAGE = ".html"
WINDOW_FPS = 24  # pictures per second in a window
POPULATION = ".nc"


def check_target(out: Path | None, size: int | None = None) -> None:
    """Raises ValueError or an OSError unless a film or a page can be written there, in this size."""
    suffix = _suffix(out)
    if size is not None and suffix not in FORMS:
        raise ValueError(f"size must come with a film, --out FILE with {', '.join(FORMS)}, got {size}")
    if out is None:
        return
    if suffix not in (*FORMS, PAGE):
        raise ValueError(f"out must end in {', '.join((*FORMS, PAGE))}, got {out}")
    if suffix in FORMS:
        check_film(suffix, size)
    out = files.expanded(out)
    if out.exists():
        raise FileExistsError(f"{out} must be a new file: what is there is never overwritten")
    if not out.parent.is_dir():
        raise FileNotFoundError(f"the folder of {out} must be there")


def _suffix(out: Path | None) -> str:
    return "" if out is None else out.suffix.lower()


def watch(
    policy: str,
    world: World,
    *,
    against: str | None = None,
    share: float | None = None,
    cells: int = 40,
    seed: int = 0,
    out: Path | None = None,
    size: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> None:
    """Show a policy in a window, or write a film (.mp4, .gif) or a page (.html), whole or not at all.

    `against` another the policy steers a `share` of the cells, by default half, in a race to the egg as in
    `swarm.population.evaluation.compete`. `size` is the height of a film in pixels. `progress` is called with
    what is done and the most there can be, of a film in decisions. Raises PolicyError for a policy that
    cannot be had, ValueError for a `share` without a rival, OSError where there is no display for a window.
    """
    check_target(out, size)
    if share is not None and against is None:
        raise ValueError(f"share must come with against, a policy to race with, got {share:g} alone")
    teams = None
    if against is None:
        _, title, player = contender(policy, world)
    else:
        world, players, shares = rivals(policy, against, world, 0.5 if share is None else share)
        world, player = crowd_of(world, players, shares, cells=cells)
        title, teams = f"{policy} against {against}", Teams(player.names, player.steered_by)
    suffix = _suffix(out)
    if out is not None and suffix == PAGE:
        lived = _lived(world, title, player, cells, seed, teams, progress)
        save_page(lived, out, title=title if teams else policy, teams=teams, world=world)
        return
    moments = rollout(world, player, draw_starts(world, cells, seed), seed)
    with closing(Viewer(world, window=out is None, fps=WINDOW_FPS, teams=teams)) as viewer:
        followed = _followed(viewer, moments, FORMS[suffix].frames if out else 1, progress)
        if out is not None:
            with files.replacing(out) as temporary:
                write_film(temporary, suffix, followed, check_film(suffix, size))
        elif viewer.window is None or not viewer.window.visible:
            raise OSError("a window needs a display, and there is none: --out FILE makes a film or a page")
        else:
            deque(followed, maxlen=0)


def _lived(
    world: World,
    label: str,
    player: AnyPolicy,
    cells: int,
    seed: int,
    teams: Teams | None,
    progress: Callable[[float, float], None] | None,
) -> xr.Dataset:
    """The lives that a page shows: of a policy beside greedy, or of several in one world."""
    tell: dict[str, Any] = {} if progress is None else {"progress": lambda part: progress(part, 1.0)}
    if teams is None:
        sizes: dict[str, Any] = {"cells": cells, "life": world.life, "seed": seed}
        quick = not world.in_flow  # the limit in a flow takes a minute or more
        return population_test(world, {label: player}, **sizes, limit=quick, **tell)
    starts = draw_starts(world, cells, seed)
    lived = lives(world, player, starts, seed, name=label, population="test", record=True, **tell)
    return as_dataset(starts, {label: lived}, origin(world, seed))


def save_page_of(population: Path, out: Path | None, *, cells: int | None = None) -> None:
    """Write the page of a population test that was stored, whole or not at all.

    Raises ResultsError for a file that holds none, ValueError for an `out` that is no page.
    """
    if out is None or _suffix(out) != PAGE:
        raise ValueError(f"a stored population is watched on a page: out must end in {PAGE}, got {out}")
    check_target(out)
    save_page(load_population(population), out, title="/".join(population.parts[-2:]), cells=cells)


def _followed(
    viewer: Viewer, lived: Iterable[Moment], frames: int, progress: Callable[[float, float], None] | None
) -> Iterator[np.ndarray]:
    """Pictures of the lives, `frames` for each decision; none where a window shows them."""
    for done, moment in enumerate(lived):
        viewer.follow(moment.state)
        if viewer.window is None:
            yield from (viewer.picture((i + 1) / frames) for i in range(frames if done else 1))
        if progress is not None:
            progress(done, viewer.world.max_decisions)
