"""What came out: rollouts of populations, their results and statistics."""

from swarm._support.checks import check_installed

check_installed("population tests need", "xarray", "h5netcdf", "scipy", extra="results")
