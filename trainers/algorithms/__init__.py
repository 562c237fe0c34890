"""Ways to learn: what the training loop needs of one (`base`), and those there are."""

from swarm._support.checks import check_installed

check_installed("training needs", "torch", "tensordict", "torchrl", extra="train")
