"""JAX's doors to the world."""

from swarm._support.checks import check_installed

check_installed("the JAX environment needs", "jax", extra="jax")

from swarm.envs.jax.env import EnvState, JaxSwarmEnv, Step

__all__ = ["EnvState", "JaxSwarmEnv", "Step"]
