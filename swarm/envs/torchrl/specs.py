"""What a TorchRL environment says of its tensors: shapes, types and bounds, group by group."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torchrl.data import Binary, Bounded, Categorical, Composite, Unbounded

from swarm.physics.world import World

ENDS = ("done", "terminated", "truncated")


class Specs(NamedTuple):
    """Of what is observed, done and paid, and of what ends, of the cells and of whole worlds."""

    observation: Composite
    action: Composite
    reward: Composite
    done: Composite


def specs_of(
    world: World, shape: tuple[int, int], group: str, device: torch.device, with_state: bool
) -> Specs:
    """The specs of (worlds, cells) cells under the name of their group.

    Whole worlds end, so that there is one key by which they are reset; the ends of cells are observed.
    """
    numbers: dict[str, Any] = {"dtype": torch.float32, "device": device}
    flag: dict[str, Any] = {"dtype": torch.bool, "device": device, "n": 1}
    bound = torch.as_tensor(world.observation_bounds, device=device).expand(*shape, -1)

    def grouped(**specs: Any) -> Composite:
        return Composite({group: Composite(specs, shape=shape)}, shape=shape[:1])

    told = ["gain"] + ["eaten"] * (world.medium is not None)
    told += ["arrival_time"] * (world.first_arrivals is not None)
    observation = grouped(
        observation=Bounded(-bound, bound, shape=bound.shape, **numbers),
        **{name: Unbounded(shape=(*shape, 1), **numbers) for name in told},
        **{name: Binary(shape=(*shape, 1), **flag) for name in ENDS},
        **({} if world.first_arrivals is None else {"won": Binary(shape=(*shape, 1), **flag)}),
    )
    if with_state:
        observation["state"] = Unbounded(shape=(*shape, 4), **numbers)
    action = Categorical(world.n_actions, shape=shape, dtype=torch.int64, device=device)
    ends = {name: Binary(shape=(shape[0], 1), **flag) for name in ENDS}
    reward = grouped(reward=Unbounded(shape=(*shape, 1), **numbers))
    return Specs(observation, grouped(action=action), reward, Composite(ends, shape=shape[:1]))


def check_actions(action: torch.Tensor, known: int, shape: tuple[int, int]) -> None:
    """Raises TypeError or ValueError unless all actions are whole numbers below `known`, (worlds, cells)."""
    rule = f"actions must be whole numbers from 0 to {known - 1} of shape {shape}"
    if action.is_floating_point() or action.dtype == torch.bool:
        raise TypeError(f"{rule}, got {action.dtype}")
    if tuple(action.shape) != shape:
        raise ValueError(f"{rule}, got the shape {tuple(action.shape)}")
    low, high = (int(number) for number in action.aminmax())
    if low < 0 or high >= known:
        raise ValueError(f"{rule}, got {low if low < 0 else high}")
