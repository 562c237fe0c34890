"""How cells lie: what is told of poses that differ between the plane and space."""

from __future__ import annotations

from typing import Any

Array = Any


class Bearing:
    """The part of a world that tells where cells head and what they turn about."""

    dimensions: Any
    swimmer: Any
    curvature: Any
    last_action: Any

    def heading_angle(self, state: Any) -> Array:
        """Heading θ (..., cells) in (−π, π], in the plane [rad]."""
        if self.dimensions != 2:
            raise ValueError("heading_angle must be asked for in the plane, in space ask for orientation")
        return self.swimmer.orientation(state.heading)

    def orientation(self, state: Any) -> Array:
        """What `World.start` takes as the heading: in the plane the angle (..., cells) in (−π, π] [rad], in
        space the frame (..., cells, 4).
        """
        return self.swimmer.orientation(state.heading)

    def direction(self, state: Any) -> Array:
        """Unit vector (..., cells, dimensions) in which cells swim."""
        return self.swimmer.direction(state.heading)

    def centre(self, state: Any) -> Array:
        """What cells turn about (..., cells, dimensions) with the curvature of the interval that ended now:
        in the plane the centre of curvature, in space the nearest point of the helix's axis; NaN where they
        swim straight on [length].
        """
        arcs = self.swimmer.arc_of(self.last_action(state), self.curvature(state))
        return self.swimmer.centre(state.pose, arcs)
