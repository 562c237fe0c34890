"""Networks of several independent seeds at once: TorchRL's MLP, whose layers hold a weight for every seed."""

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torchrl.modules import MLP

from swarm.policies.network import Network


class SeedLinear(nn.Module):
    """`nn.Linear` for each of a leading axis of seeds: (seeds, rows, inputs) -> (seeds, rows, outputs).

    It computes what `torch.vmap` makes of `nn.Linear` over stacked parameters (a test holds it); vmap itself
    takes an update of one seed twice as long.
    """

    def __init__(
        self, inputs: int, outputs: int, bias: bool = True, device: Any = None, *, seeds: int = 1
    ) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(seeds, inputs, outputs, device=device))
        self.bias = nn.Parameter(torch.zeros(seeds, 1, outputs, device=device))

    def forward(self, rows: Tensor) -> Tensor:
        return torch.baddbmm(self.bias, rows, self.weight)


def seed_mlp(sizes: Sequence[int], keys: Sequence[int], device: Any = None) -> MLP:
    """Tanh layers and a linear output of `sizes`, from input to output, a fresh network for each random key.

    Weights are uniform within ±√(6/(inputs + outputs)) (Glorot and Bengio 2010), biases 0, the same alone and
    in a stack.
    """
    layer = functools.partial(SeedLinear, seeds=len(keys))
    inputs, *hidden, outputs = sizes
    mlp = MLP(inputs, outputs, num_cells=hidden, activation_class=nn.Tanh, layer_class=layer, device=device)
    layers = [module for module in mlp if isinstance(module, SeedLinear)]
    with torch.no_grad():
        for place, key in enumerate(keys):
            generator = torch.Generator().manual_seed(key)
            for linear, ends in zip(layers, itertools.pairwise(sizes), strict=True):
                uniform = 2 * torch.rand(*ends, generator=generator) - 1
                linear.weight[place] = uniform * math.sqrt(6 / sum(ends))
    return mlp


def memory_of(sizes: Sequence[int], rows: int) -> int:
    """Bytes of a network of one seed, with copies, moments and gradient, and of a batch's way through it."""
    parameters = sum(inputs * outputs + outputs for inputs, outputs in itertools.pairwise(sizes))
    return 4 * (7 * parameters + 3 * sum(sizes) * rows)


def best(outputs: Tensor, action_range: tuple[float, float] | None) -> Tensor:
    """The action (...) that outputs (..., m) prefer: the one of the largest, or where actions are curvatures,
    the curvature that the first output o tells: tanh o between the range's middle and its ends.
    """
    if action_range is None:
        return outputs.argmax(-1)
    return curvature_at(outputs[..., 0], *action_range)


def curvature_at(latent: Tensor, low: float, high: float) -> Tensor:
    """Curvatures (...) of a range from real numbers (...) [1 / length]."""
    return 0.5 * (low + high) + 0.5 * (high - low) * latent.tanh()


def exported(parameters: Mapping[str, Tensor], place: int, card: dict[str, Any]) -> Network:
    """The network of one of the seeds in an MLP's `state_dict`, as a policy that runs in NumPy."""
    arrays = {name: values[place].detach().cpu().numpy() for name, values in parameters.items()}
    weights = tuple(array.T.copy() for name, array in arrays.items() if name.endswith("weight"))
    biases = [array[0] for name, array in arrays.items() if name.endswith("bias")]
    if card.get("curvature_range") is not None:  # what is left to chance in training is not
        weights, biases = (*weights[:-1], weights[-1][:1]), [*biases[:-1], biases[-1][:1]]
    return Network(weights, biases, card)
