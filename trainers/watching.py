"""Watching a policy: a window, a film, or a page to play with."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from swarm import files
from swarm.evaluation import LEARNT, STRATEGIES, named_policy
from swarm.population import population_test
from swarm.render import Viewer
from swarm.starts import NOISE_BLOCK, draw_noise, draw_starts
from swarm.streams import generator
from swarm.world import State, World

FILMS = (".mp4", ".gif", ".webm")
PAGE = ".html"
FPS = 24  # pictures per second of a film
FRAMES = 2  # pictures of a decision


def check_target(out: Path | None) -> None:
    """Raises ValueError or FileExistsError unless a film or a page can be written there."""
    if out is None:
        return
    if out.suffix.lower() not in (*FILMS, PAGE):
        raise ValueError(f"out must end in {', '.join((*FILMS, PAGE))}, got {out}")
    if out.exists():
        raise FileExistsError(f"{out} must be a new file: what is there is never overwritten")
    if not out.resolve().parent.is_dir():
        raise FileNotFoundError(f"the folder of {out} must be there")


def states(world: World, policy: Any, cells: int, seed: int) -> Iterator[State]:
    """One population's life, decision by decision, with the random numbers of `population_test`."""
    state = world.start(*draw_starts(world, cells, seed))
    yield state
    for decision in range(world.max_decisions):
        block, place = divmod(decision, NOISE_BLOCK)
        if place == 0:
            uniform = generator("test", "policy", seed, 0, block).random((cells, NOISE_BLOCK))
            noise = draw_noise(seed, cells, NOISE_BLOCK, block=block) if world.has_noise else None
        action = policy.act(world, state, uniform[:, place])
        state, _ = world.step(state, action, None if noise is None else noise[:, place])
        yield state
        if state.finished.all():
            return


def watch(
    policy: str,
    world: World,
    *,
    cells: int = 40,
    seed: int = 0,
    out: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Show a policy in a window, or write a film (.mp4, .gif, .webm) or a page (.html), whole or not at all.

    `progress` is called with the decisions that are done and the most there can be. Raises PolicyError for
    a policy that cannot be had.
    """
    check_target(out)
    player = named_policy(policy, world)
    if out is not None and out.suffix.lower() == PAGE:
        from swarm.page import save_page

        label = policy if policy in STRATEGIES else LEARNT
        save_page(
            population_test(world, {label: player}, cells=cells, life=world.life, seed=seed),
            out,
            title=policy,
        )
        return
    viewer = Viewer(world, window=out is None, fps=FPS)
    try:
        if out is None:
            for _ in _followed(viewer, world, player, cells, seed, progress):
                pass
        else:
            with files.replacing(out) as temporary:
                _film(temporary, out.suffix.lower(), _followed(viewer, world, player, cells, seed, progress))
    finally:
        viewer.close()


def _followed(
    viewer: Viewer,
    world: World,
    policy: Any,
    cells: int,
    seed: int,
    progress: Callable[[int, int], None] | None,
) -> Iterator[np.ndarray]:
    """Pictures of the life."""
    for done, state in enumerate(states(world, policy, cells, seed)):
        viewer.follow(state)
        if viewer.window is None:
            yield from (viewer.picture((i + 1) / FRAMES) for i in range(FRAMES if done else 1))
        if progress is not None:
            progress(done, world.max_decisions)


def _film(path: Path, suffix: str, pictures: Iterator[np.ndarray]) -> None:
    """Encode pictures by imageio, which tells kinds of film by their endings."""
    import imageio.v2 as imageio

    options: dict[str, Any] = {"fps": FPS, "macro_block_size": 2}
    if suffix == ".gif":
        options = {"duration": 1000 / FPS, "loop": 0}
    named = path.with_name(path.name + suffix)
    try:
        with imageio.get_writer(named, **options) as writer:
            for picture in pictures:
                writer.append_data(picture)  # type: ignore[attr-defined]
        named.replace(path)
    finally:
        named.unlink(missing_ok=True)
