"""TorchRL's name of the environment: `SwarmEnv`."""

from swarm._support.checks import check_installed

check_installed("TorchRL's environment needs", "torch", "tensordict", "torchrl", extra="torchrl")

from swarm.envs.torchrl import SwarmEnv

__all__ = ["SwarmEnv"]
