"""What every room stands on: arrays, checks, files, random streams, provenance."""
