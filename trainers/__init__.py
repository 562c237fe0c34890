"""Learning: the shared deep Q-network, its recipes, checkpoints and commands."""
