"""Swarms of chemotactic microswimmers in one concentration-and-flow world."""
