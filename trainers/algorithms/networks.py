"""Networks of several independent seeds at once, whose layers hold a weight for every seed: TorchRL's MLP,
and a recurrent one.
"""

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torchrl.modules import MLP

from swarm.policies.network import Network, RecurrentNetwork


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


class SeedGRU(nn.Module):
    """`nn.GRU` (Cho et al. 2014) for each of a leading axis of seeds: inputs (seeds, steps, rows, inputs) and
    the hidden state before them (seeds, rows, nodes) -> those after each (seeds, steps, rows, nodes).

    It computes what TorchRL's `GRUModule` does (a test holds it), which takes seeds one after the other.
    """

    weight_ih: Tensor  # (seeds, inputs, 3 · nodes)
    weight_hh: Tensor  # (seeds, nodes, 3 · nodes)
    bias_ih: Tensor  # (seeds, 1, 3 · nodes), as bias_hh
    bias_hh: Tensor

    def __init__(self, inputs: int, nodes: int, device: Any = None, *, seeds: int = 1) -> None:
        super().__init__()
        for name, rows in (("ih", inputs), ("hh", nodes)):
            weight, bias = (torch.zeros(seeds, size, 3 * nodes, device=device) for size in (rows, 1))
            self.register_parameter(f"weight_{name}", nn.Parameter(weight))
            self.register_parameter(f"bias_{name}", nn.Parameter(bias))

    def forward(self, inputs: Tensor, hidden: Tensor) -> Tensor:
        flat = torch.baddbmm(self.bias_ih, inputs.flatten(1, 2), self.weight_ih)
        states = []
        for given in flat.unflatten(1, inputs.shape[1:3]).unbind(1):
            held = torch.baddbmm(self.bias_hh, hidden, self.weight_hh)
            (reset, update, new), (of_reset, of_update, of_new) = given.chunk(3, -1), held.chunk(3, -1)
            new = torch.tanh(torch.addcmul(new, torch.sigmoid(reset + of_reset), of_new))
            hidden = torch.lerp(new, hidden, torch.sigmoid(update + of_update))
            states.append(hidden)
        return torch.stack(states, dim=1)


class RecurrentMLP(nn.Module):
    """A GRU that is shown the newest records of observations, and an MLP that values actions by its state.

    Inputs (seeds, steps, rows, inputs) and hidden state (seeds, rows, nodes) -> values (seeds, steps, rows,
    actions) and the hidden state after the last step.
    """

    def __init__(
        self, sizes: Sequence[int], features: int, keys: Sequence[Sequence[int]], device: Any = None
    ) -> None:
        super().__init__()
        self.inputs, self.nodes, *_ = sizes
        self.features = features
        self.memory = SeedGRU(self.inputs, self.nodes, device, seeds=len(keys[0]))
        self.values = seed_mlp(sizes[1:], keys[0], device)
        with torch.no_grad():
            for place, key in enumerate(keys[1]):
                generator = torch.Generator().manual_seed(key)
                for weight in (self.memory.weight_ih, self.memory.weight_hh):
                    uniform = 2 * torch.rand(weight.shape[1:], generator=generator) - 1
                    weight[place] = uniform / math.sqrt(self.nodes)  # as torch draws them

    def forward(self, inputs: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
        states = self.memory(inputs, hidden)
        return self.values(states.flatten(1, 2)).unflatten(1, states.shape[1:3]), states[:, -1]

    def begin(self, observation: Tensor) -> Tensor:
        """The hidden state (seeds, rows, nodes) that lives begin with: nothing is remembered."""
        return observation.new_zeros(*observation.shape[:-1], self.nodes)

    def step(self, observation: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
        """Values (seeds, rows, actions) of observations (seeds, rows, N_T · features); the hidden state."""
        values, hidden = self(self.seen(observation).unsqueeze(1), hidden)
        return values.squeeze(1), hidden

    def seen(self, observation: Tensor) -> Tensor:
        """The newest records (..., inputs) of observations, concentrations from their own mean."""
        records = observation[..., : self.inputs].unflatten(-1, (-1, self.features))
        concentration = records[..., :1] - records[..., :1].mean(-2, keepdim=True)
        return torch.cat([concentration, records[..., 1:]], dim=-1).flatten(-2)


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


def steered(
    policy: Callable[[Tensor], Tensor], observation: Tensor, hidden: Tensor | None
) -> tuple[Tensor, Tensor | None]:
    """Outputs (seeds, rows, outputs) of a network for observations (seeds, rows, inputs), and the hidden
    state of a recurrent one, before its first decision None.
    """
    if not isinstance(policy, RecurrentMLP):
        return policy(observation), None
    return policy.step(observation, policy.begin(observation) if hidden is None else hidden)


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
    low, high = action_range
    return 0.5 * (low + high) + 0.5 * (high - low) * outputs[..., 0].tanh()


def exported(parameters: Mapping[str, Tensor], place: int, card: dict[str, Any]) -> Network:
    """The network of one of the seeds in an MLP's `state_dict`, as a policy that runs in NumPy."""
    arrays = {name: values[place].detach().cpu().numpy() for name, values in parameters.items()}
    arrays = {name: array.T.copy() if "weight" in name else array[0] for name, array in arrays.items()}
    memory = {name.removeprefix("memory."): arrays.pop(name) for name in list(arrays) if "memory." in name}
    weights = tuple(array for name, array in arrays.items() if name.endswith("weight"))
    biases = [array for name, array in arrays.items() if name.endswith("bias")]
    if card.get("curvature_range") is not None:  # what is left to chance in training is not
        weights, biases = (*weights[:-1], weights[-1][:1]), [*biases[:-1], biases[-1][:1]]
    return RecurrentNetwork(memory, weights, biases, card) if memory else Network(weights, biases, card)
