"""Replay: TorchRL's buffer for what several seeds keep, each of which draws its own.

Entries go by TorchRL's keys, but lie in the buffer as rows of numbers: TorchRL takes a TensorDict apart
entry by entry, while a single tensor goes in and out by one operation.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor
from torchrl.data import LazyTensorStorage, ReplayBuffer

Key = str | tuple[str, str]
Layout = Mapping[Key, tuple[tuple[int, ...], torch.dtype]]  # shape and type of each entry of a row
REACHED = ("reward", "observation", "terminated")  # what follows a decision


def transitions(inputs: int) -> Layout:
    """What is kept of one decision of a cell: what DQNLoss reads, and whether the cell was alive."""
    seen, number, flag = ((inputs,), torch.float32), ((1,), torch.float32), ((1,), torch.bool)
    return {
        "observation": seen,
        ("next", "observation"): seen,
        ("next", "reward"): number,
        "steps_to_next_obs": number,
        ("next", "terminated"): flag,
        "action": ((), torch.int64),
        ("collector", "mask"): ((), torch.bool),
    }


def returns(rollout: Mapping[Any, Tensor], gamma: float, n_steps: int) -> dict[Key, Tensor]:
    """Transitions (decisions, ...) whose rewards are sums over up to `n_steps` decisions of the same life.

    What TorchRL's MultiStep writes: Σ γᵏ r, the observation that follows, and the steps to it (Sutton
    and Barto 2018, eq. 7.1). A termination on the way counts, which MultiStep leaves to its user.
    """
    reward, seen, ended = (rollout["next", name] for name in REACHED)
    total, reached, terminated = reward.clone(), seen.clone(), ended.clone()
    alive, steps = rollout["collector", "mask"].unsqueeze(-1), torch.ones_like(reward)
    for ahead in range(1, min(n_steps, len(reward))):
        goes_on = alive[ahead:]
        total[:-ahead] += torch.where(goes_on, gamma**ahead * reward[ahead:], 0.0)
        reached[:-ahead] = torch.where(goes_on, seen[ahead:], reached[:-ahead])
        terminated[:-ahead] |= goes_on & ended[ahead:]
        steps[:-ahead] += goes_on
    further = {("next", name): part for name, part in zip(REACHED, (total, reached, terminated), strict=True)}
    return {**rollout, **further, "steps_to_next_obs": steps}


def width(layout: Layout) -> int:
    """Numbers in a row."""
    return sum(math.prod(shape) for shape, _ in layout.values())


def packed(entries: Mapping[Any, Tensor], layout: Layout) -> Tensor:
    """Rows (..., width) of float32, which holds every action exactly, of entries (..., their own shapes)."""
    lead = entries["action"].shape[: entries["action"].ndim - len(layout["action"][0])]
    return torch.cat([entries[key].reshape(*lead, -1) for key in layout], dim=-1)


def unpacked(rows: Tensor, layout: Layout) -> dict[Any, Tensor]:
    """The entries (..., their own shapes) that were packed in rows (..., width)."""
    columns = rows.split([math.prod(shape) for shape, _ in layout.values()], dim=-1)
    return {
        key: column.reshape(*rows.shape[:-1], *shape).to(dtype)
        for column, (key, (shape, dtype)) in zip(columns, layout.items(), strict=True)
    }


class SeedReplay:
    """Keeps the newest `size` entries of every seed; of all seeds, those of one moment lie side by side."""

    def __init__(self, size: int, layout: Layout, seeds: int, device: torch.device | None = None) -> None:
        self.size, self.layout, self.seeds = size, layout, seeds
        self.buffer = ReplayBuffer(storage=LazyTensorStorage(size * seeds, device=device or "cpu"))
        self.buffer.extend(torch.zeros(1, width(layout), device=device))
        self.buffer.empty()  # which leaves the storage as large as it gets

    def extend(self, entries: Mapping[Any, Tensor], decisions: int) -> None:
        """Add the first so many decisions of entries (decisions, seeds, cells, ...)."""
        rows = packed(entries, self.layout)[:decisions].transpose(1, 2).flatten(0, 1)
        self.buffer.extend(rows[-self.size :].flatten(0, 1))  # two rows for one place would race

    def batches(
        self, count: int, size: int, generators: Sequence[torch.Generator]
    ) -> Iterator[dict[Any, Tensor]]:
        """Batches (seeds, rows) of `size` rows, uniformly with replacement, for every seed by its own
        generator; all are drawn at once, which takes a third of the time of the buffer's own `sample`.
        """
        kept, seeds = self.buffer[:], self.seeds
        drawn = [
            torch.randint(len(kept) // seeds, (count * size,), generator=each, device=kept.device) * seeds
            + seed
            for seed, each in enumerate(generators)
        ]
        rows = kept.index_select(0, torch.cat(drawn)).unflatten(0, (seeds, count, size)).transpose(0, 1)
        columns = [column.contiguous().unbind() for column in unpacked(rows, self.layout).values()]
        for parts in zip(*columns, strict=True):
            yield dict(zip(self.layout, parts, strict=True))

    @property
    def rows(self) -> Tensor:
        """All there is (rows, seeds, width), not copied."""
        return self.buffer[:].unflatten(0, (-1, self.seeds))

    @property
    def cursor(self) -> int:
        """The place that the next entry goes to."""
        return self.buffer.writer.state_dict()["_cursor"] // self.seeds

    def refill(self, rows: Tensor, cursor: int, n_actions: int) -> None:
        """Put back what `rows` gave; raises ValueError where it cannot be from here."""
        action = unpacked(rows, self.layout)["action"]
        if not len(rows) or action.min() < 0 or action.max() >= n_actions or cursor > self.size:
            raise ValueError(
                f"buffer must have rows with actions from 0 to {n_actions - 1}, and its cursor be at most "
                f"{self.size}, got {len(rows)} rows and {cursor}"
            )
        self.buffer.empty()
        self.buffer.extend(rows.flatten(0, 1).to(self.buffer.storage.device))
        self.buffer.writer.load_state_dict({"_cursor": cursor * self.seeds})
