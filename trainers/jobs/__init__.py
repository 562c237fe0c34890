"""Many trainings: sweeps, comparisons, and where they run."""
