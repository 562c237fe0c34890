"""What a TorchRL environment says of its tensors: shapes, types and bounds, group by group."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torchrl.data import Binary, Bounded, Categorical, Composite, Unbounded

from swarm.envs.spaces import state_bounds
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
        observation["state"] = Unbounded(shape=(*shape, len(state_bounds(world)[0])), **numbers)
    if world.action_range is None:
        action: Any = Categorical(world.n_actions, shape=shape, dtype=torch.int64, device=device)
    else:
        action = Bounded(*world.action_range, shape=(*shape, 1), **numbers)
    ends = {name: Binary(shape=(shape[0], 1), **flag) for name in ENDS}
    reward = grouped(reward=Unbounded(shape=(*shape, 1), **numbers))
    return Specs(observation, grouped(action=action), reward, Composite(ends, shape=shape[:1]))


def checked(world: World, action: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """The actions (worlds, cells), which as curvatures may be (worlds, cells, 1); raises TypeError or
    ValueError unless all are of the world.
    """
    low, high = world.action_range or (0, world.n_actions - 1)
    kind = "curvatures" if world.is_continuous else "whole numbers"
    rule = f"actions must be {kind} from {low:g} to {high:g} of shape {shape}"
    if action.is_floating_point() != world.is_continuous or action.dtype == torch.bool:
        raise TypeError(f"{rule}, got {action.dtype}")
    if world.is_continuous and tuple(action.shape) == (*shape, 1):
        action = action.squeeze(-1)
    if tuple(action.shape) != shape:
        raise ValueError(f"{rule}, got the shape {tuple(action.shape)}")
    ends = torch.stack(action.aminmax())
    if not (right := world.is_action(ends)).all():
        raise ValueError(f"{rule}, got {ends[~right][0].item():g}")
    return action
