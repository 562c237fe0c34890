"""A training: its loop, validation, checkpoints and folder."""
