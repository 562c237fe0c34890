"""Species: what is measured of swimmers, in physical units and with its source, and worlds made of it.

Values were recalled from the papers, whose abstracts state none of them, and are fitted to nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from swarm._support.checks import check_name

LENGTH, TIME = "µm", "s"


class Measured(NamedTuple):
    """A quantity, what is reported of it, and by whom."""

    value: float
    unit: str
    reported: str
    source: str


class Species(NamedTuple):
    """A species of swimmers in the plane."""

    name: str
    speed: Measured  # v
    curvature: Measured  # κ̄ without a stimulus
    diffusivity: Measured  # of the attractant
    egg_radius: Measured


SPECIES = {
    "arbacia": Species(
        "Arbacia punctulata",
        Measured(150.0, "µm/s", "100–200 µm/s", "Friedrich and Jülicher, PNAS 104, 13256 (2007)"),
        Measured(0.065, "1/µm", "0.065 µm⁻¹", "Friedrich and Jülicher, PNAS 104, 13256 (2007)"),
        Measured(240.0, "µm²/s", "resact, 240 µm²/s", "Kashikar et al., J. Cell Biol. 198, 1075 (2012)"),
        Measured(35.0, "µm", "35–100 µm", "Lange and Friedrich, PLOS Comput. Biol. 17, e1008826 (2021)"),
    ),
}


def parameters(name: str) -> dict[str, Any]:
    """Parameters of the world, in µm and s, whose lives are those of the default world at another scale: all
    lengths are 4/κ̄ times as many, all times 4/(κ̄ v). Raises ValueError for a species that is not known.
    """
    species = SPECIES[check_name("species", name, SPECIES)]
    length = 4.0 / species.curvature.value
    time = length / species.speed.value
    return {
        "curvatures": (3.0 / length, 5.0 / length),
        "speed": species.speed.value,
        "speeds": (1.1 * species.speed.value, 0.9 * species.speed.value),
        "time_step": 0.02 * time,
        "life": 80.0 * time,
        "start_box": ((0.0, 10.0 * length), (0.0, 10.0 * length)),
        "field": {"type": "linear", "gradient_scale": 1.0 / length},
        "units": (LENGTH, TIME),
    }
