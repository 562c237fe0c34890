"""TorchRL's name of the environment: `SwarmEnv`."""

from swarm.envs.torchrl import SwarmEnv

__all__ = ["SwarmEnv"]
