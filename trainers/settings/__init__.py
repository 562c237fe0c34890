"""Settings of a training run, typed, composed and checked."""

from swarm._support.checks import check_installed

check_installed("commands need", "hydra", "omegaconf", "pydantic", "typer", "rich", "yaml", extra="results")
