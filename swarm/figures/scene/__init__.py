"""The picture of a swarm: water, egg, swimmers with their trails, and a panel of numbers, drawn by Agg."""

from swarm.figures.scene.easel import PANEL, SIZE
from swarm.figures.scene.glance import TRAIL, Camera, Glance, Segment, Teams, contact_of
from swarm.figures.scene.orbit import Helices, Orbit
from swarm.figures.scene.picture import Scene
from swarm.figures.scene.water import PLUM, SEA, concentration_at, speed_at, velocity_at

__all__ = ["PANEL", "PLUM", "SEA", "SIZE", "TRAIL"]
__all__ += ["Camera", "Glance", "Helices", "Orbit", "Scene", "Segment", "Teams"]
__all__ += ["concentration_at", "contact_of", "speed_at", "velocity_at"]
