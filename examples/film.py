"""A film of two policies on the same lives, side by side: the moving picture of the documentation.

python examples/film.py
"""

import sys
from collections.abc import Iterator

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import swarm
from swarm.figures.viewer import Viewer
from swarm.physics.starts import draw_starts
from swarm.policies.policy import Policy
from swarm.population.rollout import rollout

SCALE = 0.5  # of the pictures' 960 × 720 pixels
COLOURS = 96  # few, so that the file stays small


def pictures(world: swarm.World, policy: Policy, cells: int, seed: int) -> Iterator[np.ndarray]:
    """A picture (height, width, 3) after every decision of the cells' lives."""
    viewer = Viewer(world)
    for moment in rollout(world, policy, draw_starts(world, cells, seed), seed):
        viewer.follow(moment.state)
        if moment.outcome is not None:
            yield viewer.picture()


def labelled(picture: np.ndarray, name: str) -> Image.Image:
    """The picture with a name in its corner, reduced."""
    image = Image.fromarray(picture)
    ImageDraw.Draw(image).text((20, 14), name, "white", ImageFont.load_default(30))
    return image.resize((round(image.width * SCALE), round(image.height * SCALE)), Image.Resampling.LANCZOS)


def main(
    path: str = "swarm.gif", cells: int = 12, life: float = 40.0, seed: int = 1, **policies: Policy
) -> None:
    """Writes the film of the `policies`, by default greedy and the network that learnt."""
    world = swarm.World(life=life)
    policies = policies or {"greedy": swarm.Greedy(), "learnt": swarm.load_policy("zoo:linear_n4")}
    films = [pictures(world, policy, cells, seed) for policy in policies.values()]
    frames = []
    for views in zip(*films, strict=True):
        sides = [labelled(view, name) for view, name in zip(views, policies, strict=True)]
        frames.append(Image.fromarray(np.concatenate([np.asarray(side) for side in sides], axis=1)))
    palette = frames[len(frames) // 2].quantize(COLOURS, Image.Quantize.FASTOCTREE)
    film = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    film[0].save(path, save_all=True, append_images=film[1:], duration=80, loop=0)
    print(f"{len(film)} pictures in {path}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
