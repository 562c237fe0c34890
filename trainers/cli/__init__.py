"""The command `swarm`: every command and its options. Heavy imports wait until they are needed."""

from trainers.cli import listing, populations, possible, reports, training
from trainers.cli.app import app, errors_as_lines

__all__ = ["app", "errors_as_lines", "listing", "populations", "possible", "reports", "training"]
