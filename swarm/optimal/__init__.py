"""What is possible: the physical limit of the gain, and the policy that attains it."""

from swarm._support.checks import check_installed

check_installed("limits need", "scipy", "platformdirs", "rich", extra="results")
