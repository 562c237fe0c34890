"""TorchRL: many worlds in one tensor with `SwarmEnv`, and the PettingZoo environment in TorchRL's wrapper.

pip install '.[train]'
python examples/torchrl_rollout.py
"""

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torchrl.envs import PettingZooWrapper
from torchrl.envs.utils import RandomPolicy

import swarm
from swarm.torchrl_env import SwarmEnv


def tighten_above_the_mean(observation: torch.Tensor) -> torch.Tensor:
    """Actions (...): tight arcs where the newest of the remembered concentrations is above their mean, 0."""
    return (observation[..., 0] > 0).long()


def many_worlds(worlds: int = 16, cells: int = 40, life: float = 80.0) -> TensorDict:
    """Whole lives; fields are (worlds, decisions, …), in the group `swimmers` with cells besides."""
    env = SwarmEnv(worlds, n_swimmers=cells, life=life, seed=0)  # device="cuda" where there is one
    keys = {"in_keys": [("swimmers", "observation")], "out_keys": [("swimmers", "action")]}
    with torch.no_grad():
        return env.rollout(env.world.max_decisions, TensorDictModule(tighten_above_the_mean, **keys))


def one_world(cells: int = 40, life: float = 80.0) -> TensorDict:
    """Lives at random; the wrapper calls the group `swimmer`, and warns of every recent PettingZoo."""
    env = swarm.parallel_env(cells, life=life)
    wrapped = PettingZooWrapper(env, use_mask=True, done_on_any=False, seed=0)
    return wrapped.rollout(env.world.max_decisions, RandomPolicy(wrapped.full_action_spec))


def main(**settings: float) -> tuple[float, float]:
    """Mean gains at the ends of these lives."""
    steered = many_worlds(**settings)["next", "swimmers", "gain"][:, -1].mean().item()
    drifting = one_world(**settings)["next", "swimmer", "info", "gain"][-1].mean().item()
    print(f"mean gain: steered {steered:.2f}, at random {drifting:.2f}")
    return steered, drifting


if __name__ == "__main__":
    main()
