"""The medium: what cells eat of, secrete into, and see on a grid that they share."""

from swarm.physics.crowd.medium.medium import Medium, MediumState, check_medium

__all__ = ["Medium", "MediumState", "check_medium"]
