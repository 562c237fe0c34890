"""TorchRL's door to the world."""

from swarm._support.checks import check_installed

check_installed("TorchRL's environment needs", "torch", "tensordict", "torchrl", extra="torchrl")

from swarm.envs.torchrl.env import GROUP, SwarmEnv

__all__ = ["GROUP", "SwarmEnv"]
