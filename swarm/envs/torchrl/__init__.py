"""TorchRL's door to the world."""

from swarm.envs.torchrl.env import GROUP, SwarmEnv

__all__ = ["GROUP", "SwarmEnv"]
