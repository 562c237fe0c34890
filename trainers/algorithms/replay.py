"""Replay: TorchRL's buffer for transitions of several seeds, each of which draws its own.

Transitions go by TorchRL's keys, but lie in the buffer as rows of numbers: TorchRL takes a TensorDict apart
entry by entry, while a single tensor goes in and out by one operation.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import torch
from torch import Tensor
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.data.replay_buffers.samplers import RandomSampler

Key = str | tuple[str, str]

OBSERVATIONS: tuple[Key, ...] = ("observation", ("next", "observation"))  # (..., inputs)
NUMBERS: tuple[Key, ...] = (("next", "reward"), "steps_to_next_obs")  # (..., 1)
FLAGS: tuple[Key, ...] = (("next", "terminated"),)  # (..., 1) bool
BARE: dict[Key, torch.dtype] = {"action": torch.int64, ("collector", "mask"): torch.bool}  # (...)
COLUMNS: tuple[Key, ...] = (*OBSERVATIONS, *NUMBERS, *FLAGS, *BARE)
OTHERS = len(COLUMNS) - len(OBSERVATIONS)


def width(inputs: int) -> int:
    """Numbers in a row."""
    return 2 * inputs + OTHERS


def packed(transitions: Mapping[Any, Tensor]) -> Tensor:
    """Rows (..., width) of float32, which holds every action exactly, of transitions (...)."""
    columns = [transitions[key] for key in (*OBSERVATIONS, *NUMBERS, *FLAGS)]
    return torch.cat([*columns, *(transitions[key].unsqueeze(-1) for key in BARE)], dim=-1)


def unpacked(rows: Tensor) -> dict[Key, Tensor]:
    """The transitions (...) that were packed in rows (..., width)."""
    inputs = (rows.shape[-1] - OTHERS) // 2
    columns = rows.split((inputs, inputs, *(1,) * OTHERS), dim=-1)
    found = dict(zip(COLUMNS, columns, strict=True))
    found |= {key: found[key].bool() for key in FLAGS}
    return found | {key: found[key].squeeze(-1).to(dtype) for key, dtype in BARE.items()}


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


class SeedReplay:
    """Keeps the newest `size` transitions of every seed, or whatever else is packed in rows."""

    def __init__(self, size: int, inputs: int, generators: list[torch.Generator]) -> None:
        self.size, self.inputs, device = size, inputs, generators[0].device
        storage = LazyTensorStorage(size, device=device)
        self.buffer = ReplayBuffer(storage=storage, sampler=SeedSampler(generators))
        self.buffer.extend(torch.zeros(1, len(generators), self.width, device=device))
        self.buffer.empty()  # which leaves the storage as large as it gets

    @property
    def width(self) -> int:
        """Numbers in a row."""
        return width(self.inputs)

    def pack(self, transitions: Mapping[Any, Tensor]) -> Tensor:
        """Rows (decisions, seeds, cells, width) of the newest transitions (decisions, seeds, cells), no more
        decisions of them than there is room for.
        """
        decisions = -(-self.size // transitions["action"].shape[2])
        return packed({key: part[-decisions:] for key, part in transitions.items()})

    def unpack(self, rows: Tensor) -> dict[Any, Tensor]:
        """The transitions (...) that were packed in rows (..., width)."""
        return unpacked(rows)

    def extend(self, transitions: Mapping[Any, Tensor]) -> None:
        """Add transitions (decisions, seeds, cells)."""
        rows = self.pack(transitions).transpose(1, 2).flatten(0, 1)
        self.buffer.extend(rows[-self.size :])  # two rows for one place would race

    def batches(self, count: int, size: int) -> Iterator[dict[Any, Tensor]]:
        """Batches (seeds, rows) of `size` rows, all drawn at once."""
        drawn = self.unpack(self.buffer.sample(count * size))
        columns = (column.contiguous().split(size, dim=1) for column in drawn.values())
        for parts in zip(*columns, strict=True):
            yield dict(zip(drawn, parts, strict=True))

    @property
    def rows(self) -> Tensor:
        """All there is (rows, seeds, width), not copied."""
        return self.buffer[:]

    @property
    def cursor(self) -> int:
        """The place that the next transition goes to."""
        return self.buffer.writer.state_dict()["_cursor"]

    def refill(self, rows: Tensor, cursor: int, n_actions: int) -> None:
        """Put back what `rows` gave; raises ValueError where it cannot be from here."""
        action = self.unpack(rows)["action"]
        if not len(rows) or action.min() < 0 or action.max() >= n_actions or cursor > self.size:
            raise ValueError(
                f"buffer must have rows with actions from 0 to {n_actions - 1}, and its cursor be at most "
                f"{self.size}, got {len(rows)} rows and {cursor}"
            )
        self.buffer.empty()
        self.buffer.extend(rows.to(self.buffer.storage.device))
        self.buffer.writer.load_state_dict({"_cursor": cursor})
