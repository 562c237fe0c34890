"""The world: its parameters, the state of its cells, its start, and one decision of every cell."""

from swarm.physics.world.state import Outcome, State
from swarm.physics.world.world import World

__all__ = ["Outcome", "State", "World"]
