"""What is looked at: figures of populations and of one life, films, pages and the viewer.

Every function of a figure takes results and returns a matplotlib Figure; `save` writes it.
"""

import swarm.figures.backend  # noqa: F401, first of all that loads Matplotlib
from swarm.figures.plots.life import comparison, path_of
from swarm.figures.plots.populations import centrelines, centrelines_and_gains, distribution, gains, radial
from swarm.figures.plots.trends import Curve, Sweep, groups, noise_sweep, sweeps, training
from swarm.figures.style import plain, save

__all__ = ["Curve", "Sweep", "centrelines", "centrelines_and_gains", "comparison", "distribution", "gains"]
__all__ += ["groups", "noise_sweep", "path_of", "plain", "radial", "save", "sweeps", "training"]
