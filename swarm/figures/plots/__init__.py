"""Figures of results, each a Matplotlib Figure: of a population, of one life, of what changes."""
