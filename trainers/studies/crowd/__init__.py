"""Experiments on crowds: cells that eat, race, search in shear and touch, measured and judged."""
