"""The smallest brain: how few parameters buy how much of what is possible."""
