"""Experiments on crowds: cells that eat, race, search in shear and touch; trained, measured, judged, reported."""
