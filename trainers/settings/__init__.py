"""Settings of a training run, typed, composed and checked."""

from swarm._support.checks import check_installed

check_installed("settings need", "hydra", "omegaconf", "pydantic", "yaml", extra="results")
