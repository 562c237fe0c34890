"""Replay: TorchRL's buffer for rows that every seed has one of, each seed drawing its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.data.replay_buffers.samplers import RandomSampler


class SeedSampler(RandomSampler):
    """Draws from a storage (rows, seeds), uniformly with replacement, for every seed by its own generator."""

    def __init__(self, generators: list[torch.Generator]) -> None:
        self.generators = generators
        self.seeds = torch.arange(len(generators), device=generators[0].device)[:, None]

    def sample(self, storage: Any, batch_size: int) -> tuple[tuple[Tensor, Tensor], dict]:
        length, device = len(storage), self.seeds.device
        drawn = [
            torch.randint(length, (batch_size,), generator=each, device=device) for each in self.generators
        ]
        return (torch.stack(drawn), self.seeds), {}


class SeedReplay(ReplayBuffer):
    """Keeps the newest `size` rows (rows, seeds) in TorchRL's keys; samples are (seeds, rows)."""

    def __init__(self, size: int, batch_size: int, inputs: int, generators: list[torch.Generator]) -> None:
        device, self.size = generators[0].device, size
        storage = LazyTensorStorage(size, device=device)
        super().__init__(storage=storage, sampler=SeedSampler(generators), batch_size=batch_size)
        self.extend(_blank(inputs, len(generators)).to(device))
        self.empty()  # which leaves the storage as large as it gets

    @property
    def cursor(self) -> int:
        """The place that the next row goes to."""
        return self.writer.state_dict()["_cursor"]

    def tensors(self) -> dict[str, Tensor]:
        """All rows (rows, seeds, ...) by dotted key, none of them copied."""
        return dict(self[:].flatten_keys().items())

    def refill(self, columns: Mapping[str, Tensor], cursor: int, n_actions: int) -> None:
        """Put back what `tensors` gave; raises ValueError for what cannot come from such a buffer."""
        action, rows = columns["action"], {len(column) for column in columns.values()}
        if len(rows) > 1 or action.min() < 0 or action.max() >= n_actions or cursor > self.size:
            raise ValueError(
                f"buffer must hold whole rows with actions from 0 to {n_actions - 1}, and its cursor be at "
                f"most {self.size}, got actions from {action.min()} to {action.max()}, and {cursor}"
            )
        self.empty()
        self.extend(TensorDict(dict(columns), action.shape).unflatten_keys().to(self.storage.device))
        self.writer.load_state_dict({"_cursor": cursor})


def _blank(inputs: int, seeds: int) -> TensorDict:
    """One row (1, seeds)."""
    seen, number = torch.zeros(1, seeds, inputs), torch.zeros(1, seeds, 1)
    following = {"observation": seen, "reward": number, "terminated": number.bool()}
    row = {"observation": seen, "action": number.squeeze(-1).long(), "steps_to_next_obs": number}
    nested = {"collector": {"mask": number.squeeze(-1).bool()}, "next": following}
    return TensorDict(row | nested, (1, seeds))
