"""JAX's doors to the world."""

from swarm.envs.jax.env import EnvState, JaxSwarmEnv, Step

__all__ = ["EnvState", "JaxSwarmEnv", "Step"]
