"""Transitions: what a learner sees of a decision, and the rows of numbers that a replay buffer keeps.

TorchRL's buffers take a TensorDict apart entry by entry; a single tensor goes in and out by one operation.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

OTHERS = 4  # numbers of a row beside the two observations


class Transitions(NamedTuple):
    """Decisions of any leading axes (...), and what they led to."""

    observation: Tensor  # (..., inputs)
    next_observation: Tensor  # (..., inputs)
    action: Tensor  # (...) int64
    reward: Tensor  # (...) sum over the decisions in between
    bootstrap: Tensor  # (...) by which the next value counts: γᵏ after k decisions, 0 after a termination
    valid: Tensor  # (...) 1, or 0 where the cell's life had ended before

    def packed(self) -> Tensor:
        """Rows (..., width) in float32, which holds every action exactly."""
        numbers = (self.action, self.reward, self.bootstrap, self.valid)
        others = torch.stack([number.to(torch.float32) for number in numbers], dim=-1)
        return torch.cat([self.observation, self.next_observation, others], dim=-1)

    @classmethod
    def unpacked(cls, rows: Tensor) -> Transitions:
        """The transitions of packed rows (..., width), as views but for the actions."""
        inputs = (rows.shape[-1] - OTHERS) // 2
        observation, following, others = rows.split((inputs, inputs, OTHERS), dim=-1)
        action, reward, bootstrap, valid = others.unbind(-1)
        return cls(observation, following, action.long(), reward, bootstrap, valid)

    def batches(self, size: int) -> list[Transitions]:
        """These of (seeds, rows) in batches of `size` rows."""
        parts = zip(*(values.split(size, dim=1) for values in self), strict=True)
        return [Transitions(*part) for part in parts]
