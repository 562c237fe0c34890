"""An update as one compiled function, for long runs: gradient, Adam and the target network's step.

Compiling takes ten seconds or more, after which an update of a network this small takes half of its time.
"""

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor, nn
from torch.optim import Adam
from torch.optim.adam import adam

from swarm._support.compiler import compiled


class CompiledUpdate:
    """What backward, Adam's step and SoftUpdate's do to the same tensors (a test holds them equal)."""

    def __init__(self, loss: Any, optimiser: Adam, tau: float) -> None:
        online, following = loss.value_network, loss.target_network.state_dict(keep_vars=True)
        self.optimiser, states = optimiser, [optimiser.state[each] for each in online.parameters()]
        self.held = [[parameter.data for parameter in online.parameters()]]
        self.held += [[state[name] for state in states] for name in ("exp_avg", "exp_avg_sq", "step")]
        self.held.append([following[name].data for name, _ in online.named_parameters()])
        self.step = compiled(_updated, loss.error, online, tau)

    @torch.no_grad()
    def __call__(self, batch: Mapping) -> tuple[Tensor, Tensor]:
        rate = torch.tensor(self.optimiser.param_groups[0]["lr"])  # as a number, each would be compiled anew
        loss, chosen, *held = self.step(self.held, rate, batch)
        for old, new in zip(self.held, held, strict=True):
            torch._foreach_copy_(old, new)
        return loss, chosen


def _updated(
    error: Callable, network: nn.Module, tau: float, held: list[list[Tensor]], rate: Tensor, batch: Any
) -> Any:
    """What `error` gives, then parameters, moments, steps and target parameters after the update."""
    names = [name for name, _ in network.named_parameters()]
    parameters, means, squares, steps, following = [[tensor.clone() for tensor in each] for each in held]

    def playing(tensors: list[Tensor]) -> Callable:
        given = dict(zip(names, tensors, strict=True))
        return lambda *inputs: torch.func.functional_call(network, given, inputs)

    def total(tensors: list[Tensor]) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        loss, chosen = error(playing(tensors), playing(following), batch)
        return loss.sum(), (loss, chosen)

    slopes, (_, measured) = torch.func.grad_and_value(total, has_aux=True)(parameters)
    on_device = torch.compiler.is_compiling()
    adam(
        parameters, slopes, means, squares, [], steps, foreach=False, capturable=on_device, amsgrad=False,
        beta1=0.9, beta2=0.999, lr=rate, weight_decay=0.0, eps=1e-8, maximize=False,
    )  # fmt: skip
    following = [old.lerp(new, tau) for old, new in zip(following, parameters, strict=True)]
    return (*measured, parameters, means, squares, steps, following)
